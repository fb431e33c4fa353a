# SPDX-License-Identifier: Apache-2.0
"""What a dark photo holds: brightness, noise, steps of its 8 bits, sharpness.

Levels are of 8-bit sRGB, 0 to 255. Functions are of single pictures ``[height,
width, 3]``, sRGB float32 in [0, 1].
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int, UInt8
from scipy import ndimage

from internal import color
from internal.scene.noise import noise_level
from internal.squares import square_means

LEVELS = 256
# A photo whose brightest thousandth stays below this level shows nothing.
BLACK_LEVEL = 3.0
BRIGHT_PERCENTILE = 99.9


@dataclasses.dataclass(frozen=True)
class PhotoStatistics:
    """Numbers of one photo; levels are 0 to 255."""

    mean: float
    bright: int  # level of the brightest thousandth
    noise: float  # standard deviation of single pixels, levels
    used_levels: float  # different levels of green from its 1 to 99 percentile
    black_fraction: float  # of green values that are 0
    histogram: tuple[int, ...]  # counts of the 256 levels, all channels

    @property
    def is_black(self) -> bool:
        """Whether nothing can be seen, however it is brightened."""
        return self.bright < BLACK_LEVEL

    @property
    def is_white(self) -> bool:
        """Whether nothing can be seen, for all but a thousandth is at the top."""
        return self.histogram[-1] * 100.0 > BRIGHT_PERCENTILE * sum(self.histogram)


def measure_photo(srgb: Float[np.ndarray, "height width 3"]) -> PhotoStatistics:
    """Measures one photo."""
    levels = [color.to_uint8(srgb[..., channel]) for channel in range(3)]
    counts = [_count(channel) for channel in levels]
    green, total = counts[1], np.sum(counts, axis=0)
    low, high = _percentile(green, 1.0), _percentile(green, 99.0)
    return PhotoStatistics(
        mean=float((total * np.arange(LEVELS)).sum() / total.sum()),
        bright=_percentile(_count(np.maximum.reduce(levels)), BRIGHT_PERCENTILE),
        noise=noise_level(srgb[..., 1]) * (LEVELS - 1),
        used_levels=float(np.count_nonzero(green[low : high + 1])),
        black_fraction=float(green[0] / green.sum()),
        histogram=tuple(total.tolist()),
    )


def _count(levels: UInt8[np.ndarray, "height width"]) -> Int[np.ndarray, " levels"]:
    """How many pixels have each level."""
    return np.bincount(levels.ravel(), minlength=LEVELS)


def _percentile(counts: Int[np.ndarray, " levels"], percent: float) -> int:
    """The lowest level that so many percent of the pixels do not exceed."""
    reached = np.cumsum(counts) >= percent / 100.0 * counts.sum()
    return int(np.argmax(reached))


def sharpness(grey: Float[np.ndarray, "height width"]) -> float:
    """How much fine detail a picture has for its light: larger is sharper.

    Variance of the Laplacian over the squared mean, of a picture shrunk by two, in
    which single-pixel noise counts less. Compares pictures of one place only.
    """
    even = grey[: grey.shape[0] // 2 * 2, : grey.shape[1] // 2 * 2]
    half = square_means(even, 2)
    return float(ndimage.laplace(half).var() / max(half.mean(), 1e-4) ** 2)


def total_histogram(
    photos: Sequence[PhotoStatistics],
) -> Int[np.ndarray, " levels"]:
    """Counts of each level over all photos."""
    return np.sum([photo.histogram for photo in photos], axis=0)
