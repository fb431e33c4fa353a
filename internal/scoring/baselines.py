# SPDX-License-Identifier: Apache-2.0
"""Trivial ways to brighten a dark rendering, which the method has to beat.

Pictures are ``[height, width, 3]`` sRGB float in [0, 1]; masks are True where a pixel
counts.
"""

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from internal.color import linear_to_srgb, srgb_to_linear
from internal.scene.masks import ALL

MAX_STOPS = 16.0
BISECTIONS = 32


def gain_to_mean(
    dark_srgb: Float[Array | np.ndarray, "height width 3"],
    mean: float = 0.5,
    mask: Bool[np.ndarray, "#height #width"] = ALL,
) -> Float[Array, "height width 3"]:
    """One gain in linear light after which the clipped picture's sRGB mean is ``mean``,
    over the pixels that count.

    A picture too black to get there is brightened by ``MAX_STOPS`` stops, a
    picture too bright is darkened by as many.
    """
    linear_rgb = srgb_to_linear(dark_srgb)
    counted = linear_rgb[np.broadcast_to(mask, dark_srgb.shape[:2])]

    def exposed(
        linear_rgb: Float[Array, "*pixels 3"], stops: float
    ) -> Float[Array, "*pixels 3"]:
        return jnp.clip(linear_to_srgb(linear_rgb * 2.0**stops), 0.0, 1.0)

    low, high = -MAX_STOPS, MAX_STOPS
    for _ in range(BISECTIONS):
        middle = (low + high) / 2.0
        too_dark = exposed(counted, middle).mean() < mean
        low, high = (middle, high) if too_dark else (low, middle)
    return exposed(linear_rgb, high)


def gamma_curve(
    dark_srgb: Float[Array | np.ndarray, "height width 3"], exponent: float = 2.2
) -> Float[Array, "height width 3"]:
    """``srgb ** (1 / exponent)``, with no regard for noise or colour."""
    return jnp.clip(jnp.asarray(dark_srgb), 0.0, 1.0) ** (1.0 / exponent)
