# SPDX-License-Identifier: Apache-2.0
"""What dark photos show of a scene on average: noise, clipping, sRGB curve, 8 bits.

A camera adds Gaussian noise of variance ``floor + growth * x`` to linear light ``x``
(of reading the sensor, and of counting photons), clips to [0, 1], applies the sRGB
curve and rounds to 8 bits. Nothing can be darker than black, so where the scene is
darkest the mean of many photos is brighter than it, and a field that learns the mean
learns this bias (LLNeRF Sec. 4.2.1). ``expected_photo`` gives the mean as a function
of the scene; the data term compares it with the photos instead of the scene itself.
Noise is of single pixels; ``[3]`` is red, green, blue; levels are 8-bit, 0 to 255.
"""

import dataclasses
import itertools
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.lax import stop_gradient
from jaxtyping import Float
from scipy import ndimage, optimize, special

from internal import srgb_curve
from internal.color import srgb_to_linear
from internal.files import atomic, image_io
from internal.scene.masks import Mask, resize_mask
from internal.squares import square_means

# Mean level and noise variance (in levels) of dark to bright parts of photos.
Measured = tuple[Float[np.ndarray, " _bins"], Float[np.ndarray, " _bins"]]
Observation = Callable[[Float[Array, "*b 3"]], Float[Array, "*b 3"]]

LEVELS = np.arange(1, 256)
NODES = np.linspace(0.0, 1.0, 4 * 255 + 1)  # sRGB, where expectations are tabulated
ROUNDING = 1.0 / np.sqrt(12.0)  # standard deviation of rounding errors, levels
MOST_PHOTOS, MOST_PIXELS = 16, 1000  # to estimate from; pixels of each side
BLOCK = 8  # pixels; noise is measured in blocks and compared at equal brightness
BINS = 24  # of brightness
FEWEST_BLOCKS = 30  # of a bin
ENVELOPE = 0.25  # quantile of blocks: most texture lies above
LOWER_WEIGHT = 3.0  # of noise that is less than the fit says, over that of more
# Electrons of read noise, then gains: white is 1 / gain electrons.
USUAL_SENSOR = (3.0, 1e-4, 1e-4, 1e-4)
SENSOR_RANGE = (0.1, 1e-10, 1e-10, 1e-10), (100.0, 0.1, 0.1, 0.1)
# Laplacian of Immerkaer 1996: it leaves noise and removes planes and straight edges.
# The answer to noise of deviation 1 has deviation 1.
_KERNEL = np.outer([1.0, -2.0, 1.0], [1.0, -2.0, 1.0]) / 6.0
_GAUSSIAN_MAD = 0.6745  # median of |Normal(0, 1)|
# The Laplacian's answers at neighbouring pixels are correlated, so a block of them
# is worth fewer independent ones: their number over the sum of squared correlations.
_CORRELATIONS = ndimage.convolve(np.pad(_KERNEL, 2), _KERNEL, mode="constant")
FREEDOM = BLOCK**2 / np.sum(_CORRELATIONS**2)


@dataclasses.dataclass(frozen=True)
class Noise:
    """Variance ``floor + growth * x`` of linear light ``x`` in [0, 1], by channel."""

    floor: tuple[float, float, float]
    growth: tuple[float, float, float]


def expectation(
    floor: float, growth: float
) -> tuple[Float[np.ndarray, " nodes"], Float[np.ndarray, " nodes"]]:
    """Mean and variance of the level q that photos show of the colours ``NODES``.

    q is the number of thresholds t_k, halfway between levels, that light and its noise
    pass: E[q] = sum_k P_k and E[q^2] = sum_k (2k - 1) P_k over k = 1 ... 255, with
    P_k = Phi((x - t_k) / s) and s^2 = floor + growth x. Below the deviation of rounding
    errors s would make a staircase of E[q], and photos of other places blur it: s is
    kept above.
    """
    x = np.asarray(srgb_to_linear(NODES), np.float64)
    thresholds = np.asarray(srgb_to_linear((LEVELS - 0.5) / 255.0), np.float64)
    light_per_level = np.gradient(x, 255.0 * NODES)
    s = np.maximum(np.sqrt(floor + growth * x), ROUNDING * light_per_level)
    passed = special.ndtr((x[:, None] - thresholds) / s[:, None])
    mean = passed.sum(axis=-1)
    return mean, passed @ (2.0 * LEVELS - 1.0) - mean**2


