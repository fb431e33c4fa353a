# SPDX-License-Identifier: Apache-2.0
"""A look: how a user wants the scene lit, in words, and as numbers for an enhancement.

Users speak of stops and kelvin, which act on linear light; the paper's lighting v
and its enhancement live in display-coded sRGB. Since the sRGB curve is close to a 2.2
power, a gain g on linear light is the gain g ** (1 / 2.2) on coded values. What an
edit does to a scene is up to its enhancement (``base.Network``).
"""

import dataclasses

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
MIDDLE_GREY = 0.5  # the coded value that contrast leaves as it is
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
    """What an enhancement needs to know of a look, float32."""

    strength: Float[Array | np.ndarray, ""]  # 0: as photographed, 1: as learned
    contrast: Float[Array | np.ndarray, ""]  # power about ``MIDDLE_GREY``
    gains: Float[Array | np.ndarray, " 3"]  # on linear light, red green blue

    @property
    def coded_gains(self) -> Float[Array | np.ndarray, " 3"]:
        """The gains on display-coded values."""
        return self.gains ** (1.0 / DISPLAY_POWER)

    @property
    def pivot(self) -> Float[Array | np.ndarray | np.floating, ""]:
        """What brings ``MIDDLE_GREY`` to the power of the contrast back."""
        return MIDDLE_GREY ** (1.0 - self.contrast)

    def without_gains(self) -> "LightEdit":
        """The same strength and contrast in the light as it is."""
        return dataclasses.replace(self, gains=np.ones(3, np.float32))


@dataclasses.dataclass(frozen=True)
class Look:
    """Light settings; the defaults show the scene as learned."""

    strength: float = 1.0  # 0: dark, 1: enhanced
    exposure: float = 0.0  # stops: each doubles the linear light
    temperature: float = 6500.0  # kelvin; lower is a warmer light, 6500 leaves it
    tint: float = 0.0  # stops of magenta over green
    contrast: float = 1.0  # of the lighting, 0.25 (flat) to 4

    def edit(self) -> LightEdit:
        """What an enhancement needs to know of it; gains of exactly 1 by default.

        Raises:
            UserError: a setting is out of range or not a number.
        """
        _check("strength", self.strength, STRENGTH_RANGE)
        _check("exposure", self.exposure, STOPS_RANGE)
        _check("temperature", self.temperature, KELVIN_RANGE)
        _check("tint", self.tint, TINT_RANGE)
        _check("contrast", self.contrast, CONTRAST_RANGE)
        color = temperature_gains(self.temperature) * tint_gains(self.tint)
        return LightEdit(
            strength=np.asarray(self.strength, np.float32),
            contrast=np.asarray(self.contrast, np.float32),
            gains=(2.0**self.exposure * color).astype(np.float32),
        )

    def light(self) -> "Look":
        """The light settings alone, of a configuration that has more."""
        return Look(**{f.name: getattr(self, f.name) for f in dataclasses.fields(Look)})

    def bindings(self) -> tuple[str, ...]:
        """The gin bindings that make render.py show it."""
        settings = dataclasses.asdict(self.light())
        return tuple(f"Render.{name} = {value!r}" for name, value in settings.items())


def same_edit(one: LightEdit, other: LightEdit) -> bool:
    """Whether two edits are equal in every number."""
    return all(
        np.array_equal(getattr(one, field.name), getattr(other, field.name))
        for field in dataclasses.fields(one)
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
        raise UserError(
            f"Render.{name} = {value}: expected a number from {low:g} to {high:g}"
        )


NEUTRAL = Look().edit()
