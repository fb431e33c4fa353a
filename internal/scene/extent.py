# SPDX-License-Identifier: Apache-2.0
"""How far a scene reaches, and the frame in which a model is trained on it.

Depths are along a camera's optical axis in the pose file's units unless a name
says otherwise; cameras are OpenGL.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from internal import poses
from internal.cameras import Lens
from internal.coord import ForwardFacing, Space, Unbounded
from internal.errors import UserError
from internal.files.listing import say_once
from internal.scene import colmap
from internal.scene.readers.base import SceneFiles

# Depths of the sparse points a view sees: outliers are cut, then a margin is added,
# because surfaces without points may be nearer or farther.
DEPTH_PERCENTILES = (1.0, 99.0)
DEPTH_MARGIN = 1.1
FEWEST_POINTS = 8  # per view: fewer say nothing about its depth range
SEEING = 0.5  # of the views; where fewer see points, these are others'
PROJECTIONS = ("auto", "ndc", "contract")

GUESSED_NEAR, GUESSED_FAR = 0.1, 50.0  # of the distance to what cameras look at


@dataclasses.dataclass(frozen=True)
class Bounds:
    """Depths between which there is something to see."""

    near: float
    far: float
    source: str  # for messages
    guessed: bool = False  # too wide for a frustum


@dataclasses.dataclass(frozen=True)
class ModelFrame:
    """The frame a model is trained in."""

    space: Space
    model_from_world: poses.Similarity
    reason: str  # for messages


def find_bounds(
    files: SceneFiles, known: Bounds | None, near: float, far: float
) -> Bounds:
    """Near and far: as given (not 0), else as known, else from the cameras.

    Args:
        known: of ``known_bounds``; not looked at where both are given.

    Raises:
        UserError: there is no source for one of them, or they are out of order.
    """
    source, guessed = "given", False
    if not (near and far):
        found = known or _bounds_from_cameras(files)
        source = f"one given, else {found.source}" if near or far else found.source
        near, far = near or found.near, far or found.far
        guessed = found.guessed
    if not 0.0 < near < far < np.inf:
        raise UserError(
            f"{files.pose_paths[0]}: near {near:g}, far {far:g} ({source}); expected "
            "0 < near < far: set Config.near and Config.far"
        )
    return Bounds(near, far, source, guessed)


def known_bounds(
    files: SceneFiles, lenses: tuple[Lens, ...], is_train: Bool[np.ndarray, " n"]
) -> Bounds | None:
    """Near and far as the files state them or as their points tell, if either does."""
    return _bounds_from_file(files) or _bounds_from_points(files, lenses, is_train)


def _bounds_from_cameras(files: SceneFiles) -> Bounds:
    """A wide range around the place that the cameras look at, where nothing else says
    how deep the scene is; for ``contract``, whose samples are even in 1 / depth."""
    centres = files.camtoworlds[:, :, 3]
    distances = np.linalg.norm(centres - poses.focus_point(files.camtoworlds), axis=-1)
    scale = float(max(np.median(distances), np.ptp(centres, axis=0).max()))
    return Bounds(
        GUESSED_NEAR * scale,
        GUESSED_FAR * scale,
        "guessed from the cameras, for the files state no depths and have no points; "
        "Config.near and Config.far set them",
        guessed=True,
    )


def choose_frame(
    files: SceneFiles,
    lenses: tuple[Lens, ...],
    bounds: Bounds,
    projection: str,
    end_at_far: bool,
) -> ModelFrame:
    """Decides how space is parameterised, and moves the world to suit it.

    Args:
        projection: see ``scene.load_scene``; so ``end_at_far``.

    Raises:
        UserError: the projection is unknown or cannot hold these cameras.
    """
    if projection not in PROJECTIONS:
        raise UserError(
            f"unknown projection {projection!r}; choose {', '.join(PROJECTIONS)}"
        )
    if projection == "auto" and bounds.guessed:
        return _unbounded(files, bounds, "no depths are known")
    half_angle = {lens: colmap.half_angle(lens) for lens in set(lenses)}
    half_angles = np.array([half_angle[lens] for lens in lenses])
    widest = np.degrees(poses.axis_angles(files.camtoworlds).max())
    cameras = files.camtoworlds, half_angles, bounds.near
    if projection == "ndc" and not poses.fits_one_frustum(*cameras):
        raise UserError(
            f"{files.pose_paths[0]}: projection ndc needs cameras that face one way "
            f"from before the scene, but optical axes turn up to {widest:.0f} degrees "
            "from their mean or cameras pass the near plane: set "
            'Config.projection = "contract"'
        )
    chosen = "detected" if projection == "auto" else "forced"
    reason = f"{chosen}: optical axes within {widest:.0f} degrees of their mean"
    facing = projection == "auto" and poses.is_forward_facing(*cameras)
    if projection == "ndc" or facing:
        end = 1.0 - bounds.near / bounds.far if end_at_far else 1.0
        return _forward_facing(files, lenses[0], bounds.near, end, reason)
    return _unbounded(files, bounds, reason)


def _bounds_from_file(files: SceneFiles) -> Bounds | None:
    if len(files.bounds) == 0:
        return None
    near, far = float(files.bounds[:, 0].min()), float(files.bounds[:, 1].max())
    return Bounds(near, far, f"from {files.pose_paths[0].name}")


def _bounds_from_points(
    files: SceneFiles, lenses: tuple[Lens, ...], is_train: Bool[np.ndarray, " n"]
) -> Bounds | None:
    """Extremes over the training views of what each sees of the sparse points."""
    ranges = []
    for view in np.flatnonzero(is_train):
        distances = visible_distances(
            files.points, files.camtoworlds[view], lenses[view]
        )
        if len(distances) >= FEWEST_POINTS:
            ranges.append(np.percentile(distances, DEPTH_PERCENTILES))
    views = int(is_train.sum())
    if len(files.points) >= FEWEST_POINTS and len(ranges) < SEEING * views:
        say_once(
            f"WARNING: {files.pose_paths[0]}: {views - len(ranges)} of {views} cameras "
            f"see fewer than {FEWEST_POINTS} of {len(files.points)} "
            f"{files.points_source}: these and the poses hardly belong together"
        )
    if not ranges:
        return None
    nears, fars = np.transpose(ranges)
    return Bounds(
        float(nears.min() / DEPTH_MARGIN),
        float(fars.max() * DEPTH_MARGIN),
        f"from {len(files.points)} {files.points_source}",
    )


def visible_distances(
    points: Float[np.ndarray, "m 3"], camtoworld: Float[np.ndarray, "3 4"], lens: Lens
) -> Float[np.ndarray, " v"]:
    """Distances along its pixel's ray of each point that falls into the picture.

    In the ray's own units, so depth for a lens that has it, else true distance.
    """
    local = (points - camtoworld[:, 3]) @ camtoworld[:, :3]
    pixels = colmap.project(lens, local)
    inside = ((pixels >= 0.0) & (pixels < [lens.width, lens.height])).all(axis=-1)
    if colmap.has_depth(lens):
        return -local[inside, 2]
    return np.linalg.norm(local[inside], axis=-1)


def _forward_facing(
    files: SceneFiles, lens: Lens, near: float, t_far: float, reason: str
) -> ModelFrame:
    fx, fy = colmap.focal_lengths(lens)
    scale = jnp.array([2.0 * fx / lens.width, 2.0 * fy / lens.height])
    model_from_world = poses.forward_facing_frame(files.camtoworlds, near)
    return ModelFrame(ForwardFacing(scale, t_far), model_from_world, f"ndc ({reason})")


def _unbounded(files: SceneFiles, bounds: Bounds, reason: str) -> ModelFrame:
    centres = files.camtoworlds[:, :, 3]
    if np.ptp(centres, axis=0).max() == 0.0:
        raise UserError(
            f"{files.pose_paths[0]}: all cameras stand at one place, so depth cannot "
            "be seen; take photos from different places"
        )
    model_from_world = poses.unbounded_frame(files.camtoworlds)
    scale = model_from_world.scale
    space = Unbounded(jnp.float32(bounds.near * scale), jnp.float32(bounds.far * scale))
    return ModelFrame(space, model_from_world, f"contract ({reason})")
