# SPDX-License-Identifier: Apache-2.0
"""Cameras and sparse points from matched features, by COLMAP's two mappers.

One thread and one seed: the same matches give the same scene. Frames and pixel
coordinates are COLMAP's inside this module; poses that leave it are OpenGL.
"""

import copy
import dataclasses
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
import pycolmap
from jaxtyping import Float
from tqdm import tqdm

from internal import progress
from internal.cameras import Lens
from internal.poses import Similarity
from internal.prepare.matching import MAX_FEATURES, SEED, copy_name, view_of
from internal.prepare.room import room
from internal.scene import colmap
from internal.scene.exposures import Sighted

FEWEST_IMAGES = 3
# Photos taken by hand from one side turn less about the scene than COLMAP's 16.
INITIAL_ANGLE = 4.0  # degrees
ADJUSTMENTS = 50  # steps of the solver, at most
BYTES_PER_FEATURE = 60  # in a model: as a feature and, if it is one, as a sighting


@dataclasses.dataclass(frozen=True)
class Mapped:
    """One reconstruction; ``native`` is pycolmap's and is never changed in place."""

    native: pycolmap.Reconstruction
    views: tuple[int, ...]  # registered, sorted

    @property
    def error(self) -> float:
        """Mean reprojection error in pixels of the copies."""
        return float(self.native.compute_mean_reprojection_error())

    @property
    def points(self) -> int:
        """Number of sparse points."""
        return int(self.native.num_points3D())


def map_incrementally(database: Path, work: Path, views: int) -> list[Mapped]:
    """Adds view after view, from the best pair on; shows progress.

    Returns:
        Models, the one with most views first; none if no pair could start.
    """
    options = pycolmap.IncrementalPipelineOptions(
        num_threads=1,
        random_seed=SEED,
        min_model_size=FEWEST_IMAGES,
        extract_colors=False,
    )
    options.mapper.init_min_tri_angle = INITIAL_ANGLE
    with (
        room(work, views * MAX_FEATURES * BYTES_PER_FEATURE),
        progress.bar(views, "placing cameras", "photo") as shown,
    ):
        found = pycolmap.incremental_mapping(
            database,
            work,
            _output(work),
            options,
            next_image_callback=lambda: _advance(shown),
        )
        models = _by_size(found)
        placed = len(models[0].views) if models else 0
        shown.update(placed - shown.n)  # the first two come without a call
    return models


def map_globally(database: Path, work: Path, views: int) -> list[Mapped]:
    """Places all views at once (GLOMAP); the order of results is as above."""
    options = pycolmap.GlobalPipelineOptions(
        num_threads=1, random_seed=SEED, min_model_size=FEWEST_IMAGES
    )
    with room(work, views * MAX_FEATURES * BYTES_PER_FEATURE):
        return _by_size(pycolmap.global_mapping(database, work, _output(work), options))


def triangulate(
    database: Path,
    work: Path,
    lenses: Sequence[Lens],
    camtoworlds: Float[np.ndarray, "n 3 4"],
) -> Float[np.ndarray, "m 3"]:
    """Points that the matches show under given cameras, which stay as they are.

    Args:
        lenses: of the views' copies.
        camtoworlds: of the views, OpenGL.
    """
    posed = colmap.reconstruction(
        [copy_name(view) for view in range(len(lenses))], lenses, camtoworlds
    )
    options = pycolmap.IncrementalPipelineOptions(
        num_threads=1, random_seed=SEED, extract_colors=False
    )
    with pycolmap.Database.open(database) as opened:  # it was matched without lenses
        for camera in posed.cameras.values():
            opened.update_camera(camera)
    with room(work, len(lenses) * MAX_FEATURES * BYTES_PER_FEATURE):
        found = pycolmap.triangulate_points(
            posed, database, work, _output(work), options=options
        )
    points = [found.point3D(number).xyz for number in sorted(found.point3D_ids())]
    return np.array(points, np.float64).reshape(-1, 3)


def focals_of_copies(model: Mapped) -> dict[int, float]:
    """Focal length of each view, in pixels of its copy."""
    images = [model.native.image(number) for number in model.native.reg_image_ids()]
    return {
        view_of(image.name): float(model.native.camera(image.camera_id).focal_length)
        for image in images
    }


