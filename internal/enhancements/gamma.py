# SPDX-License-Identifier: Apache-2.0
"""The dynamic gamma enhancement of the lighting component (paper, Sec. 4.2.2).

v, v_hat and r are display-coded (sRGB) factors of colour: v * r is the dark
colour, v_hat * r the enhanced one.
"""

import jax.numpy as jnp
from flax import struct
from jax import Array
from jaxtyping import Float

from internal.enhancements.editing import LightEdit

EPS_ALPHA = 1e-4  # floor of alpha, so that the gain stays finite


@struct.dataclass
class Coefficients:
    """What the enhancement network phi predicts at each sample."""

    alpha: Float[Array, "*b 1"]  # lighting gain is 1 / alpha
    gamma: Float[Array, "*b 3"]  # per-channel change of the exponent


def enhance_v(
    v: Float[Array, "*b 1"],
    alpha: Float[Array, "*b 1"],
    exponent: Float[Array, "*b 3"],
) -> Float[Array, "*b 3"]:
    """v_hat = (v / alpha)^exponent (paper, Eq. 8); alpha = exponent = 1 is identity."""
    return (v / jnp.maximum(alpha, EPS_ALPHA)) ** exponent


def phi(
    v: Float[Array, "*b 1"],
    coefficients: Coefficients,
    gamma0: float,
    edit: LightEdit,
) -> Float[Array, "*b 3"]:
    """Eq. 8 with exponent 1 / (gamma0 + gamma), under the user's light edit.

    The edit's strength moves alpha and the exponent towards their identity, 1; its
    contrast multiplies the exponent and its gains multiply v_hat along the rays
    (paper, Fig. 9). The neutral edit changes no bit of the result.
    """
    exponent = 1.0 / (gamma0 + coefficients.gamma)
    weaker = 1.0 - edit.strength
    alpha = coefficients.alpha + weaker * (1.0 - coefficients.alpha)
    exponent = exponent + weaker * (1.0 - exponent)
    v_hat = enhance_v(v, alpha, exponent * edit.contrast)
    return v_hat * edit.exposure_gain * edit.color_gains
