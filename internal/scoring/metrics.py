# SPDX-License-Identifier: Apache-2.0
"""Scores of a rendering against the true picture.

Pictures are ``[height, width, 3]`` sRGB float; masks are True where a pixel counts,
and what lies under them is in no score. Every function first clips to [0, 1] and
rounds to 8 bits, so a score is that of the PNG files. Brightness and
tint of an enhanced picture are a matter of taste; hence PSNR is also given after
the best exposure and after the best colour correction.
"""

from typing import Any

import dm_pix
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float
from scipy import ndimage

from internal.color import linear_to_srgb, quantize, srgb_to_linear, to_uint8
from internal.scene.masks import ALL
from internal.scoring import color_error, lpips

Mask = Bool[np.ndarray, "#height #width"]

PSNR_CAP = 100.0  # dB; given to identical pictures, so that tables stay finite
EXPOSURE_STOPS = 8  # farthest exposure searched, either way
STEPS_PER_STOP = 128  # neighbouring exposures differ by less than one level
WINDOW, SIGMA = 11, 1.5  # pixels, of SSIM
MARGIN = WINDOW // 2
MIN_VARIANCE = 1e-12  # less than one level in one pixel of ten million: constant


def psnr(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
    mask: Mask = ALL,
) -> float:
    """Peak signal-to-noise ratio in dB, at most ``PSNR_CAP``."""
    error = _counted(prediction, mask) - _counted(truth, mask)
    mse = np.mean(np.square(error, dtype=np.float64))
    return float(-10.0 * np.log10(max(mse, 10.0 ** (-PSNR_CAP / 10.0))))


def ssim(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
    mask: Mask = ALL,
) -> float:
    """Structural similarity (Wang et al. 2004), mean over pixels and channels.

    Gaussian window of 11 pixels and sigma 1.5 with population covariance: what
    scikit-image calls ``gaussian_weights=True, sigma=1.5,
    use_sample_covariance=False``. A window's statistics are of its pixels that count;
    the mean is over windows inside the picture whose middle counts, of which there
    must be one (``has_windows``).
    """
    counted = np.broadcast_to(mask, truth.shape[:2])
    pair = [
        jnp.asarray(np.where(counted[..., None], quantize(srgb), np.float32(0.0)))
        for srgb in (prediction, truth)
    ]
    shares = _window_sums(counted[..., None].astype(np.float32))

    def means(values: Any) -> Any:
        sums = _window_sums(np.asarray(values))
        return jnp.asarray(sums / np.maximum(shares, np.finfo(np.float32).tiny))

    found = np.asarray(dm_pix.ssim(*pair, return_map=True, filter_fn=means))
    return float(found[_middles(counted)].mean(dtype=np.float64))


def has_windows(
    truth: Float[Array | np.ndarray, "height width 3"], mask: Mask = ALL
) -> bool:
    """Whether ``ssim`` has anything to look at."""
    return bool(_middles(np.broadcast_to(mask, truth.shape[:2])).any())


def exposure_matched(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
    mask: Mask = ALL,
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
    counted = levels[np.broadcast_to(mask, levels.shape[:2])].ravel()
    counts = np.bincount(counted, minlength=256)
    truth_sums = np.bincount(counted, _counted(truth, mask).ravel(), minlength=256)
    errors = np.square(curves) @ counts - 2.0 * curves @ truth_sums
    return quantize(curves[np.argmin(errors)][levels])


def color_corrected(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
    mask: Mask = ALL,
) -> Float[np.ndarray, "height width 3"]:
    """Least-squares ``slope * sRGB + offset`` of each channel alone, clipped.

    Channels are not mixed (no 3x3 matrix): hue errors within the picture remain.
    A constant channel becomes the truth's mean.
    """
    x = _counted(prediction, mask).astype(np.float64)
    y = _counted(truth, mask).astype(np.float64)
    x_mean, y_mean = x.mean(axis=0), y.mean(axis=0)
    covariance = ((x - x_mean) * (y - y_mean)).mean(axis=0)
    slope = covariance / np.maximum(x.var(axis=0), MIN_VARIANCE)
    return quantize(y_mean + slope * (quantize(prediction) - x_mean))


def psnr_exposure_matched(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
    mask: Mask = ALL,
) -> float:
    """PSNR in dB after ``exposure_matched``."""
    return psnr(exposure_matched(prediction, truth, mask), truth, mask)


def psnr_color_corrected(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
    mask: Mask = ALL,
) -> float:
    """PSNR in dB after ``color_corrected``."""
    return psnr(color_corrected(prediction, truth, mask), truth, mask)


def score(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
    mask: Mask = ALL,
) -> dict[str, float]:
    """Scores of an enhanced rendering against the true bright picture, by name.

    ``ciede2000`` is there only with the extra ``metrics`` installed.
    """
    scores = score_dark(prediction, truth, mask) | {
        "psnr_exposure_matched": psnr_exposure_matched(prediction, truth, mask),
        "psnr_color_corrected": psnr_color_corrected(prediction, truth, mask),
    }
    if color_error.available():
        pair = _counted(prediction, mask), _counted(truth, mask)
        scores["ciede2000"] = color_error.ciede2000(*pair)
    return scores


def score_dark(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
    mask: Mask = ALL,
) -> dict[str, float]:
    """Scores of a dark rendering against the held-out dark photo, by name.

    ``ssim`` is there only where the mask leaves it a window; ``lpips`` only with the
    extra ``metrics`` installed and for pictures that AlexNet is not too deep for.
    """
    scores = {"psnr": psnr(prediction, truth, mask)}
    if has_windows(truth, mask):
        scores["ssim"] = ssim(prediction, truth, mask)
    if lpips.available() and min(truth.shape[:2]) >= lpips.SMALLEST_SIDE:
        scores["lpips"] = lpips.lpips(quantize(prediction), quantize(truth), mask)
    return scores


def _counted(
    srgb: Float[Array | np.ndarray, "height width 3"], mask: Mask
) -> Float[np.ndarray, "_n 3"]:
    """The pixels that count, in 8 bits."""
    return quantize(srgb)[np.broadcast_to(mask, srgb.shape[:2])]


def _window_sums(
    values: Float[np.ndarray, "height width channels"],
) -> Float[np.ndarray, "inner_height inner_width channels"]:
    """Sums over the windows of SSIM that lie inside the picture, by their weights."""
    steps = np.arange(WINDOW) - MARGIN
    weights = np.exp(-0.5 * np.square(steps / SIGMA))
    for axis in (0, 1):
        values = ndimage.correlate1d(values, weights / weights.sum(), axis)
    return values[MARGIN:-MARGIN, MARGIN:-MARGIN]


def _middles(
    counted: Bool[np.ndarray, "height width"],
) -> Bool[np.ndarray, "_inner_height _inner_width"]:
    """Which windows of ``_window_sums`` have a middle that counts."""
    return counted[MARGIN:-MARGIN, MARGIN:-MARGIN]


def _exposure_curves() -> Float[np.ndarray, "gains 256"]:
    """For each gain, 1 among them, what it makes of the 256 sRGB levels."""
    steps = EXPOSURE_STOPS * STEPS_PER_STOP
    stops = np.arange(-steps, steps + 1) / STEPS_PER_STOP
    linear_rgb = srgb_to_linear(np.arange(256, dtype=np.float32) / 255.0)
    gains = np.exp2(stops).astype(np.float32)
    return quantize(linear_to_srgb(gains[:, None] * linear_rgb)).astype(np.float64)
