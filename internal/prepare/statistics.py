# SPDX-License-Identifier: Apache-2.0
"""What a dark photo holds: brightness, noise, steps of its 8 bits, sharpness.

Levels are of 8-bit sRGB, 0 to 255. Functions are of single pictures ``[height,
width, 3]``, sRGB float32 in [0, 1].
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy import ndimage

from internal.noise import noise_level

LEVELS = 256
# A photo whose brightest thousandth stays below this level shows nothing.
BLACK_LEVEL = 3.0
BRIGHT_PERCENTILE = 99.9


@dataclasses.dataclass(frozen=True)
class PhotoStatistics:
    """Numbers of one photo; levels are 0 to 255."""

    mean: float
    bright: float  # level of the brightest thousandth
    noise: float  # standard deviation of single pixels, levels
    used_levels: float  # different levels of green from its 1 to 99 percentile
    black_fraction: float  # of green values that are 0
    histogram: tuple[int, ...]  # counts of the 256 levels, all channels

    @property
    def is_black(self) -> bool:
        """Whether nothing can be seen, however it is brightened."""
        return self.bright < BLACK_LEVEL


def measure(srgb: Float[np.ndarray, "height width 3"]) -> PhotoStatistics:
    """Measures one photo."""
    levels = np.round(np.clip(srgb, 0.0, 1.0) * (LEVELS - 1)).astype(np.uint8)
    green = levels[..., 1]
    low, high = np.percentile(green, [1.0, 99.0])
    used = np.unique(green)
    return PhotoStatistics(
        mean=float(levels.mean()),
        bright=float(np.percentile(levels.max(axis=-1), BRIGHT_PERCENTILE)),
        noise=noise_level(srgb[..., 1]) * (LEVELS - 1),
        used_levels=float(((used >= low) & (used <= high)).sum()),
        black_fraction=float((green == 0).mean()),
        histogram=tuple(np.bincount(levels.ravel(), minlength=LEVELS).tolist()),
    )


def sharpness(grey: Float[np.ndarray, "height width"]) -> float:
    """How much fine detail a picture has for its light: larger is sharper.

    Variance of the Laplacian over the squared mean, of a picture shrunk by two, in
    which single-pixel noise counts less. Compares pictures of one place only.
    """
    even = grey[: grey.shape[0] // 2 * 2, : grey.shape[1] // 2 * 2]
    half = even.reshape(even.shape[0] // 2, 2, even.shape[1] // 2, 2).mean(axis=(1, 3))
    return float(ndimage.laplace(half).var() / max(half.mean(), 1e-4) ** 2)


def total_histogram(
    photos: Sequence[PhotoStatistics],
) -> Int[np.ndarray, " levels"]:
    """Counts of each level over all photos."""
    return np.sum([photo.histogram for photo in photos], axis=0)