def own_focal_lengths(model: Mapped) -> dict[int, float]:
    """What ``focals_of_copies`` would be with a lens for each view: poses, points and
    lenses of the model are adjusted together."""
    given = model.native
    freed = pycolmap.Reconstruction()
    for number in given.reg_image_ids():
        image = given.image(number)
        own = copy.copy(given.camera(image.camera_id))
        own.camera_id = number
        freed.add_camera_with_trivial_rig(own)
        pixels = np.array([point.xy for point in image.points2D]).reshape(-1, 2)
        freed.add_image_with_trivial_frame(
            pycolmap.Image(image.name, pixels, number, number), image.cam_from_world()
        )
    for point in given.points3D.values():
        freed.add_point3D(point.xyz, point.track, point.color)
    options = pycolmap.BundleAdjustmentOptions(print_summary=False)
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.max_num_iterations = ADJUSTMENTS
    problem = pycolmap.BundleAdjustmentConfig()
    for number in freed.reg_image_ids():
        problem.add_image(number)
    problem.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    # pycolmap.bundle_adjustment does the same and turns COLMAP's log on for good.
    pycolmap.create_default_bundle_adjuster(options, problem, freed).solve()
    return focals_of_copies(Mapped(freed, model.views))


def without(model: Mapped, views: Collection[int]) -> Mapped:
    """The model without some of its views, and without points that only these saw."""
    rest = pycolmap.Reconstruction(model.native)
    for image in list(rest.images.values()):
        if image.has_pose and view_of(image.name) in views:
            rest.deregister_frame(image.frame_id)
    return Mapped(rest, tuple(view for view in model.views if view not in views))


def sighted(model: Mapped) -> dict[int, Sighted]:
    """What placed views see of the sparse points, by place among ``model.views``."""
    place = {view: index for index, view in enumerate(model.views)}
    found = {}
    for number in model.native.reg_image_ids():
        image = model.native.image(number)
        camera = model.native.camera(image.camera_id)
        seen = image.get_observation_points2D()
        pixels = np.array([point.xy for point in seen]).reshape(-1, 2)
        found[place[view_of(image.name)]] = Sighted(
            np.array([point.point3D_id for point in seen], np.int64),
            pixels / (camera.width, camera.height),
        )
    return found


def write_for_photos(
    model: Mapped,
    folder: Path,
    names: Sequence[str],
    sizes: Sequence[tuple[int, int]],
    similarity: Similarity,
) -> None:
    """Writes the model in COLMAP's binary format, for the photos themselves.

    Args:
        names: final name of each view.
        sizes: (width, height) of each view's photo; lenses and pixels are scaled
            from its copy to it.
        similarity: from the model's frame to the written one.
    """
    reconstruction = pycolmap.Reconstruction(model.native)
    sizes_by_camera = {}
    for image in reconstruction.images.values():
        view = view_of(image.name)
        camera = reconstruction.camera(image.camera_id)
        sizes_by_camera[image.camera_id] = sizes[view]
        scale = np.array(sizes[view]) / [camera.width, camera.height]
        for point in image.points2D:
            point.xy = point.xy * scale
        image.name = names[view]
    for camera_id, (width, height) in sizes_by_camera.items():
        reconstruction.camera(camera_id).rescale(width, height)
    reconstruction.transform(pycolmap.Sim3d(similarity.matrix[:3]))
    folder.mkdir(parents=True, exist_ok=True)
    with room(folder, len(names) * MAX_FEATURES * BYTES_PER_FEATURE):
        reconstruction.write_binary(str(folder))


def camera_poses(model: Mapped) -> Float[np.ndarray, "n 3 4"]:
    """OpenGL camera-to-world poses of ``model.views``."""
    images = sorted(
        (model.native.image(i) for i in model.native.reg_image_ids()),
        key=lambda image: image.name,
    )
    matrices = [image.cam_from_world().inverse().matrix() for image in images]
    return colmap.other_axes(np.stack(matrices))


def point_positions(model: Mapped) -> Float[np.ndarray, "m 3"]:
    """Positions of the sparse points."""
    ids = sorted(model.native.point3D_ids())
    return np.array([model.native.point3D(i).xyz for i in ids]).reshape(-1, 3)


def _output(work: Path) -> Path:
    """pycolmap writes what it finds; only what it returns is used."""
    folder = work / "models"
    folder.mkdir(exist_ok=True)
    return folder


def _by_size(found: dict[int, pycolmap.Reconstruction]) -> list[Mapped]:
    models = [
        Mapped(r, tuple(sorted(view_of(r.image(i).name) for i in r.reg_image_ids())))
        for r in found.values()
    ]
    return sorted(models, key=lambda m: (-len(m.views), m.error))


def _advance(shown: tqdm) -> None:
    """One more camera: an attempt that COLMAP gives up starts no second bar."""
    if shown.n < shown.total:
        shown.update()
