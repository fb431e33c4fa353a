# SPDX-License-Identifier: Apache-2.0
"""From something that should be gray to the light that makes it so."""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy import optimize

from internal import color
from internal.enhancements.look import KELVIN_RANGE, TINT_RANGE, Look
from internal.errors import UserError

WARMEST, COLDEST = 2000.0, KELVIN_RANGE[1]  # below, blue is clipped
DARKEST = 1e-4  # linear light; what is darker has no colour to go by
# How far the channels of the result may be apart, logarithm of linear light.
GRAY = 0.02
FURTHER_STARTS = ((6500.0, 0.0), (12000.0, 0.0), (3000.0, 0.0))  # kelvin, tint
MOST_TINT = TINT_RANGE[1] - 0.01

Light = Float[np.ndarray, " 2"]  # mired, tint


def make_gray(shown: Callable[[Look], Float[np.ndarray, " 3"]], look: Look) -> Look:
    """The look with the temperature and tint under which a pixel is gray.

    Solved in linear light, by least squares over the pixel as the enhancement shows
    it, so it holds under any strength, exposure and contrast.

    Args:
        shown: the pixel, sRGB, under a look that differs in temperature and tint.

    Raises:
        UserError: the pixel is black, or no light of the range makes it gray.
    """

    def lit_by(light: Light) -> Look:
        kelvin, tint = round(1e6 / float(light[0])), round(float(light[1]), 3)
        return dataclasses.replace(look, temperature=float(kelvin), tint=tint)

    def colorfulness(light: Light) -> Float[np.ndarray, " 2"]:
        kelvin, tint = 1e6 / float(light[0]), float(light[1])
        srgb = shown(dataclasses.replace(look, temperature=kelvin, tint=tint))
        linear = np.asarray(color.srgb_to_linear(srgb), np.float64)
        red, green, blue = np.log(np.maximum(linear, DARKEST))
        return np.array([red - green, blue - green])

    if np.asarray(color.srgb_to_linear(shown(look))).max() <= DARKEST:
        raise UserError("this is black: pick something gray that is brighter")
    # In mired, by which colour changes evenly.
    low, high = [1e6 / COLDEST, -MOST_TINT], [1e6 / WARMEST, MOST_TINT]
    # A channel that a light leaves black says nothing: others are tried.
    for kelvin, tint in ((look.temperature, look.tint), *FURTHER_STARTS):
        start = np.clip([1e6 / kelvin, tint], low, high)
        found = optimize.least_squares(
            colorfulness,
            start,
            bounds=(low, high),
            x_scale=[100.0, 1.0],
            diff_step=1e-3,
        )
        if np.abs(found.fun).max() < GRAY:
            return lit_by(found.x)
    raise UserError(
        f"no light up to {COLDEST:g} K makes this gray: its colour is its own; pick "
        "something nearer to gray"
    )
