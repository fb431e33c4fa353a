# SPDX-License-Identifier: Apache-2.0
"""Copies of dark photos in which features are found. Nobody trains on them.

Pictures are ``[height, width, 3]`` sRGB float32 in [0, 1]; copies are grey,
``[height, width, 1]``, sRGB in [0, 1]. docs/your_photos.md has what was measured.
"""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from internal import color
from internal.files import image_io

WHITE_PERCENTILE = 99.0  # of a photo's light: lamps are rarely larger than the rest
WHITE = 0.8  # linear light that it is brought to
LARGEST_SIDE = 1600  # pixels of a copy; more find no better cameras, only later


@dataclasses.dataclass(frozen=True)
class Recipe:
    """How a copy is made.

    ``blur`` is the standard deviation in pixels of a Gaussian over linear light. In
    the dark the noise of single pixels outnumbers the features of that size.
    """

    brighten: bool
    blur: float


AS_IT_IS = Recipe(brighten=False, blur=0.0)


def copy_size(width: int, height: int) -> tuple[int, int]:
    """(width, height) of a copy: the photo's, or smaller in the same proportions."""
    factor = min(1.0, LARGEST_SIDE / max(width, height))
    return max(1, round(width * factor)), max(1, round(height * factor))


def make_copy(
    srgb: Float[np.ndarray, "height width 3"], recipe: Recipe
) -> Float[np.ndarray, "_height2 _width2 1"]:
    """The grey copy of one photo, at most ``LARGEST_SIDE`` pixels wide and high.

    Light is averaged before it is brightened: that removes noise, and 8-bit steps
    of dark photos with it.
    """
    linear = _grey_light(srgb)
    width, height = copy_size(linear.shape[1], linear.shape[0])
    if (height, width) != linear.shape[:2]:
        linear = image_io.resize_area(linear, width, height)
    if recipe.blur:
        linear = ndimage.gaussian_filter(linear, recipe.blur, axes=(0, 1))
    if recipe.brighten:
        white = float(np.percentile(linear, WHITE_PERCENTILE))
        linear = linear * (WHITE / max(white, np.finfo(np.float32).tiny))
    return np.clip(np.asarray(color.linear_to_srgb(linear)), 0.0, 1.0)


def _grey_light(
    srgb: Float[np.ndarray, "height width 3"],
) -> Float[np.ndarray, "height width 1"]:
    """Linear light, mean of the channels; one at a time, for large photos."""
    red, green, blue = (color.photo_to_linear(srgb[..., i]) for i in range(3))
    return ((red + green + blue) / 3.0)[..., None]
