# SPDX-License-Identifier: Apache-2.0
"""Editing the light at render time, as numbers that the model multiplies by.

Users speak of stops and kelvin, which act on linear light; the paper's lighting v
and enhancement live in display-coded sRGB. Since the sRGB curve is close to a 2.2
power, a gain g on linear light is the gain g ** (1 / 2.2) on coded values.
"""

import numpy as np
from flax import struct
from jax import Array
from jaxtyping import Float

from internal.errors import UserError

DISPLAY_POWER = 2.2
NEUTRAL_KELVIN = 6500.0
STRENGTH_RANGE = (0.0, 1.0)
STOPS_RANGE = (-16.0, 16.0)
KELVIN_RANGE = (1700.0, 25000.0)
TINT_RANGE = (-2.0, 2.0)
CONTRAST_RANGE = (0.25, 4.0)
MIDDLE_GREY = 0.5  # the lighting that contrast leaves as it is
LUMINANCE_WEIGHTS = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709, linear light
LINEAR_RGB_FROM_XYZ = np.array(  # IEC 61966-2-1
    [
        [3.2406, -1.5372, -0.4986],
        [-0.9689, 1.8758, 0.0415],
        [0.0557, -0.2040, 1.0570],
    ]
)


@struct.dataclass
class LightEdit:
    """What the user wants of the light, float32; see ``light_edit`` for units."""

    strength: Float[Array | np.ndarray, ""]  # 0: as photographed, 1: as learned
    contrast: Float[Array | np.ndarray, ""]  # factor of the lighting's exponent
    exposure_gain: Float[Array | np.ndarray, ""]  # on display-coded values
    color_gains: Float[Array | np.ndarray, " 3"]  # likewise, red green blue

    @property
    def gains(self) -> Float[Array | np.ndarray, " 3"]:
        """All that multiplies a pixel: it can be applied to a finished picture."""
        return self.exposure_gain * self.color_gains

    def without_gains(self) -> "LightEdit":
        """The part of the edit that must be known while rays are followed."""
        one = np.ones((), np.float32)
        return LightEdit(self.strength, self.contrast, one, np.ones(3, np.float32))


def light_edit(
    strength: float = 1.0,
    exposure_stops: float = 0.0,
    temperature_kelvin: float = NEUTRAL_KELVIN,
    tint_stops: float = 0.0,
    contrast: float = 1.0,
) -> LightEdit:
    """The edit for settings in a user's words; the defaults give gains of exactly 1.

    Args:
        strength: how much of the learned enhancement is applied, 0 (none) to 1.
        exposure_stops: each stop doubles the linear light; -16 to 16.
        temperature_kelvin: colour of the light, 1700 to 25000. 6500 leaves it, a
            lower number is a warmer light (redder picture), a higher one a colder
            light (bluer picture).
        tint_stops: magenta over green, -2 (green) to 2 (magenta).
        contrast: power of the lighting about ``MIDDLE_GREY``, 0.25 (flat) to 4.

    Raises:
        UserError: a setting is out of range or not a number.
    """
    _check("strength", strength, STRENGTH_RANGE)
    _check("exposure_stops", exposure_stops, STOPS_RANGE)
    _check("temperature_kelvin", temperature_kelvin, KELVIN_RANGE)
    _check("tint_stops", tint_stops, TINT_RANGE)
    _check("contrast", contrast, CONTRAST_RANGE)
    gain = 2.0 ** (exposure_stops / DISPLAY_POWER) * MIDDLE_GREY ** (1.0 - contrast)
    linear_gains = temperature_gains(temperature_kelvin) * tint_gains(tint_stops)
    return LightEdit(
        strength=np.asarray(strength, np.float32),
        contrast=np.asarray(contrast, np.float32),
        exposure_gain=np.asarray(gain, np.float32),
        color_gains=(linear_gains ** (1.0 / DISPLAY_POWER)).astype(np.float32),
    )


def temperature_gains(kelvin: float) -> Float[np.ndarray, " 3"]:
    """Gains on linear RGB that turn a 6500 K light into one of ``kelvin``.

    A grey keeps its luminance, and at 6500 K each gain is exactly 1.
    """
    return _of_luminance_one(_blackbody_rgb(kelvin) / _blackbody_rgb(NEUTRAL_KELVIN))


def tint_gains(stops: float) -> Float[np.ndarray, " 3"]:
    """Gains on linear RGB after which red and blue are ``stops`` above green.

    A grey keeps its luminance, and at 0 each gain is exactly 1.
    """
    return _of_luminance_one(2.0 ** (stops * np.array([0.5, -0.5, 0.5])))


def _of_luminance_one(gains: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    return gains / np.average(gains, weights=LUMINANCE_WEIGHTS)


def _blackbody_rgb(kelvin: float) -> Float[np.ndarray, " 3"]:
    """Linear RGB of luminance 1 of a black body; below 1900 K its blue is clipped
    to 0, for it lies outside the sRGB gamut."""
    x, y = _planckian_xy(kelvin)
    xyz = np.array([x / y, 1.0, (1.0 - x - y) / y])
    return np.maximum(LINEAR_RGB_FROM_XYZ @ xyz, 0.0)


def _planckian_xy(kelvin: float) -> tuple[float, float]:
    """CIE 1931 chromaticity of a black body, 1667 to 25000 K.

    The cubic splines of Kim et al. 2002 (US patent 7024034).
    """
    warm_x = (-0.2661239, -0.2343589, 0.8776956, 0.179910)
    cold_x = (-3.0258469, 2.1070379, 0.2226347, 0.240390)
    x = float(np.polyval(warm_x if kelvin <= 4000.0 else cold_x, 1000.0 / kelvin))
    if kelvin <= 2222.0:
        in_x = (-1.1063814, -1.34811020, 2.18555832, -0.20219683)
    elif kelvin <= 4000.0:
        in_x = (-0.9549476, -1.37418593, 2.09137015, -0.16748867)
    else:
        in_x = (3.0817580, -5.87338670, 3.75112997, -0.37001483)
    return x, float(np.polyval(in_x, x))


def _check(name: str, value: float, limits: tuple[float, float]) -> None:
    low, high = limits
    if not low <= value <= high:
        raise UserError(f"{name} = {value}: expected a number from {low} to {high}")


NEUTRAL = light_edit()