def ideal_photo(rgb: Float[Array, "*b 3"]) -> Float[Array, "*b 3"]:
    """The colours themselves: what the paper compares with photos."""
    return rgb


def expected_photo(noise: Noise) -> Observation:
    """The function h(c) = E[q | c] / 255 from colours to the mean of photos of them:
    the colour and the bias of its noise (LLNeRF Eq. 7).

    Its gradient is that of c: where noise hides a colour it has none of its own, and
    h(c) = q must pull on c nonetheless. Colours above 1 keep the bias at 1.
    """
    pairs = zip(noise.floor, noise.growth, strict=True)
    biases = np.stack([expectation(*pair)[0] / 255.0 - NODES for pair in pairs])

    def observe(rgb: Float[Array, "*b 3"]) -> Float[Array, "*b 3"]:
        own = stop_gradient(rgb)
        bias = [jnp.interp(own[..., c], NODES, biases[c]) for c in range(3)]
        return rgb + jnp.stack(bias, axis=-1)

    return observe


def noise_of_files(
    paths: Sequence[Path], masks: Sequence[Mask] = (), upright: bool = True
) -> Noise:
    """The noise of photos, from the middles of some of them, evenly spread.

    Files, because photos that were shrunk to train on show less noise than was
    clipped before.

    Args:
        masks: of the photos, at any size; () if every pixel counts.
        upright: whether masks are of the photos turned by EXIF, or as stored.
    """
    step = -(-len(paths) // MOST_PHOTOS)
    photos = []
    for path, mask in itertools.zip_longest(paths[::step], masks[::step]):
        srgb = image_io.read_srgb(path, upright)
        if mask is not None:
            srgb[~resize_mask(mask, srgb.shape[1], srgb.shape[0])] = np.nan
        photos.append(_middle(srgb))
    return estimate_noise(photos)


def estimate_noise(photos: Sequence[Float[np.ndarray, "_height _width 3"]]) -> Noise:
    """The noise of photos, sRGB in [0, 1], NaN where they do not count."""
    channels = [[255.0 * photo[..., c] for photo in photos] for c in range(3)]
    return fit_noise([measure_noise(channel) for channel in channels])


def noise_level(picture: Float[np.ndarray, "height width *channels"]) -> float:
    """Standard deviation of the noise of single pixels, in the picture's own unit.

    Median of |Laplacian|, so that edges do not count as noise.
    """
    kernel = _KERNEL.reshape(3, 3, *[1] * (picture.ndim - 2))
    answer = ndimage.convolve(picture, kernel)
    return float(np.median(np.abs(answer)) / _GAUSSIAN_MAD)


def measure_noise(
    channel: Sequence[Float[np.ndarray, "_height _width"]],
) -> Measured:
    """Mean level and noise variance, of dark to bright parts of photos in levels.

    The variance is of a Laplacian's answers in blocks; of blocks that are equally
    bright, the quantile ``ENVELOPE`` stands for the ones without texture. It is
    divided by that quantile of pure noise, whose blocks scatter as chi-squared.
    Bins lie evenly in the square root, along which the noise changes slowly; those
    with few blocks are left out, all of them where photos are tiny.
    """
    means, variances = zip(*map(_blocks, channel), strict=True)
    mean, variance = np.concatenate(means), np.concatenate(variances)
    root = np.sqrt(mean)
    edges = np.linspace(0.0, np.max(root, initial=1.0), BINS + 1)[1:-1]
    members = [np.digitize(root, edges) == b for b in range(BINS)]
    bins = [m for m in members if m.sum() >= FEWEST_BLOCKS]
    # Quantile of chi-square; to load scipy.stats for it takes half a second.
    scatter = 2.0 * special.gammaincinv(FREEDOM / 2.0, ENVELOPE) / FREEDOM
    return (
        np.array([mean[b].mean() for b in bins]),
        np.array([np.quantile(variance[b], ENVELOPE) for b in bins]) / scatter,
    )


def fit_noise(channels: Sequence[Measured]) -> Noise:
    """The noise whose ``expectation`` is nearest to what the channels show.

    Channels are one sensor's: a gain turns photons into light, so that growth is the
    gain and floor = (electrons of read noise * gain)^2, and a channel without dark
    parts learns its floor from the others. Nearest in the logarithm of the variance.
    Texture adds to it, so what is above the fit counts less than what is below, and
    bins that stand out count less too (soft L1). Without bins there is no noise.
    """
    if not all(len(mean) for mean, _ in channels):
        return Noise((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    def sensor(logs: Float[np.ndarray, "4"]) -> list[tuple[float, float]]:
        electrons, *gains = np.exp(logs).tolist()
        return [((electrons * gain) ** 2, gain) for gain in gains]

    def misfit(logs: Float[np.ndarray, "4"]) -> Float[np.ndarray, " _n"]:
        errors = []
        for (mean, variance), pair in zip(channels, sensor(logs), strict=True):
            expected = np.interp(mean, *expectation(*pair))
            error = np.log(expected + 1e-3) - np.log(variance + 1e-3)
            errors.append(np.where(error > 0.0, LOWER_WEIGHT * error, error))
        return np.concatenate(errors)

    result = optimize.least_squares(
        misfit, np.log(USUAL_SENSOR), bounds=np.log(SENSOR_RANGE), loss="soft_l1"
    )
    floor, growth = zip(*sensor(result.x), strict=True)
    return Noise(floor, growth)


def record(folder: Path, noise: Noise) -> None:
    """Prints the noise and writes it to ``noise.json`` in the run folder."""
    text = json.dumps(dataclasses.asdict(noise), indent=2)
    atomic.write_text(folder / "noise.json", text + "\n")
    level = 1.0 / (255.0 * srgb_curve.SLOPE)
    at_black = ", ".join(f"{np.sqrt(x) / level:.2f}" for x in noise.floor)
    growth = ", ".join(f"{x:.2g}" for x in noise.growth)
    print(f"noise: {at_black} levels at black (R, G, B), variance grows by {growth}")


def _middle(
    picture: Float[np.ndarray, "_height _width 3"],
) -> Float[np.ndarray, "_h _w 3"]:
    """At most ``MOST_PIXELS`` of each side."""
    starts = [max(0, (size - MOST_PIXELS) // 2) for size in picture.shape[:2]]
    rows, columns = (slice(start, start + MOST_PIXELS) for start in starts)
    return picture[rows, columns]


def _blocks(
    levels: Float[np.ndarray, "height width"],
) -> tuple[Float[np.ndarray, " blocks"], Float[np.ndarray, " blocks"]]:
    """Mean level and noise variance of each whole block of a picture; a block counts
    if all pixels do that it is measured from."""
    answer = ndimage.convolve(levels, _KERNEL)[1:-1, 1:-1]
    rows, columns = (size // BLOCK for size in answer.shape)

    def means(values: Float[np.ndarray, "_h _w"]) -> Float[np.ndarray, " blocks"]:
        whole = values[: rows * BLOCK, : columns * BLOCK]
        return square_means(whole, BLOCK).ravel()

    mean, variance = means(levels[1:-1, 1:-1]), means(answer**2)
    counted = np.isfinite(variance)
    return mean[counted], variance[counted]
