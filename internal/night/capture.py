# SPDX-License-Identifier: Apache-2.0
"""A camera in the dark: from linear light to the noisy 8-bit picture it stores.

Equations run in the order light takes them: ``collect``, ``photon_noise``,
``read_noise``, ``apply_gains``, then clip, sRGB curve and 8-bit rounding
(``to_photo``). ``linear_rgb`` is ``[..., 3]`` linear light in which 1 is the white of
the normal-light picture, for which the sensor counts ``full_well`` electrons. Keys
go in, arrays come out: nothing else is random.
"""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import ArrayLike, Float, Key, UInt8

from internal import color
from internal.errors import UserError


@dataclasses.dataclass(frozen=True)
class CaptureModel:
    """How dark, how noisy and how tinted a capture is.

    Raises:
        UserError: a level is negative, zero where light is needed, or NaN.
    """

    exposure: float = 1 / 30  # light relative to the normal-light picture
    full_well: float = 10_000.0  # photo-electrons at white; inf: no noise at all
    read_noise: float = 3.0  # standard deviation, electrons
    channel_gains: tuple[float, float, float] = (1.0, 0.94, 0.84)  # colour cast
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("exposure", "full_well", "channel_gains"):
            if not np.all(np.asarray(getattr(self, name)) > 0):
                raise UserError(f"{name} must be positive: {getattr(self, name)}")
        if not self.read_noise >= 0:
            raise UserError(f"read_noise must not be negative: {self.read_noise}")


NORMAL_LIGHT = CaptureModel(
    exposure=1.0, full_well=math.inf, read_noise=0.0, channel_gains=(1.0, 1.0, 1.0)
)


def view_key(model: CaptureModel, view: int) -> Key[Array, ""]:
    """The key of one view's noise: the same view gets the same noise every time."""
    return jax.random.fold_in(jax.random.key(model.seed), view)


def collect(linear_rgb: ArrayLike, exposure: float) -> Float[Array, "..."]:
    """Linear light that falls in during ``exposure`` of the normal-light time."""
    return jnp.asarray(linear_rgb) * exposure


def photon_noise(
    linear_rgb: ArrayLike, full_well: float, key: Key[Array, ""]
) -> Float[Array, "..."]:
    """Shot noise: Poisson(linear_rgb · full_well) / full_well."""
    electrons = jnp.asarray(linear_rgb) * full_well
    return jax.random.poisson(key, electrons).astype(jnp.float32) / full_well


def read_noise(
    linear_rgb: ArrayLike, electrons: float, full_well: float, key: Key[Array, ""]
) -> Float[Array, "..."]:
    """Adds Normal(0, electrons²) / full_well, the noise of reading the sensor."""
    linear_rgb = jnp.asarray(linear_rgb)
    return linear_rgb + jax.random.normal(key, linear_rgb.shape) * (
        electrons / full_well
    )


def apply_gains(
    linear_rgb: ArrayLike, channel_gains: tuple[float, float, float]
) -> Float[Array, "..."]:
    """The colour cast: red, green and blue times their gains."""
    return jnp.einsum("...c,c->...c", jnp.asarray(linear_rgb), jnp.array(channel_gains))


def sense(
    linear_rgb: Float[ArrayLike, "*batch 3"], model: CaptureModel, key: Key[Array, ""]
) -> Float[Array, "*batch 3"]:
    """Linear light as the sensor reports it, before clipping and the sRGB curve.

    The mean is ``exposure · gain · linear_rgb`` and the variance is
    ``gain² · (exposure · linear_rgb / full_well + (read_noise / full_well)²)``.
    """
    photon_key, read_key = jax.random.split(key)
    light = collect(linear_rgb, model.exposure)
    if math.isfinite(model.full_well):
        light = photon_noise(light, model.full_well, photon_key)
        light = read_noise(light, model.read_noise, model.full_well, read_key)
    return apply_gains(light, model.channel_gains)


def to_photo(linear_rgb: Float[ArrayLike, "*batch 3"]) -> UInt8[np.ndarray, "*batch 3"]:
    """Clips to [0, 1], applies the sRGB curve and rounds to 8 bits."""
    return color.to_uint8(color.linear_to_srgb(jnp.clip(jnp.asarray(linear_rgb), 0, 1)))


def capture(
    linear_rgb: Float[ArrayLike, "*batch 3"], model: CaptureModel, key: Key[Array, ""]
) -> UInt8[np.ndarray, "*batch 3"]:
    """The 8-bit sRGB picture that a camera stores of ``linear_rgb``.

    Args:
        linear_rgb: linear light, 1 is the white of the normal-light picture.
        model: exposure, noise and cast.
        key: of this view, from ``view_key``.
    """
    return to_photo(sense(linear_rgb, model, key))
