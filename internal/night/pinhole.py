# SPDX-License-Identifier: Apache-2.0
"""What a pinhole camera sees of a traced world: pictures and depth maps.

Frames: OpenGL; pixel (0, 0) is the top left one and its centre is (0.5, 0.5); the
principal point is the middle of the picture. Pictures are linear RGB, depths are
decimetres along the optical axis.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import ArrayLike, Float, Key

from internal.night import raytrace, shading
from internal.night.raytrace import Solids
from internal.night.shading import World

RAYS_PER_BATCH = 4096  # fits the caches


def pinhole_directions(
    camtoworld: Float[ArrayLike, "3 4"],
    focal: float | Array,
    width: int,
    height: int,
    subpixels: int,
) -> Float[Array, "3 pixels samples"]:
    """World directions of camera-frame depth 1 through ``subpixels``² points a pixel.

    Pixels run row by row from the top left one.
    """
    x = jnp.arange(0.5, width * subpixels) / subpixels - width / 2
    y = jnp.arange(0.5, height * subpixels) / subpixels - height / 2
    grid_y, grid_x = jnp.meshgrid(-y / focal, x / focal, indexing="ij")
    directions = jnp.stack([grid_x, grid_y, -jnp.ones_like(grid_x)])
    directions = directions.reshape(3, height, subpixels, width, subpixels)
    directions = directions.swapaxes(2, 3).reshape(3, height * width, subpixels**2)
    rotation = jnp.asarray(camtoworld)[:, :3, None, None]
    return jnp.sum(rotation * directions[None], axis=1)


@partial(jax.jit, static_argnames=("width", "height"))
def depth_map(
    solids: Solids,
    camtoworld: Float[ArrayLike, "3 4"],
    focal: float | Array,
    *,
    width: int,
    height: int,
) -> Float[Array, "height width"]:
    """Depth along the optical axis at pixel centres, decimetres, inf if empty."""
    directions = pinhole_directions(camtoworld, focal, width, height, 1)[..., 0]
    origin = jnp.broadcast_to(jnp.asarray(camtoworld)[:, 3:], directions.shape)
    return raytrace.nearest_hit(solids, origin, directions)[0].reshape(height, width)


@partial(jax.jit, static_argnames=("width", "height", "subpixels"))
def render(
    world: World,
    camtoworld: Float[ArrayLike, "3 4"],
    focal: float | Array,
    key: Key[Array, ""],
    *,
    width: int,
    height: int,
    subpixels: int,
) -> Float[Array, "height width 3"]:
    """One view in linear RGB, averaged over each pixel.

    Args:
        camtoworld: pose of a pinhole camera, OpenGL.
        focal: focal length in pixels.
        key: of the view, for where lamps are sampled.
        subpixels: rays per pixel along each axis.
    """
    origin = jnp.asarray(camtoworld)[:, 3:]
    lights = len(world.lamps.radii) + 1
    shifts = jax.random.uniform(key, (height * width, lights, 2))
    points = jnp.asarray(_lattice(subpixels**2))

    def pixel_rows(pixels):
        directions, shifts = pixels  # [batch, 3, samples], [batch, lights, 2]
        u = shifts[..., None] + points.T[None, None]
        u = u - jnp.floor(u)
        colors = shading.radiance(
            world,
            jnp.broadcast_to(origin, (3, directions[:, 0].size)),
            jnp.moveaxis(directions, 1, 0).reshape(3, -1),
            jnp.moveaxis(u, 0, 2).reshape(lights, 2, -1),
        )
        return colors.reshape(3, -1, subpixels**2).mean(axis=-1).T

    directions = pinhole_directions(camtoworld, focal, width, height, subpixels)
    batch = _divisor(height * width, RAYS_PER_BATCH // subpixels**2)
    batches = jax.tree.map(
        lambda leaf: leaf.reshape(-1, batch, *leaf.shape[1:]),
        (jnp.moveaxis(directions, 0, 1), shifts),
    )
    return jax.lax.map(pixel_rows, batches).reshape(height, width, 3)


def _lattice(samples: int) -> Float[np.ndarray, "samples 2"]:
    """Evenly spread points of the unit square (Roberts 2018, R2).

    Every pixel shifts the same points by its own random offset (Cranley and
    Patterson 1976), so samples are stratified within it and noise differs between.
    """
    plastic = 1.324717957244746
    steps = np.arange(samples)[:, None] / np.array([plastic, plastic**2])
    return (steps % 1.0).astype(np.float32)


def _divisor(number: int, limit: int) -> int:
    """The largest divisor of ``number`` up to ``limit``."""
    return max(d for d in range(1, max(limit, 1) + 1) if number % d == 0)
