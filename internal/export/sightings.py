# SPDX-License-Identifier: Apache-2.0
"""What the training cameras saw of the trained scene: surfaces and their colours."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from internal.cameras import Lens
from internal.scene import colmap

# A point is the surface that a pixel shows if it is this near to it, as a share of
# the distance from the camera.
TOLERANCE = 0.04


@dataclasses.dataclass(frozen=True)
class Sighting:
    """A rendered view: where its pixels' rays end, and in what colour."""

    lens: Lens
    camtoworld: Float[np.ndarray, "3 4"]
    srgb: UInt8[np.ndarray, "height width 3"]  # lit
    dark_srgb: UInt8[np.ndarray, "height width 3"]  # as photographed
    points: Float[np.ndarray, "height width 3"]
    is_surface: Bool[np.ndarray, "height width"]  # not background nor masked

    @property
    def looks(self) -> dict[str, UInt8[np.ndarray, "height width 3"]]:
        """The pictures by the name that a user gives them."""
        return {"enhanced": self.srgb, "dark": self.dark_srgb}


def find_seen(
    points: Float[np.ndarray, "n 3"], sighting: Sighting
) -> tuple[Int[np.ndarray, " seen"], UInt8[np.ndarray, "seen 3"]]:
    """Which points are the surface that a view shows, and their colours in it."""
    centre = sighting.camtoworld[:, 3]
    local = (points - centre) @ sighting.camtoworld[:, :3]
    pixels = colmap.project(sighting.lens, local)
    size = [sighting.lens.width, sighting.lens.height]
    index = np.flatnonzero(((pixels >= 0.0) & (pixels < size)).all(axis=-1))
    column, row = pixels[index].astype(int).T
    apart = np.linalg.norm(sighting.points[row, column] - points[index], axis=-1)
    distance = np.linalg.norm(local[index], axis=-1)
    hit = sighting.is_surface[row, column] & (apart < TOLERANCE * distance)
    return index[hit], sighting.srgb[row[hit], column[hit]]


def mean_colors(
    points: Float[np.ndarray, "n 3"], sightings: Sequence[Sighting]
) -> tuple[Int[np.ndarray, " n"], UInt8[np.ndarray, "n 3"]]:
    """In how many views each point is seen, and its mean colour there."""
    counts = np.zeros(len(points), int)
    sums = np.zeros((len(points), 3))
    for sighting in sightings:
        index, colors = find_seen(points, sighting)
        counts[index] += 1
        sums[index] += colors
    mean = sums / np.maximum(counts, 1)[:, None]
    return counts, np.round(mean).astype(np.uint8)
