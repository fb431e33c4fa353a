# SPDX-License-Identifier: Apache-2.0
"""Colour maths of pictures: sRGB, linear light, 8-bit rounding, exposure matching.

Arrays are ``[..., 3]``. ``srgb`` is display-coded in [0, 1]; ``linear_rgb`` is
proportional to light. Every function takes NumPy or JAX arrays and returns JAX
arrays, unless its signature says NumPy.
"""

import functools

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import ArrayLike, Float, UInt8, UInt16

from internal import srgb_curve

UINT16_ONE = 65535.0  # what stored pictures hold for 1.0


def srgb_to_linear(srgb: ArrayLike) -> Float[Array, "..."]:
    """IEC 61966-2-1 decoding, sRGB in [0, 1] to linear light in [0, 1]."""
    return srgb_curve.decode(jnp.asarray(srgb), jnp)


def photo_to_linear(srgb: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """``srgb_to_linear`` of 8- or 16-bit values, in NumPy.

    By a table: large photos take a tenth of the time, and no shape is compiled for.
    """
    return _linear_levels()[to_uint16(srgb)]


def linear_to_srgb(linear_rgb: ArrayLike) -> Float[Array, "..."]:
    """IEC 61966-2-1 encoding, linear light to sRGB; values above 1 stay above 1."""
    return srgb_curve.encode(jnp.asarray(linear_rgb), jnp)


def expose(
    srgb: Float[Array, "*b 3"], gain: Float[Array, "*b 3"]
) -> Float[Array, "*b 3"]:
    """sRGB colours under ``gain`` times the linear light; 1 changes no bit."""
    exposed = linear_to_srgb(gain * srgb_to_linear(srgb))
    return jnp.where(gain == 1.0, srgb, exposed)


def to_uint8(srgb: ArrayLike) -> UInt8[np.ndarray, "..."]:
    """Clips to [0, 1] and rounds to 8 bits, as a PNG stores it."""
    return np.round(np.clip(np.asarray(srgb), 0.0, 1.0) * 255.0).astype(np.uint8)


def quantize(srgb: ArrayLike) -> Float[np.ndarray, "..."]:
    """The float32 values in [0, 1] that an 8-bit file of ``srgb`` holds."""
    return to_uint8(srgb).astype(np.float32) / 255.0


def to_uint16(srgb: Float[np.ndarray, "..."]) -> UInt16[np.ndarray, "..."]:
    """Clips to [0, 1] and rounds to 16 bits, as pictures are stored."""
    return np.round(np.clip(srgb, 0.0, 1.0) * UINT16_ONE).astype(np.uint16)


def from_uint16(levels: UInt16[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Stored pictures as float32 in [0, 1]."""
    return levels.astype(np.float32) / UINT16_ONE


@functools.cache
def _linear_levels() -> Float[np.ndarray, " levels"]:
    """Linear light of all 16-bit levels; those of 8 bits are among them."""
    return np.asarray(srgb_to_linear(from_uint16(np.arange(65536, dtype=np.uint16))))
