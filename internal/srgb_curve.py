# SPDX-License-Identifier: Apache-2.0
"""The curve of sRGB, IEC 61966-2-1: one formula, for NumPy and for JAX.

Reading photos and metering need no JAX, training needs its gradients. Both branches
are finite where the other one is taken, so gradients are, too.
"""

from typing import Any

STORED_TOE, LIGHT_TOE = 0.04045, 0.0031308  # below: a straight line
SLOPE, POWER, OFFSET = 12.92, 2.4, 0.055


def decode(srgb: Any, xp: Any) -> Any:
    """Linear light of stored values in [0, 1]; ``xp`` is ``numpy`` or ``jax.numpy``."""
    power = ((xp.maximum(srgb, STORED_TOE) + OFFSET) / (1.0 + OFFSET)) ** POWER
    return xp.where(srgb <= STORED_TOE, srgb / SLOPE, power)


def encode(linear_rgb: Any, xp: Any) -> Any:
    """The inverse of ``decode``; light above 1 stays above 1."""
    light = xp.maximum(linear_rgb, LIGHT_TOE)
    power = (1.0 + OFFSET) * light ** (1.0 / POWER) - OFFSET
    return xp.where(linear_rgb <= LIGHT_TOE, linear_rgb * SLOPE, power)
