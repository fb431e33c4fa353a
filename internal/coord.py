# SPDX-License-Identifier: Apache-2.0
"""Spaces in which a ray is sampled and encoded.

``s`` is normalised distance in [0, 1] along a ray, ``t`` is distance in the units
of the ray's direction vector, so that a sample sits at ``origin + t * direction``.
A *space* says how world-frame rays enter it, how s becomes t, how a Gaussian is
warped before it is encoded, and how far away t is in scene units. Export and viewer ask
it for single points, in NumPy.
"""

from typing import ClassVar, Protocol, runtime_checkable

import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import Array
from jaxtyping import Float

from internal import mip

NEAR_INFINITY = 1e-3  # in a space: points closer to it are put there


@runtime_checkable
class Space(Protocol):
    """What the sampler and the field need to know about a scene's extent."""

    faces_one_way: ClassVar[bool]  # through one window, where pixels do not widen

    def enter(
        self, origins: Float[Array, "*b 3"], directions: Float[Array, "*b 3"]
    ) -> tuple[Float[Array, "*b 3"], Float[Array, "*b 3"]]:
        """Carries rays from the world into this space."""
        ...

    def s_to_t(self, s: Float[Array, "*b"]) -> Float[Array, "*b"]:
        """Normalised distance to distance along the ray."""
        ...

    def warp(
        self,
        mean: Float[Array, "*b 3"],
        directions: Float[Array, "*b 3"],
        t_var: Float[Array, "*b 1"],
        r_var: Float[Array, "*b 1"],
    ) -> tuple[Float[Array, "*b 3"], Float[Array, "*b 3"]]:
        """Means and per-axis variances of Gaussians along rays, where the encoding
        looks them up. ``t_var`` is along the ray (in units of t), ``r_var`` across."""
        ...

    def gradient_share(self, t: Float[Array, "*b"], reach: float) -> Float[Array, "*b"]:
        """The part of its gradient that a sample at t learns by.

        A camera asks for what is near to it by many more rays than for what is far, so
        haze in front of it is learned first. By the square of the distance all places
        learn alike (Philip and Deschaintre, Floaters No More, EGSR 2023).

        Args:
            reach: from there on it is all of it, in distances of the nearest sample.
        """
        ...

    def depth(self, t: Float[Array, "*b"]) -> Float[Array, "*b"]:
        """Depth along the camera's axis in scene units."""
        ...

    def ends(
        self,
        origin: Float[np.ndarray, " 3"],
        directions: Float[np.ndarray, "*b 3"],
        depth: Float[np.ndarray, "*b"],
    ) -> Float[np.ndarray, "*b 3"]:
        """Where world-frame rays are at a ``depth`` as stated above."""
        ...

    def to_field(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """From the model's frame to where the field looks points up."""
        ...

    def from_field(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """The inverse of ``to_field``; infinity becomes far away."""
        ...


@struct.dataclass
class ForwardFacing:
    """Normalised device coordinates: the frustum becomes a cube (NeRF App. C).

    ``scale`` is (2 fx / width, 2 fy / height); the near plane is at depth 1. Rays end
    at ``t_far``: 1 is infinity, 1 - 1 / z is depth z.
    """

    faces_one_way: ClassVar[bool] = True

    scale: Float[Array | np.ndarray, " 2"]
    t_far: float = struct.field(default=1.0, pytree_node=False)

    def enter(
        self, origins: Float[Array, "*b 3"], directions: Float[Array, "*b 3"]
    ) -> tuple[Float[Array, "*b 3"], Float[Array, "*b 3"]]:
        return world_to_ndc(origins, directions, jnp.asarray(self.scale))

    def s_to_t(self, s: Float[Array, "*b"]) -> Float[Array, "*b"]:
        return s * self.t_far

    def warp(
        self,
        mean: Float[Array, "*b 3"],
        directions: Float[Array, "*b 3"],
        t_var: Float[Array, "*b 1"],
        r_var: Float[Array, "*b 1"],
    ) -> tuple[Float[Array, "*b 3"], Float[Array, "*b 3"]]:
        return mean, mip.lift_variance(directions, t_var, r_var)

    def gradient_share(self, t: Float[Array, "*b"], reach: float) -> Float[Array, "*b"]:
        """All of it: rays of this space are as dense in front as behind."""
        return jnp.ones_like(t)

    def depth(self, t: Float[Array, "*b"]) -> Float[Array, "*b"]:
        return 1.0 / jnp.maximum(1.0 - t, NEAR_INFINITY)

    def ends(
        self,
        origin: Float[np.ndarray, " 3"],
        directions: Float[np.ndarray, "*b 3"],
        depth: Float[np.ndarray, "*b"],
    ) -> Float[np.ndarray, "*b 3"]:
        """Depth is along the axis of all cameras' mean."""
        t = (-depth - origin[2]) / directions[..., 2]
        return origin + t[..., None] * directions

    def to_field(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        x, y, z = points.T
        scale_x, scale_y = np.asarray(self.scale, np.float64)
        return np.stack([-scale_x * x / z, -scale_y * y / z, 1.0 + 2.0 / z], axis=-1)

    def from_field(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        x, y, z_ndc = points.T
        scale_x, scale_y = np.asarray(self.scale, np.float64)
        z = 2.0 / np.minimum(z_ndc - 1.0, -NEAR_INFINITY)
        return np.stack([-x * z / scale_x, -y * z / scale_y, z], axis=-1)


@struct.dataclass
class Unbounded:
    """World coordinates between ``near`` and ``far``, sampled evenly in 1 / t and
    contracted into a ball of radius 2 (mip-NeRF 360 Eq. 10)."""

    faces_one_way: ClassVar[bool] = False

    near: Float[Array | np.ndarray | np.floating, ""]
    far: Float[Array | np.ndarray | np.floating, ""]

    def enter(
        self, origins: Float[Array, "*b 3"], directions: Float[Array, "*b 3"]
    ) -> tuple[Float[Array, "*b 3"], Float[Array, "*b 3"]]:
        return origins, directions

    def s_to_t(self, s: Float[Array, "*b"]) -> Float[Array, "*b"]:
        """Even in 1 / t between the ends (mip-NeRF 360 Eq. 11)."""
        return 1.0 / (s / self.far + (1.0 - s) / self.near)

    def warp(
        self,
        mean: Float[Array, "*b 3"],
        directions: Float[Array, "*b 3"],
        t_var: Float[Array, "*b 1"],
        r_var: Float[Array, "*b 1"],
    ) -> tuple[Float[Array, "*b 3"], Float[Array, "*b 3"]]:
        return contract(mean), contracted_variance(mean, directions, t_var, r_var)

    def gradient_share(self, t: Float[Array, "*b"], reach: float) -> Float[Array, "*b"]:
        return jnp.clip(t / (reach * self.near), 0.0, 1.0) ** 2

    def depth(self, t: Float[Array, "*b"]) -> Float[Array, "*b"]:
        return t

    def ends(
        self,
        origin: Float[np.ndarray, " 3"],
        directions: Float[np.ndarray, "*b 3"],
        depth: Float[np.ndarray, "*b"],
    ) -> Float[np.ndarray, "*b 3"]:
        """Depth is in lengths of the directions."""
        return origin + depth[..., None] * directions

    def to_field(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        return np.asarray(contract(jnp.asarray(points, jnp.float32)), np.float64)

    def from_field(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        radius = np.linalg.norm(points, axis=-1, keepdims=True)
        beyond = np.maximum(radius, 1.0) * np.maximum(2.0 - radius, NEAR_INFINITY)
        return np.where(radius > 1.0, points / beyond, points)


def world_to_ndc(
    origins: Float[Array, "*b 3"],
    directions: Float[Array, "*b 3"],
    scale: Float[Array, " 2"],
) -> tuple[Float[Array, "*b 3"], Float[Array, "*b 3"]]:
    """Rays in OpenGL world frame to NDC (exact for any centre): origin NeRF Eq. 25,
    direction NeRF Eq. 26.

    The new origin is where the ray meets the near plane z = -1 (t = 0) and the new
    end, at t = 1, is its point at infinity.
    """
    t = -(1.0 + origins[..., 2:]) / directions[..., 2:]
    origins = origins + t * directions
    ox, oy, oz = jnp.moveaxis(origins, -1, 0)
    dx, dy, dz = jnp.moveaxis(directions, -1, 0)
    origins_ndc = jnp.stack(
        [-scale[0] * ox / oz, -scale[1] * oy / oz, -jnp.ones_like(oz)], axis=-1
    )
    infinity_ndc = jnp.stack(
        [-scale[0] * dx / dz, -scale[1] * dy / dz, jnp.ones_like(oz)], axis=-1
    )
    return origins_ndc, infinity_ndc - origins_ndc


def contract(x: Float[Array, "*b 3"]) -> Float[Array, "*b 3"]:
    """Identity inside the unit ball, (2 - 1/|x|) x/|x| outside (mip-NeRF 360 Eq. 10).

    The norm is floored at 1 inside the square root, so the gradient is finite at 0.
    """
    squared = jnp.maximum(jnp.sum(x**2, axis=-1, keepdims=True), 1.0)
    return x * (2.0 * jnp.sqrt(squared) - 1.0) / squared


def contracted_variance(
    mean: Float[Array, "*b 3"],
    directions: Float[Array, "*b 3"],
    t_var: Float[Array, "*b 1"],
    r_var: Float[Array, "*b 1"],
) -> Float[Array, "*b 3"]:
    """Per-axis variance of contracted Gaussians to first order (mip-NeRF 360 Eq. 9).

    The Jacobian of ``contract`` is a I + b x x^T and the covariance along a ray is
    c d d^T + r_var I, so the diagonal of J Sigma J^T needs no matrix.
    """
    squared = jnp.maximum(jnp.sum(mean**2, axis=-1, keepdims=True), 1.0)
    norm = jnp.sqrt(squared)
    a = (2.0 * norm - 1.0) / squared
    b = 2.0 * (1.0 - norm) / squared**2
    along = jnp.sum(mean * directions, axis=-1, keepdims=True)
    warped_directions = a * directions + b * along * mean
    c = t_var - r_var / jnp.sum(directions**2, axis=-1, keepdims=True)
    across = a**2 + (2.0 * a * b + b**2 * squared) * mean**2
    return c * warped_directions**2 + r_var * across
