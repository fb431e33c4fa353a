# SPDX-License-Identifier: Apache-2.0
"""Where rays meet solids: affine spheres, boxes and cylinders.

World frame: OpenGL (x right, y up, z towards the viewer), unit one decimetre.
Vectors are component-first, ``[3, rays]``: arithmetic then runs along the rays,
which a CPU vectorises. A solid is a unit shape under its own affine map; the
distance ``t`` along a ray, in lengths of its direction, is the same on both sides
of that map. Rays start outside of every solid.
"""

import jax
import jax.numpy as jnp
from flax import struct
from jax import Array
from jaxtyping import Bool, Float, Int

T_MIN = 1e-4  # decimetres: a ray does not meet the surface it starts on


@struct.dataclass
class Solids:
    """Spheres first, then boxes, then cylinders (axis y)."""

    object_from_world: Float[Array, "n 3 4"]
    half_sizes: Float[Array, "n 3"]  # decimetres
    spheres: int = struct.field(pytree_node=False)
    boxes: int = struct.field(pytree_node=False)


def hit_sphere(
    origin: Float[Array, "3 rays"], direction: Float[Array, "3 rays"]
) -> Float[Array, " rays"]:
    """Distance to the unit sphere, inf when missed."""
    a, b = dot(direction, direction), dot(origin, direction)
    discriminant = b * b - a * (dot(origin, origin) - 1.0)
    t = (-b - jnp.sqrt(jnp.maximum(discriminant, 0.0))) / a
    return jnp.where((discriminant > 0.0) & (t > T_MIN), t, jnp.inf)


def hit_box(
    origin: Float[Array, "3 rays"], direction: Float[Array, "3 rays"]
) -> Float[Array, " rays"]:
    """Distance to the cube [-1, 1]³ by the slab test, inf when missed."""
    slabs = [_slab(o, d) for o, d in zip(origin, direction, strict=True)]
    t = jnp.maximum(jnp.maximum(slabs[0][0], slabs[1][0]), slabs[2][0])
    leave = jnp.minimum(jnp.minimum(slabs[0][1], slabs[1][1]), slabs[2][1])
    return jnp.where((t <= leave) & (t > T_MIN), t, jnp.inf)


def hit_cylinder(
    origin: Float[Array, "3 rays"], direction: Float[Array, "3 rays"]
) -> Float[Array, " rays"]:
    """Distance to the capped cylinder x² + z² = 1, |y| ≤ 1, inf when missed."""
    a = direction[0] ** 2 + direction[2] ** 2 + 1e-12
    b = origin[0] * direction[0] + origin[2] * direction[2]
    discriminant = b * b - a * (origin[0] ** 2 + origin[2] ** 2 - 1.0)
    root = jnp.sqrt(jnp.maximum(discriminant, 0.0))
    cap_enter, cap_leave = _slab(origin[1], direction[1])
    t = jnp.maximum((-b - root) / a, cap_enter)
    leave = jnp.minimum((root - b) / a, cap_leave)
    return jnp.where((discriminant > 0.0) & (t <= leave) & (t > T_MIN), t, jnp.inf)


def nearest_hit(
    solids: Solids,
    origin: Float[Array, "3 rays"],
    direction: Float[Array, "3 rays"],
) -> tuple[Float[Array, " rays"], Int[Array, " rays"]]:
    """Distance to the first solid along each ray, and which; inf and 0 if none."""
    first_box, first_cylinder = solids.spheres, solids.spheres + solids.boxes
    parts = (
        (hit_sphere, slice(0, first_box)),
        (hit_box, slice(first_box, first_cylinder)),
        (hit_cylinder, slice(first_cylinder, None)),
    )
    maps = solids.object_from_world
    indices = jnp.arange(maps.shape[0])
    nearest = (jnp.full_like(origin[0], jnp.inf), jnp.zeros(origin.shape[1], jnp.int32))
    # A loop, not a vmap: XLA would compute the rays anew for every solid.
    for hit, part in parts:

        def keep_nearer(nearest, solid, hit=hit):
            affine, index = solid
            start = _linear(affine, origin) + affine[:, 3:]
            t = hit(start, _linear(affine, direction))
            nearer = t < nearest[0]
            return (
                jnp.where(nearer, t, nearest[0]),
                jnp.where(nearer, index, nearest[1]),
            ), None

        nearest, _ = jax.lax.scan(keep_nearer, nearest, (maps[part], indices[part]))
    return nearest


