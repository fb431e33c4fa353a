# SPDX-License-Identifier: Apache-2.0
"""What the training cameras saw of the trained scene: surfaces and their colours."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from internal import color, poses, progress
from internal.cameras import Cameras, Lens
from internal.rendering.surfaces import is_background, surface_points
from internal.scene import colmap
from internal.scene.scene import Scene, posed_cameras
from internal.structs import LitRendering, Rendering

# A point is the surface that a pixel shows if it is this near to it, as a share of
# the distance from the camera.
TOLERANCE = 0.04
BETWEEN = 3  # every so many views there is one more, half way to its neighbour
ALIKE = 0.7  # least cosine between the optical axes of neighbours

RenderView = Callable[[Cameras], Rendering | LitRendering]


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


def undistorted(scene: Scene) -> Scene:
    """The scene's views through pinholes: other tools expect them, and rendering
    through them is free."""
    lenses = tuple(map(colmap.pinhole, scene.lenses))
    camtoworlds = np.asarray(scene.cameras.camtoworlds)
    return dataclasses.replace(
        scene, lenses=lenses, cameras=posed_cameras(lenses, camtoworlds)
    )


def between_views(scene: Scene) -> Scene:
    """The scene seen from half way between neighbouring views, a third as often.

    What splats look like from where no photo was taken shows there.
    """
    camtoworlds = np.asarray(scene.cameras.camtoworlds, np.float64)
    centres = camtoworlds[:, :, 3]
    apart = np.linalg.norm(centres[:, None] - centres, axis=-1)
    # Views that look elsewhere are no neighbours, and half way there looks nowhere.
    alike = np.einsum("ni,mi->nm", camtoworlds[:, :, 2], camtoworlds[:, :, 2])
    apart[(alike < ALIKE) | np.eye(len(centres), dtype=bool)] = np.inf
    some = np.arange(0, len(centres), BETWEEN)
    some = some[np.isfinite(apart[some].min(axis=-1))]
    pairs = np.stack([some, apart[some].argmin(axis=-1)], axis=-1)
    middles = [poses.average_pose(camtoworlds[pair]) for pair in pairs]
    cameras = dataclasses.replace(
        scene.cameras.take(some),
        camtoworlds=np.array(middles, np.float32).reshape(-1, 3, 4),
    )
    lenses = tuple(scene.lenses[view] for view in some)
    return dataclasses.replace(scene, lenses=lenses, cameras=cameras)


def look_around(scene: Scene, render: RenderView) -> list[Sighting]:
    """Renders every view of an undistorted scene."""
    views = range(len(scene.lenses))
    return [
        sighting_of(scene, view, render(scene.cameras.take(np.array([view]))))
        for view in progress.track(views, len(views), "looking around", "view")
    ]


def sighting_of(
    scene: Scene, view: int, rendering: Rendering | LitRendering
) -> Sighting:
    """What a view of an undistorted scene sees, of its rendering."""
    lens = scene.lenses[view]
    camtoworld = np.asarray(scene.cameras.camtoworlds[view], np.float64)
    lit = rendering.enhanced if isinstance(rendering, LitRendering) else rendering.rgb
    depth = np.asarray(rendering.depth, np.float64)[..., 0]
    directions = colmap.lens_directions(lens).reshape(lens.height, lens.width, 3)
    far = scene.model_from_world.scale * scene.far
    points = surface_points(scene.space, camtoworld, directions, depth)
    is_surface = ~is_background(depth, far) & scene.mask(view)
    dark = color.to_uint8(rendering.rgb)
    return Sighting(lens, camtoworld, color.to_uint8(lit), dark, points, is_surface)
