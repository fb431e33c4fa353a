# SPDX-License-Identifier: Apache-2.0
"""Our enhancement: one camera-like tone curve for the whole scene.

A normal-light photo differs from a dark one by an exposure in linear light and by the
S-shaped response of a camera, so the enhancement brightens what the field holds with
two numbers per scene: an exposure, which is metered from the training photos before
the first step (``metering.py``), and a saturation, which is learned. Colours are
composited before the curve, as a camera sees them.
"""

import dataclasses
from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from flax import struct
from jax import Array
from jax.lax import stop_gradient
from jaxtyping import Float

from internal import losses
from internal.binding import configurable, typed
from internal.color import linear_to_srgb, srgb_to_linear
from internal.enhancements import metering
from internal.enhancements.base import Output
from internal.enhancements.look import LUMINANCE_WEIGHTS, NEUTRAL, LightEdit
from internal.structs import Level, Lit, LitRendering, Terms

MOST_SATURATION = 2.0
CONTRAST = 1.3  # slope in the log of light; metering.json is fitted with it
SHOULDER = 1.5  # the larger, the shorter; likewise


@configurable("Tone")
@typed
@dataclasses.dataclass(frozen=True)
class Tone:
    """The curve, and the weight of its loss. See ``base.Enhancement``."""

    neighbors: ClassVar[int] = 0
    whole_batch: ClassVar[bool] = True

    contrast: float = CONTRAST
    shoulder: float = SHOULDER
    stops: float | None = None  # exposure; None: metered from the training photos
    colorfulness: float = 1.0  # weight of its loss, which teaches the saturation
    least_colorfulness: float = 0.14  # sRGB

    @property
    def outputs(self) -> Mapping[str, Output]:
        return OUTPUTS

    def network(self, name: str) -> "ToneNetwork":
        return ToneNetwork(self, name=name)

    def along_rays(self, edit: LightEdit) -> LightEdit:
        """Nothing: the curve acts on finished pixels."""
        return NEUTRAL

    def metered(self, dark_srgb: Float[np.ndarray, "n 3"]) -> "Tone":
        """The same with the exposure of a normal photo, unless one is given."""
        if self.stops is not None:
            return self
        stops = metering.meter(dark_srgb, metering.load_prior())
        return dataclasses.replace(self, stops=round(stops, 4))

    def terms(self, rendering: LitRendering) -> Terms:
        """A scene paler than normal photos gets more saturation."""
        pale = losses.colorfulness_loss(
            rendering.enhanced, least=self.least_colorfulness
        )
        return {"colorfulness": self.colorfulness * pale}


@struct.dataclass
class Curve:
    """How dark light becomes a picture."""

    stops: Float[Array, ""] | float  # exposure: linear light times 2^stops
    saturation: Float[Array, ""]  # factor of what is not gray, 1 to MOST_SATURATION
    contrast: float = struct.field(pytree_node=False)
    shoulder: float = struct.field(pytree_node=False)


class ToneNetwork(nn.Module):
    """The scene's saturation as a parameter, at first none. Beyond the ends of its
    range it keeps its gradient, so that it finds its way back."""

    config: Tone

    def setup(self) -> None:
        self.saturation = self.param("saturation", nn.initializers.ones, ())

    def curve(self) -> Curve:
        """The curve as far as it is known; a scene that was not metered stays dark."""
        wanted = jnp.asarray(self.saturation)
        kept = jnp.clip(wanted, 1.0, MOST_SATURATION)
        saturation = wanted + stop_gradient(kept - wanted)
        config = self.config
        return Curve(config.stops or 0.0, saturation, config.contrast, config.shoulder)

    def __call__(self, level: Level, edit: LightEdit) -> Lit:
        return Lit(tone_map(level.rgb, self.curve(), edit))

    def relight(self, rendering: LitRendering, edit: LightEdit) -> Lit:
        """Everything anew: the curve needs the dark pixels alone."""
        return Lit(tone_map(rendering.rgb, self.curve(), edit))


def saturate(
    linear_rgb: Float[Array, "*b 3"], saturation: Float[Array, ""]
) -> Float[Array, "*b 3"]:
    """Moves colours away from the gray of their luminance, which stays; none
    becomes negative."""
    luminance = jnp.sum(linear_rgb * LUMINANCE_WEIGHTS, axis=-1, keepdims=True)
    return jnp.maximum(luminance + saturation * (linear_rgb - luminance), 0.0)


def response(
    exposed: Float[Array, "*b 3"],
    contrast: float,
    shoulder: float,
) -> Float[Array, "*b 3"]:
    """x^n / (1 + x^(n k))^(1/k), n contrast and k shoulder; linear light in [0, 1).

    A straight line of slope n in the log of light where it is dark, and a shoulder
    that never clips a highlight, the shorter the larger k. k = 1 is Naka and
    Rushton's response (1966, of the retina), with n = 1 Reinhard's operator.
    """
    power = jnp.maximum(exposed, 1e-9) ** contrast
    return power / (1.0 + power**shoulder) ** (1.0 / shoulder)


def tone_map(
    dark_srgb: Float[Array | np.ndarray, "*b 3"], curve: Curve, edit: LightEdit
) -> Float[Array, "*b 3"]:
    """The enhanced colour of a dark one, both sRGB, under the user's light edit.

    The edit's gains act on the light before the curve, so more exposure clips no
    highlight; its strength goes from the dark colour to the developed one in equal
    ratios and its contrast is a power of the result.
    """
    linear_rgb = srgb_to_linear(dark_srgb) * edit.gains
    exposed = saturate(linear_rgb, curve.saturation) * 2.0**curve.stops
    lit = linear_to_srgb(response(exposed, curve.contrast, curve.shoulder))
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
