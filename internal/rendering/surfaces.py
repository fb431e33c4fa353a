# SPDX-License-Identifier: Apache-2.0
"""Where the rays of a rendering end: on surfaces, or where there is nothing more."""

import numpy as np
from jaxtyping import Bool, Float

from internal.coord import ForwardFacing, Unbounded

BACKGROUND = 0.98  # of the far depth: what ends there hit nothing


def is_background(
    depth: Float[np.ndarray, "*pixels"], far: float
) -> Bool[np.ndarray, "*pixels"]:
    """Which rays hit nothing; depths in one unit."""
    return depth >= BACKGROUND * far


def surface_points(
    space: ForwardFacing | Unbounded,
    camtoworld: Float[np.ndarray, "3 4"],
    directions: Float[np.ndarray, "*pixels 3"],
    depth: Float[np.ndarray, "*pixels"],
) -> Float[np.ndarray, "*pixels 3"]:
    """Where rays end, from the depth that a rendering states.

    In a forward-facing space that is depth along the mean camera's axis, else
    distance in lengths of the directions, which are in the camera's frame.
    """
    world_directions = directions @ camtoworld[:, :3].T
    origin = camtoworld[:, 3]
    if isinstance(space, ForwardFacing):
        t = (-depth - origin[2]) / world_directions[..., 2]
    else:
        t = depth
    return origin + t[..., None] * world_directions
