# SPDX-License-Identifier: Apache-2.0
"""Scores of a rendering against the true picture.

Pictures are ``[height, width, 3]`` sRGB float. Every function first clips to
[0, 1] and rounds to 8 bits, so a score is that of the PNG files. Brightness and
tint of an enhanced picture are a matter of taste; hence PSNR is also given after
the best exposure and after the best colour correction.
"""

import dm_pix
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from internal.color import linear_to_srgb, quantize, srgb_to_linear, to_uint8
from internal.scoring import color_error, lpips

PSNR_CAP = 100.0  # dB; given to identical pictures, so that tables stay finite
EXPOSURE_STOPS = 8  # farthest exposure searched, either way
STEPS_PER_STOP = 128  # neighbouring exposures differ by less than one level
MIN_VARIANCE = 1e-12  # less than one level in one pixel of ten million: constant


def psnr(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
) -> float:
    """Peak signal-to-noise ratio in dB, at most ``PSNR_CAP``."""
    error = quantize(prediction) - quantize(truth)
    mse = np.mean(np.square(error, dtype=np.float64))
    return float(-10.0 * np.log10(max(mse, 10.0 ** (-PSNR_CAP / 10.0))))


def ssim(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
) -> float:
    """Structural similarity (Wang et al. 2004), mean over pixels and channels.

    Gaussian window of 11 pixels and sigma 1.5 with population covariance: what
    scikit-image calls ``gaussian_weights=True, sigma=1.5,
    use_sample_covariance=False``. Each side must be at least 11 pixels.
    """
    return float(
        dm_pix.ssim(jnp.asarray(quantize(prediction)), jnp.asarray(quantize(truth)))
    )


def exposure_matched(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
) -> Float[np.ndarray, "height width 3"]:
    """The prediction times the one gain in linear light that maximises its PSNR.

    Minimising the scored error itself, clipping and rounding included, is robust
    where least squares in linear light is not: there the brightest pixels decide
    and a lamp clipped in the truth drags the gain down. The result therefore
    never scores below the prediction. Gains reach ``EXPOSURE_STOPS`` stops either
    way.
    """
    levels = to_uint8(prediction)
    curves = _exposure_curves()
    # The squared error needs of the pictures only these sums over each level.
    counts = np.bincount(levels.ravel(), minlength=256)
    truth_sums = np.bincount(levels.ravel(), quantize(truth).ravel(), minlength=256)
    errors = np.square(curves) @ counts - 2.0 * curves @ truth_sums
    return quantize(curves[np.argmin(errors)][levels])


def color_corrected(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
) -> Float[np.ndarray, "height width 3"]:
    """Least-squares ``slope * sRGB + offset`` of each channel alone, clipped.

    Channels are not mixed (no 3x3 matrix): hue errors within the picture remain.
    A constant channel becomes the truth's mean.
    """
    x = quantize(prediction).astype(np.float64)
    y = quantize(truth).astype(np.float64)
    x_mean, y_mean = x.mean(axis=(0, 1)), y.mean(axis=(0, 1))
    covariance = ((x - x_mean) * (y - y_mean)).mean(axis=(0, 1))
    slope = covariance / np.maximum(x.var(axis=(0, 1)), MIN_VARIANCE)
    return quantize(y_mean + slope * (x - x_mean))


def psnr_exposure_matched(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
) -> float:
    """PSNR in dB after ``exposure_matched``."""
    return psnr(exposure_matched(prediction, truth), truth)


def psnr_color_corrected(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
) -> float:
    """PSNR in dB after ``color_corrected``."""
    return psnr(color_corrected(prediction, truth), truth)


def score(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
) -> dict[str, float]:
    """Scores of an enhanced rendering against the true bright picture, by name.

    ``ciede2000`` is there only with the extra ``metrics`` installed.
    """
    scores = score_dark(prediction, truth) | {
        "psnr_exposure_matched": psnr_exposure_matched(prediction, truth),
        "psnr_color_corrected": psnr_color_corrected(prediction, truth),
    }
    if color_error.available():
        pair = quantize(prediction), quantize(truth)
        scores["ciede2000"] = color_error.ciede2000(*pair)
    return scores


def score_dark(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
) -> dict[str, float]:
    """Scores of a dark rendering against the held-out dark photo, by name.

    ``lpips`` is there only with the extra ``metrics`` installed and for pictures
    that AlexNet is not too deep for.
    """
    scores = {"psnr": psnr(prediction, truth), "ssim": ssim(prediction, truth)}
    if lpips.available() and min(truth.shape[:2]) >= lpips.SMALLEST_SIDE:
        scores["lpips"] = lpips.lpips(quantize(prediction), quantize(truth))
    return scores


def _exposure_curves() -> Float[np.ndarray, "gains 256"]:
    """For each gain, 1 among them, what it makes of the 256 sRGB levels."""
    steps = EXPOSURE_STOPS * STEPS_PER_STOP
    stops = np.arange(-steps, steps + 1) / STEPS_PER_STOP
    linear_rgb = srgb_to_linear(np.arange(256, dtype=np.float32) / 255.0)
    gains = np.exp2(stops).astype(np.float32)
    return quantize(linear_to_srgb(gains[:, None] * linear_rgb)).astype(np.float64)