def is_clear(
    solids: Solids,
    origin: Float[Array, "3 rays"],
    direction: Float[Array, "3 rays"],
    reach: Float[Array, " rays"] | float,
) -> Bool[Array, " rays"]:
    """Whether nothing lies within ``reach`` along each ray."""
    return nearest_hit(solids, origin, direction)[0] >= reach


def unit_point(
    solids: Solids, index: Int[Array, " rays"], point: Float[Array, "3 rays"]
) -> Float[Array, "3 rays"]:
    """World points in the frames of their solids, which span [-1, 1] there."""
    affine = jnp.moveaxis(solids.object_from_world, 0, -1)[..., index]
    return jnp.sum(affine[:, :3] * point[None], axis=1) + affine[:, 3]


def surface_normals(
    solids: Solids, index: Int[Array, " rays"], unit: Float[Array, "3 rays"]
) -> Float[Array, "3 rays"]:
    """World-frame unit normals at points given in the frames of their solids."""
    size = jnp.abs(unit)
    box = jnp.where(size >= jnp.max(size, axis=0)[None], unit, 0.0)
    side = unit * jnp.array([1.0, 0.0, 1.0])[:, None]
    cap = unit * jnp.array([0.0, 1.0, 0.0])[:, None]
    cylinder = jnp.where((dot(cap, cap) > dot(side, side))[None], cap, side)
    is_sphere = (index < solids.spheres)[None]
    is_box = (index < solids.spheres + solids.boxes)[None]
    normal = jnp.where(is_sphere, unit, jnp.where(is_box, box, cylinder))
    linear = jnp.moveaxis(solids.object_from_world, 0, -1)[:, :3, index]
    return normalize(jnp.sum(linear * normal[:, None], axis=0))  # inverse transpose


def directions_about(
    axis: Float[Array, "3 rays"],
    cosine: Float[Array, " rays"],
    turn: Float[Array, " rays"],
) -> Float[Array, "3 rays"]:
    """Unit vectors at an angle from ``axis``, ``turn`` of a circle around it."""
    x, y, z = axis
    sign = jnp.where(z < 0.0, -1.0, 1.0)  # orthonormal basis, Duff et al. 2017
    a = -1.0 / (sign + z)
    tangent = jnp.stack([1.0 + sign * x * x * a, sign * x * y * a, -sign * x])
    bitangent = jnp.stack([x * y * a, sign + y * y * a, -y])
    sine = jnp.sqrt(jnp.maximum(1.0 - cosine**2, 0.0))[None]
    angle = 2.0 * jnp.pi * turn[None]
    sideways = tangent * jnp.cos(angle) + bitangent * jnp.sin(angle)
    return axis * cosine[None] + sine * sideways


def dot(a: Float[Array, "3 rays"], b: Float[Array, "3 rays"]) -> Float[Array, " rays"]:
    """Scalar products."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def normalize(vector: Float[Array, "3 rays"]) -> Float[Array, "3 rays"]:
    """Vectors of unit length."""
    return vector * jax.lax.rsqrt(dot(vector, vector))[None]


def _linear(affine: Float[Array, "3 4"], vector: Float[Array, "3 rays"]) -> Array:
    rows = [
        row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2] for row in affine
    ]
    return jnp.stack(rows)


def _slab(origin: Array, direction: Array) -> tuple[Array, Array]:
    """Where rays enter and leave |x| ≤ 1 of one axis."""
    inverse = 1.0 / jnp.where(jnp.abs(direction) < 1e-9, 1e-9, direction)
    middle, half = -origin * inverse, jnp.abs(inverse)
    return middle - half, middle + half
