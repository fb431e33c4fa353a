# SPDX-License-Identifier: Apache-2.0
"""Our enhancement: one camera-like tone curve for the whole scene.

A normal-light photo differs from a dark one by an exposure in linear light and by the
S-shaped response of a camera, so the enhancement brightens what the field holds with
two numbers per scene, which are found by metering: an exposure and a saturation.
Colours are composited before the curve, as a camera sees them.
"""

import dataclasses
from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp
from flax import linen as nn
from flax import struct
from jax import Array
from jax.lax import stop_gradient
from jaxtyping import Float

from internal import losses
from internal.binding import configurable, typed
from internal.color import linear_to_srgb, srgb_to_linear
from internal.enhancements.base import Output
from internal.enhancements.look import LUMINANCE_WEIGHTS, NEUTRAL, LightEdit
from internal.structs import Level, Lit, LitRendering, Terms

MOST_SATURATION = 2.0
METERED = 0.01  # sRGB: an exposure as near as this is right


@configurable("Tone")
@typed
@dataclasses.dataclass(frozen=True)
class Tone:
    """The curve and the weights of its metering. See ``base.Enhancement``."""

    neighbors: ClassVar[int] = 0
    whole_batch: ClassVar[bool] = True

    contrast: float = 1.3  # exponent of the response
    exposure: float = 1.0  # weight of metering
    exposure_target: float = 0.58  # sRGB, of the largest channel
    colorfulness: float = 1.0  # weight
    least_colorfulness: float = 0.14  # sRGB

    @property
    def outputs(self) -> Mapping[str, Output]:
        return OUTPUTS

    def network(self, name: str) -> "ToneNetwork":
        return ToneNetwork(self, name=name)

    def along_rays(self, edit: LightEdit) -> LightEdit:
        """Nothing: the curve acts on finished pixels."""
        return NEUTRAL

    def terms(self, rendering: LitRendering) -> Terms:
        """The exposure answers to the first alone and the saturation to the second
        alone, once the exposure is right: in the dark every scene is pale."""
        lit = rendering.lit
        assert isinstance(lit, ToneLit)
        metering = losses.metering_loss(lit.exposed, target=self.exposure_target)
        pale = losses.colorfulness_loss(lit.colored, least=self.least_colorfulness)
        metered = stop_gradient(metering) < METERED**2
        return {
            "exposure": self.exposure * metering,
            "colorfulness": self.colorfulness * jnp.where(metered, pale, 0.0),
        }


@struct.dataclass
class Curve:
    """What metering finds, once per scene."""

    stops: Float[Array, ""]  # exposure: linear light times 2^stops
    saturation: Float[Array, ""]  # factor of what is not gray, 1 to MOST_SATURATION


@struct.dataclass
class ToneLit(Lit):
    """Developed rays; the others are the same colours to one parameter alone."""

    exposed: Float[Array, "*rays 3"]  # moved by the exposure
    colored: Float[Array, "*rays 3"]  # moved by the saturation


class ToneNetwork(nn.Module):
    """The scene's ``Curve`` as parameters, at first no change of exposure or colour.

    Beyond the ends of its range the saturation keeps its gradient, so that it finds
    its way back.
    """

    config: Tone

    def setup(self) -> None:
        self.stops = self.param("stops", nn.initializers.zeros, ())
        self.saturation = self.param("saturation", nn.initializers.ones, ())

    def curve(self) -> Curve:
        """The curve as far as it is learned."""
        wanted = jnp.asarray(self.saturation)
        kept = jnp.clip(wanted, 1.0, MOST_SATURATION)
        return Curve(jnp.asarray(self.stops), wanted + stop_gradient(kept - wanted))

    def __call__(self, level: Level, edit: LightEdit) -> ToneLit:
        return self._develop(level.rgb, edit)

    def relight(self, rendering: LitRendering, edit: LightEdit) -> ToneLit:
        """Everything anew: the curve needs the dark pixels alone."""
        return self._develop(rendering.rgb, edit)

    def _develop(self, dark_srgb: Float[Array, "*rays 3"], edit: LightEdit) -> ToneLit:
        curve, contrast = self.curve(), self.config.contrast
        held = stop_gradient(curve)
        exposed = Curve(curve.stops, held.saturation)
        colored = Curve(held.stops, curve.saturation)
        return ToneLit(
            enhanced=develop(dark_srgb, curve, contrast, edit),
            exposed=develop(dark_srgb, exposed, contrast, edit),
            colored=develop(dark_srgb, colored, contrast, edit),
        )


def saturate(
    linear_rgb: Float[Array, "*b 3"], saturation: Float[Array, ""]
) -> Float[Array, "*b 3"]:
    """Moves colours away from the gray of their luminance, which stays; none
    becomes negative."""
    luminance = jnp.sum(linear_rgb * LUMINANCE_WEIGHTS, axis=-1, keepdims=True)
    return jnp.maximum(luminance + saturation * (linear_rgb - luminance), 0.0)


def response(
    exposed: Float[Array, "*b 3"], contrast: float | Float[Array, ""]
) -> Float[Array, "*b 3"]:
    """Naka and Rushton's response x^n / (1 + x^n), linear light in [0, 1).

    A straight line of slope n in the log of light where it is dark, and a shoulder
    that never clips a highlight (Naka and Rushton 1966, of the retina; n = 1 is
    Reinhard's operator).
    """
    power = jnp.maximum(exposed, 1e-9) ** contrast
    return power / (1.0 + power)


def develop(
    dark_srgb: Float[Array, "*b 3"], curve: Curve, contrast: float, edit: LightEdit
) -> Float[Array, "*b 3"]:
    """The enhanced colour of a dark one, both sRGB, under the user's light edit.

    The edit's gains act on the light before the curve, so more exposure clips no
    highlight; its strength goes from the dark colour to the developed one in equal
    ratios and its contrast is a power of the result.
    """
    linear_rgb = srgb_to_linear(dark_srgb) * edit.gains
    exposed = saturate(linear_rgb, curve.saturation) * 2.0**curve.stops
    lit = linear_to_srgb(response(exposed, contrast))
    dark = jnp.maximum(linear_to_srgb(linear_rgb), 1e-9)
    mixed = dark ** (1.0 - edit.strength) * lit**edit.strength
    return mixed**edit.contrast * edit.pivot


OUTPUTS: Mapping[str, Output] = {
    "enhanced": Output(
        "the lit scene, the dark one through the scene's tone curve: the result",
        lambda x: x.enhanced,
    ),
    "v_enhanced": Output(
        "lighting that r would need for the result, scaled to be visible",
        lambda x: x.enhanced / jnp.maximum(x.r, 1e-6),
        scaled=True,
    ),
}
