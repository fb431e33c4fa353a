# SPDX-License-Identifier: Apache-2.0
"""Whether cameras, depths, points and splits of a scene can be of one frame and unit.

Files of one scene come from several programs: metres beside millimetres, test poses in
another frame. Nothing fails then, the training shows fog. Poses are as the files state
them; depths are along a camera's optical axis.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from internal import poses
from internal.cameras import Lens
from internal.errors import UserError
from internal.files.listing import say_once
from internal.scene import colmap
from internal.scene.extent import Bounds
from internal.scene.readers.base import SceneFiles

LOOKING = 0.8  # of the cameras: then what they look at is the scene
FEWEST = 4  # cameras that tell what they look at
BEYOND = 5.0  # times the distance of what cameras look at
OUTSIDE = 1.5  # times beyond the nearest or farthest training camera, seen from there
ASIDE = np.radians(20.0)  # more than all training cameras
ONE_PLACE = 100.0  # times the cameras' distances: no parallax to speak of
FEWEST_POINTS = 100  # that are compared
ALIKE = 0.02  # of the distance to the cameras
TWICE = 2.0  # as far from a cloud as from as many points of the photos


@dataclasses.dataclass(frozen=True)
class _Target:
    """What cameras look at, as each sees it."""

    place: Float[np.ndarray, " 3"]
    distances: Float[np.ndarray, " n"]
    angles: Float[np.ndarray, " n"]  # from the optical axis, radians


def check_depths(
    files: SceneFiles,
    lenses: tuple[Lens, ...],
    bounds: Bounds,
    is_train: Bool[np.ndarray, " n"],
) -> None:
    """Compares the depth range with where the training cameras are. Warns of one that
    what they look at is far outside of.

    Raises:
        UserError: no two of most cameras see anything in common within it.
    """
    if bounds.guessed or is_train.sum() < 2:
        return
    camtoworlds = files.camtoworlds[is_train]
    centres = camtoworlds[:, :, 3]
    widest = max(colmap.half_angle(lens) for lens in set(lenses))
    # With depth, a ray at the border is longer than its depth.
    reach = bounds.far / np.cos(min(widest, np.radians(80.0)))
    apart = KDTree(centres).query(centres, k=2)[0][:, 1]
    stated = f"{files.pose_paths[0]}: near {bounds.near:.4g}, far {bounds.far:.4g} "
    stated += f"({bounds.source})"
    units = "expected depths in the units of the poses: set Config.near and Config.far"
    if np.median(apart) > 2.0 * reach:
        raise UserError(
            f"{stated}, but the cameras stand {np.median(apart):.4g} and more from "
            f"each other: no two see the same thing; {units}"
        )
    spread = np.linalg.norm(np.ptp(centres, axis=0))
    target = _target(camtoworlds, widest)
    seen = float(np.median(target.distances)) if target else 0.0
    if target and (bounds.near > BEYOND * seen or bounds.far < seen / BEYOND):
        say_once(
            f"WARNING: {stated}, but the cameras look at one place {seen:.4g} before "
            f"them; {units}"
        )
    elif 0.0 < spread < bounds.near / ONE_PLACE:
        say_once(
            f"WARNING: {stated}, but all cameras stand within {spread:.4g}: as good as "
            f"at one place; {units}"
        )


def warn_of_other_frame(
    files: SceneFiles, lenses: tuple[Lens, ...], is_test: Bool[np.ndarray, " n"]
) -> None:
    """Says so if test cameras stand or look elsewhere than all training cameras: their
    poses may be in another frame or unit, and then scores tell nothing."""
    train, test = files.camtoworlds[~is_test], files.camtoworlds[is_test]
    if len(train) < FEWEST or not len(test):
        return
    target = _target(train, max(colmap.half_angle(lens) for lens in set(lenses)))
    if target:
        own = _seen(target.place, test)
        far, aside = np.median(own.distances), np.median(own.angles)
        is_other = (
            not target.distances.min() / OUTSIDE
            <= far
            <= OUTSIDE * target.distances.max()
            or aside > target.angles.max() + ASIDE
        )
    else:
        centres = train[:, :, 3]
        extent = np.linalg.norm(np.ptp(centres, axis=0))
        apart = KDTree(centres).query(test[:, :, 3])[0]
        is_other = np.median(apart) > max(extent, np.finfo(float).tiny)
    if is_other:
        path = files.pose_paths[int(np.flatnonzero(is_test)[0])]
        say_once(
            f"WARNING: {path}: its test cameras stand or look elsewhere than all "
            "training cameras; if their poses are in another frame or unit, scores "
            "tell nothing: prepare.py --check asks the photos"
        )


def cloud_fault(files: SceneFiles, found: Float[np.ndarray, "m 3"]) -> str:
    """Why the points of the files are not where the photos show some, "" if they are.

    Each cloud is looked for in the other: one may hold a part of the scene alone. How
    far points of one cloud lie apart is what a part of those of the photos has to the
    rest of them.

    Args:
        found: in the photos, with the poses of the files.
    """
    if min(len(found), len(files.points)) < FEWEST_POINTS:
        return ""
    order = np.random.default_rng(0).permutation(len(found))
    half = len(found) // 2
    kept, held_out = found[order[:half]], found[order[half:]]
    centres = files.camtoworlds[:, :, 3]
    usual = _apart(held_out, kept[: len(files.points)], centres)
    every = -(-len(files.points) // len(found))
    off = min(
        _apart(found, files.points, centres),
        _apart(files.points[::every], found, centres),
    )
    if off <= max(ALIKE, TWICE * usual):
        return ""
    return (
        f"{files.points_source} are {off:.1%} of their distance off those that the "
        f"photos show with the poses (these lie {usual:.1%} apart): turned, scaled or "
        "of another scene; export them in the frame of the poses, or leave them out"
    )


def _apart(
    points: Float[np.ndarray, "m 3"],
    others: Float[np.ndarray, "k 3"],
    centres: Float[np.ndarray, "n 3"],
) -> float:
    """The median distance to the nearest of the others over that to the cameras."""
    nearest = KDTree(others).query(points)[0]
    middle = np.median(centres, axis=0)
    spread = np.median(np.linalg.norm(centres - middle, axis=-1))
    distances = np.maximum(np.linalg.norm(points - middle, axis=-1), spread)
    return float(np.median(nearest / np.maximum(distances, np.finfo(float).tiny)))


def _target(camtoworlds: Float[np.ndarray, "n 3 4"], widest: float) -> _Target | None:
    """What most of the cameras look at; None if they look at different things."""
    if len(camtoworlds) < FEWEST:
        return None
    target = _seen(poses.focus_point(camtoworlds), camtoworlds)
    is_seen = target.angles < widest
    return target if is_seen.mean() >= LOOKING else None


def _seen(
    place: Float[np.ndarray, " 3"], camtoworlds: Float[np.ndarray, "n 3 4"]
) -> _Target:
    """A place as cameras see it."""
    towards = place - camtoworlds[:, :, 3]
    distances = np.linalg.norm(towards, axis=-1)
    along = -(towards * camtoworlds[:, :, 2]).sum(axis=-1)
    cosines = along / np.maximum(distances, np.finfo(float).tiny)
    return _Target(place, distances, np.arccos(np.clip(cosines, -1.0, 1.0)))
