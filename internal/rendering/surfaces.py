# SPDX-License-Identifier: Apache-2.0
"""Where the rays of a rendering end: on surfaces, or where there is nothing more."""

import numpy as np
from jaxtyping import Bool, Float

from internal.coord import Space

BACKGROUND = 0.98  # of the far depth: what ends there hit nothing


def is_background(
    depth: Float[np.ndarray, "*pixels"], far: float
) -> Bool[np.ndarray, "*pixels"]:
    """Which rays hit nothing; depths in one unit."""
    return depth >= BACKGROUND * far


def surface_points(
    space: Space,
    camtoworld: Float[np.ndarray, "3 4"],
    directions: Float[np.ndarray, "*pixels 3"],
    depth: Float[np.ndarray, "*pixels"],
) -> Float[np.ndarray, "*pixels 3"]:
    """Where rays end, from the depth that a rendering states.

    Directions are in the camera's frame.
    """
    return space.ends(camtoworld[:, 3], directions @ camtoworld[:, :3].T, depth)
