# SPDX-License-Identifier: Apache-2.0
"""The frame a prepared scene is written in: z up, points around 0, a handy size.

Structure-from-motion knows neither up nor metres. Poses are OpenGL camera-to-world.
"""

import numpy as np
from jaxtyping import Float

from internal.poses import Similarity

# Median distance from the cameras to the scene's middle, as in LOM and instant-ngp.
DISTANCE = 4.0
_TURNED_AWAY = 1e-6  # length of a mean axis that says nothing


def scene_frame(
    camtoworlds: Float[np.ndarray, "n 3 4"], points: Float[np.ndarray, "m 3"]
) -> Similarity:
    """Similarity that levels, centres and scales a scene.

    Up (z) is the mean up axis of the cameras, y where they look on the whole; the
    median point goes to 0 and the median camera to ``DISTANCE`` from it.

    Args:
        points: at least one.
    """
    up = _unit(camtoworlds[:, :, 1].sum(axis=0), np.array([0.0, 0.0, 1.0]))
    ahead = -camtoworlds[:, :, 2].sum(axis=0)
    ahead = _unit(ahead - (ahead @ up) * up, _any_across(up))
    rotation = np.stack([np.cross(ahead, up), ahead, up])
    origin = np.median(points, axis=0)
    distances = np.linalg.norm(camtoworlds[:, :, 3] - origin, axis=-1)
    scale = DISTANCE / float(np.median(distances))
    return Similarity.about(origin, scale, rotation)


def _any_across(axis: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    """A unit vector across a unit vector."""
    smallest = np.eye(3)[np.argmin(np.abs(axis))]
    across = np.cross(axis, smallest)
    return across / np.linalg.norm(across)


def _unit(
    vector: Float[np.ndarray, " 3"], otherwise: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " 3"]:
    length = float(np.linalg.norm(vector))
    return vector / length if length > _TURNED_AWAY else otherwise
