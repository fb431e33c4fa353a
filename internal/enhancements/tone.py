# SPDX-License-Identifier: Apache-2.0
"""One camera-like tone curve for the whole scene: our alternative to Eq. 8's.

A normal-light photo differs from a dark one by an exposure in linear light and by the
S-shaped response of a camera, so the enhancement brightens what the field holds with
two numbers per scene, which are found by metering (``losses.metering_loss``,
``losses.colorfulness_loss``): an exposure and a saturation. Colours are composited
before the curve, as a camera sees them; v_hat is what is left of them without r.
"""

import jax
import jax.numpy as jnp
from flax import linen as nn
from flax import struct
from jax import Array
from jaxtyping import Float

from internal.color import linear_to_srgb, srgb_to_linear
from internal.enhancements.editing import LUMINANCE_WEIGHTS, LightEdit

MOST_SATURATION = 2.0


@struct.dataclass
class Tone:
    """What metering finds, once per scene."""

    stops: Float[Array, ""]  # exposure: linear light times 2^stops
    saturation: Float[Array, ""]  # factor of what is not gray, 1 to MOST_SATURATION


class Meter(nn.Module):
    """The scene's ``Tone`` as parameters, at first no change of exposure or colour.

    Beyond the ends of its range the saturation keeps its gradient, so that it finds
    its way back.
    """

    @nn.compact
    def __call__(self) -> Tone:
        stops = self.param("stops", nn.initializers.zeros, ())
        wanted = jnp.asarray(self.param("saturation", nn.initializers.ones, ()))
        kept = jnp.clip(wanted, 1.0, MOST_SATURATION)
        return Tone(jnp.asarray(stops), wanted + jax.lax.stop_gradient(kept - wanted))


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
    dark_srgb: Float[Array, "*b 3"], tone: Tone, contrast: float, edit: LightEdit
) -> Float[Array, "*b 3"]:
    """The enhanced colour of a dark one, both sRGB, under the user's light edit.

    The edit's strength goes from the dark colour to the developed one in equal
    ratios, its contrast is a power of the result and its gains multiply it.
    """
    exposed = saturate(srgb_to_linear(dark_srgb), tone.saturation) * 2.0**tone.stops
    lit = linear_to_srgb(response(exposed, contrast))
    dark = jnp.maximum(dark_srgb, 1e-9)
    mixed = dark ** (1.0 - edit.strength) * lit**edit.strength
    return mixed**edit.contrast * edit.exposure_gain * edit.color_gains
