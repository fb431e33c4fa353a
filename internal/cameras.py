# SPDX-License-Identifier: Apache-2.0
"""Cameras and the rays they see.

Frames: OpenGL everywhere (x right, y up, z towards the viewer). A lens is a table of
directions in the camera's own frame, so every lens model costs the same and photos are
never resampled: distortion bends the rays. A table has ``NODES`` by ``NODES`` rows, the
corners among them the centres of the corner pixels; between them directions are linear,
which is exact for a pinhole and within a twentieth of a pixel for others (tested). A
table takes 200 kB whatever the photo's size, so each photo may have a lens of its own.
Cameras that share a lens share its table; all lie end to end in one flat array, which
lets pictures of different sizes live in one scene.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import Array
from jaxtyping import Float, Int

from internal.coord import Space

NODES = 129  # of a lens table, along each side


@dataclasses.dataclass(frozen=True)
class Lens:
    """A COLMAP camera: model name, picture size in pixels, parameters in pixels.

    Pixel (0, 0) is the top-left pixel and its centre is (0.5, 0.5).
    """

    model: str
    width: int
    height: int
    params: tuple[float, ...]


@struct.dataclass
class Cameras:
    """Posed cameras of ``n`` views over ``k`` rows of lens tables."""

    camtoworlds: Float[Array | np.ndarray, "n 3 4"]
    directions: Float[Array | np.ndarray, "k 3"]  # camera frame, not unit length
    table_starts: Int[Array | np.ndarray, " n"]  # first row of each view's lens
    widths: Int[Array | np.ndarray, " n"]  # pixels
    heights: Int[Array | np.ndarray, " n"]  # pixels

    def __len__(self) -> int:
        return self.camtoworlds.shape[0]

    def take(self, views: np.ndarray) -> "Cameras":
        """The cameras of ``views`` alone; lens tables are kept."""
        return dataclasses.replace(
            self,
            camtoworlds=self.camtoworlds[views],
            table_starts=self.table_starts[views],
            widths=self.widths[views],
            heights=self.heights[views],
        )


@struct.dataclass
class Rays:
    """Rays in the space they are sampled in; ``directions`` are not unit length."""

    origins: Float[Array, "*batch 3"]
    directions: Float[Array, "*batch 3"]
    viewdirs: Float[Array, "*batch 3"]  # unit, world frame
    radii: Float[Array, "*batch 1"]  # of the cone at t = 1 (mip-NeRF Sec. 3.1)


def node_positions(size: int) -> Float[np.ndarray, " nodes"]:
    """Where the nodes of a table lie along a side of ``size`` pixels, in pixels."""
    return np.linspace(0.5, size - 0.5, NODES)


def pixel_directions(
    cameras: Cameras,
    view: Int[Array, "*batch"],
    x: Int[Array, "*batch"],
    y: Int[Array, "*batch"],
) -> tuple[Float[Array, "*batch 3"], Float[Array, "*batch 3"]]:
    """World-frame (origins, directions) through the centres of pixels (x, y)."""
    column, right = _between_nodes(x, cameras.widths[view])
    row, down = _between_nodes(y, cameras.heights[view])
    node = cameras.table_starts[view] + row * NODES + column
    above, below = (
        (1.0 - right) * cameras.directions[first]
        + right * cameras.directions[first + 1]
        for first in (node, node + NODES)
    )
    local = (1.0 - down) * above + down * below
    camtoworld = cameras.camtoworlds[view]
    directions = jnp.einsum("...ij,...j->...i", camtoworld[..., :3], local)
    return camtoworld[..., 3], directions


def _between_nodes(
    pixel: Int[Array, "*batch"], size: Int[Array, "*batch"]
) -> tuple[Int[Array, "*batch"], Float[Array, "*batch 1"]]:
    """The node before a pixel's centre, and how far it is on to the next, 0 to 1."""
    apart = (NODES - 1) / jnp.maximum(size - 1, 1)
    place = jnp.asarray(pixel).astype(apart.dtype) * apart
    node = jnp.minimum(place.astype(jnp.int32), NODES - 2)
    return node, (place - node.astype(place.dtype))[..., None]


def cast_rays(
    cameras: Cameras,
    space: Space,
    view: Int[Array, "*batch"],
    x: Int[Array, "*batch"],
    y: Int[Array, "*batch"],
) -> Rays:
    """Casts the cones of pixels (x, y) into ``space``.

    A cone's radius comes from the distance to the neighbouring pixels' rays at
    t = 1: the mean of right and down, times 2 / sqrt(12), so that a cone has the
    variance of its square pixel (mip-NeRF Sec. 3.1).
    """
    beside = jnp.where(x + 1 < cameras.widths[view], x + 1, x - 1)
    below = jnp.where(y + 1 < cameras.heights[view], y + 1, y - 1)
    world_origins, world_directions = pixel_directions(cameras, view, x, y)
    origins, directions = space.enter(world_origins, world_directions)
    ends = origins + directions

    def spacing(other_x: Array, other_y: Array) -> Array:
        entered = space.enter(*pixel_directions(cameras, view, other_x, other_y))
        return jnp.linalg.norm(sum(entered) - ends, axis=-1, keepdims=True)

    radii = (spacing(beside, y) + spacing(x, below)) / jnp.sqrt(12.0)
    norms = jnp.linalg.norm(world_directions, axis=-1, keepdims=True)
    return Rays(origins, directions, world_directions / norms, radii)
