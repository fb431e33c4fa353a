# SPDX-License-Identifier: Apache-2.0
"""Poses and lenses that cannot be meant, each seen in the scene's files alone: refused,
or warned of. ``plausible`` compares what several of them say of one place.

Poses are as the files state them: OpenGL, camera to world.
"""

import math

import numpy as np
from jaxtyping import Bool

from internal import poses
from internal.cameras import Lens
from internal.errors import UserError
from internal.files.listing import say_once
from internal.scene import colmap
from internal.scene.extent import Bounds
from internal.scene.pairing import some
from internal.scene.readers.base import SceneFiles

ROTATION_TOLERANCE = 1e-2  # hand-written JSON drifts; a mirror or a scale does not pass
SAME_PLACE = 1e-6  # of the coordinates; single precision holds no less
ALIKE = 0.05  # of a picture's sides
FAR_FROM_MIDDLE = 0.15  # likewise: farther in both axes alike is another size
STRAY = 100.0  # times the distance of half of the cameras
FEWEST_POINTS = 8  # that tell where things are
MOSTLY = 0.9  # of the cameras


def check_poses(files: SceneFiles) -> None:
    """Refuses poses that are not finite, rotated axes and a centre.

    Raises:
        UserError: naming the first bad pose's file and view.
    """
    errors = poses.rotation_errors(files.camtoworlds)
    bad = np.flatnonzero(errors > ROTATION_TOLERANCE)
    if len(bad) == 0:
        return
    first = int(bad[0])
    finite = np.isfinite(files.camtoworlds[first]).all()
    fault = "its axes are not a rotation" if finite else "it is not finite"
    raise UserError(
        f"{files.pose_paths[first]}: bad pose of {files.names[first]} ({fault}), "
        f"{len(bad)} of {len(errors)} are bad; expected unit right, up and backward "
        "axes and a centre: estimate the poses again or remove these views"
    )


def warn_of_one_place(files: SceneFiles, bounds: Bounds) -> None:
    """Says so if all photos were taken from one place: depth is then unknown. Far from
    the origin, as in maps, the depth that is known tells whether it is one."""
    centres = files.camtoworlds[:, :, 3]
    apart = np.linalg.norm(centres - centres.mean(axis=0), axis=-1).max()
    is_apart = apart > 0.0 and not bounds.guessed and apart > SAME_PLACE * bounds.far
    if not is_apart and apart <= SAME_PLACE * np.abs(centres).max(initial=0.0):
        say_once(
            f"WARNING: {files.pose_paths[0]}: all {len(centres)} cameras stand at one "
            "place, so nothing tells how far things are: take photos a step apart"
        )


def warn_of_strays(files: SceneFiles) -> None:
    """Names cameras so far from all others that their poses are a mistake: the scene
    is scaled to hold them, and the others come to stand at one place in it."""
    centres = files.camtoworlds[:, :, 3]
    apart = np.abs(centres - np.median(centres, axis=0)).max(axis=-1)
    strays = np.flatnonzero(apart > STRAY * np.median(apart)) if apart.any() else []
    names = [files.names[view] for view in strays]
    if names and np.median(apart) > 0.0:
        say_once(
            f"WARNING: {files.pose_paths[strays[0]]}: {some(names)}: more than "
            f"{STRAY:g} times as far from the middle of the cameras as half of them; "
            "if these poses are a mistake, remove their views"
        )


def warn_of_leaks(files: SceneFiles, is_test: Bool[np.ndarray, " n"]) -> None:
    """Names test views that were taken from the very pose of a training view: copies
    of its photo, of which scores tell nothing."""
    trained = {pose.tobytes() for pose in files.camtoworlds[~is_test]}
    leaks = [
        files.names[view]
        for view in np.flatnonzero(is_test)
        if files.camtoworlds[view].tobytes() in trained
    ]
    if leaks:
        say_once(
            f"WARNING: {files.pose_paths[0]}: {len(leaks)} of {is_test.sum()} test "
            f"views have the very pose of a training view: {some(leaks)}; scores of "
            "copies of training photos tell nothing"
        )


def check_lenses(files: SceneFiles) -> None:
    """Refuses lenses that COLMAP's models do not describe, or not in pixels.

    Raises:
        UserError: naming the first bad lens's file and view.
    """
    first_view = {lens: i for i, lens in reversed(list(enumerate(files.lenses)))}
    for lens, view in first_view.items():
        where = f"{files.pose_paths[view]}: {files.names[view]}"
        try:
            is_panorama = colmap.half_angle(lens) == math.pi
        except UserError as error:
            raise UserError(f"{where}: {error}") from error
        if not is_panorama:
            _check_pixels(colmap.pinhole(lens), where)


def _check_pixels(pinhole: Lens, where: str) -> None:
    """Refuses a focal length and a principal point that are in no pixels; warns of
    those that are in the pixels of a picture of another size."""
    fx, fy, cx, cy = pinhole.params
    size = pinhole.width, pinhole.height
    stated = f"{where}: focal length {fx:g}, {fy:g} and principal point {cx:g}, {cy:g}"
    across, down = cx / size[0], cy / size[1]
    if (
        min(fx / size[0], fy / size[1]) < colmap.SHORTEST
        or not 0.0 < min(across, down) <= max(across, down) < 1.0
    ):
        raise UserError(
            f"{stated} of {size[0]}x{size[1]} pixels; expected pixels, and a principal "
            "point inside the picture"
        )
    if abs(across - down) < ALIKE and abs(across - 0.5) > FAR_FROM_MIDDLE:
        say_once(
            f"WARNING: {stated} are those of {2 * cx:.0f}x{2 * cy:.0f} pixels rather "
            f"than of {size[0]}x{size[1]}: expected pixels of the stated size"
        )
    on_its_side = cx / size[1] - 0.5, cy / size[0] - 0.5
    off = max(abs(across - 0.5), abs(down - 0.5))
    if max(map(abs, on_its_side)) < ALIKE and off > FAR_FROM_MIDDLE:
        say_once(
            f"WARNING: {stated} are those of a picture that was turned, "
            f"{size[1]}x{size[0]}, rather than of {size[0]}x{size[1]}: expected the "
            "pixels of the photo as it is"
        )


def check_sides(files: SceneFiles) -> None:
    """Refuses poses under which all points lie behind nearly all cameras.

    Raises:
        UserError: axes or matrices are of another custom than the format's.
    """
    if len(files.points) < FEWEST_POINTS:
        return
    views = [view for view, lens in enumerate(files.lenses) if colmap.has_depth(lens)]
    looks = [
        ((files.points - pose[:, 3]) @ -pose[:, 2] > 0.0).any()
        for pose in files.camtoworlds[views]
    ]
    away = len(looks) - int(np.sum(looks))
    if away > MOSTLY * len(looks):
        raise UserError(
            f"{files.pose_paths[0]}: {files.points_source} lie behind {away} of "
            f"{len(looks)} cameras; expected OpenGL poses (camera to world; x right, y "
            "up, z backwards): from OpenCV's, negate the second and third column"
        )
