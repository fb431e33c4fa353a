# SPDX-License-Identifier: Apache-2.0
"""Camera trajectories for videos.

Poses are ``camtoworlds`` ``[n, 3, 4]`` float64 in the OpenGL frame (x right, y up,
z towards the viewer): the columns are the camera's axes and its position, in
world units. A path lies in the frame of the poses it is made from.
"""

import itertools
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import PchipInterpolator, interp1d
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, RotationSpline

from internal.errors import UserError
from internal.files.atomic import write_text
from internal.poses import average_pose, focus_point

FEWEST_AROUND = 8  # views: fewer say nothing about what lies between them
CLOSE = 0.5
LEVEL = 0.1  # rights of views that are held level spread so much less along up
CLEAR = 0.5  # mean cosine between the ups of views and up
TOUR_POINTS = 2048
SMOOTHING = 0.1  # of a tour's length: deviation of its running mean

JSON_FORM = (
    'expected {"camera_path": [{"camera_to_world": [16 numbers, row-major 4x4, '
    "OpenGL axes, rotation without scale]}, ...]}"
)


def spiral(
    camtoworlds: Float[np.ndarray, "views 3 4"],
    near: float,
    far: float,
    n: int,
    *,
    turns: int = 2,
    radius_percentile: float = 80.0,
    radius_scale: float = 1.0,
) -> Float[np.ndarray, "{n} 3 4"]:
    """Closed spiral through the middle of forward-facing views (LLFF Sec. 5).

    Every camera looks at one point straight ahead of the mean camera. Along each
    axis of the mean camera the spiral reaches as far from the mean position as
    ``radius_percentile`` per cent of the views, times ``radius_scale``; at the
    defaults it stays among the views.

    Args:
        camtoworlds: the training views.
        near: depth of the nearest content, above 0, in world units.
        far: depth of the farthest content.
        n: number of poses; the one after the last would be the first.
        turns: rounds in the picture plane during one swing forth and back.
    """
    mean = average_pose(camtoworlds)
    rotation, centre = mean[:, :3], mean[:, 3]
    offsets = (camtoworlds[:, :, 3] - centre) @ rotation
    radii = radius_scale * np.percentile(np.abs(offsets), radius_percentile, axis=0)
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    swing = [np.cos(turns * angle), np.sin(turns * angle), np.sin(angle)]
    positions = centre + (np.stack(swing, axis=-1) * radii) @ rotation.T
    focus = centre - _focus_depth(near, far) * rotation[:, 2]
    return _look_at(positions, focus, rotation[:, 1])


def ellipse(
    camtoworlds: Float[np.ndarray, "views 3 4"],
    n: int,
    *,
    radius_percentile: float = 90.0,
    radius_scale: float = 1.0,
) -> Float[np.ndarray, "{n} 3 4"]:
    """Closed level ellipse around the point that the views look at, at even speed.

    For captures that go around their subject (mip-NeRF 360); where they only go
    part of the way, so much of the ellipse shows what no photo saw. Its axes are
    the principal ones of the views' positions, each as long as
    ``radius_percentile`` per cent of the views reach; its height is their mean.

    Args:
        camtoworlds: the training views, at least 3; up is across all their rights.
        n: number of poses; the one after the last would be the first.
    """
    up = _upwards(camtoworlds)
    focus = focus_point(camtoworlds)
    offsets = camtoworlds[:, :, 3] - focus
    level = offsets - np.outer(offsets @ up, up)
    axes = np.linalg.svd(level, full_matrices=False)[2][:2]
    radii = radius_scale * np.percentile(np.abs(level @ axes.T), radius_percentile, 0)
    angle = _even_angles(radii, n)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * radii
    positions = focus + np.mean(offsets @ up) * up + around @ axes
    return _look_at(positions, focus, up)


def around(
    camtoworlds: Float[np.ndarray, "views 3 4"], n: int
) -> Float[np.ndarray, "{n} 3 4"]:
    """What suits views that surround their subject: an ellipse where they go all the
    way around it, else a tour. No pose is farther from every view than views may be
    from each other (``CLOSE`` of their mean distance from the subject)."""
    if len(camtoworlds) >= FEWEST_AROUND:
        path = ellipse(camtoworlds, n)
        reach = np.linalg.norm(camtoworlds[:, :, 3] - focus_point(camtoworlds), axis=-1)
        if _farthest(path, camtoworlds) < CLOSE * reach.mean():
            return path
    return tour(camtoworlds, n)


def tour(
    camtoworlds: Float[np.ndarray, "views 3 4"], n: int
) -> Float[np.ndarray, "{n} 3 4"]:
    """Smooth path past all views, there and back, looking at what they look at.

    Positions, distances from the subject and ups are running means along a line
    through views without jumps, so the path stays among them however they stand.

    Args:
        n: number of poses; the one after the last would be the first.
    """
    ordered = camtoworlds[_visiting_order(_distances(camtoworlds))]
    place = np.concatenate([[0.0], np.cumsum(np.diagonal(_distances(ordered), 1))])
    dense = np.linspace(0.0, place[-1], TOUR_POINTS)
    focus = focus_point(camtoworlds)
    offsets = ordered[:, :, 3] - focus
    reach = np.linalg.norm(offsets, axis=-1, keepdims=True)
    values = np.concatenate([offsets, reach, _held_upright(ordered)], axis=1)
    line = interp1d(place, values, axis=0)(dense) if place[-1] > 0.0 else values[:1]
    line = gaussian_filter1d(line, SMOOTHING * TOUR_POINTS, axis=0, mode="nearest")
    swing = 0.5 - 0.5 * np.cos(np.linspace(0.0, 2.0 * np.pi, n, endpoint=False))
    steps = np.linalg.norm(np.diff(line[:, :3], axis=0), axis=-1)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    nearest = np.searchsorted(travelled, swing * travelled[-1])
    chosen = line[np.minimum(nearest, len(line) - 1)]
    back, ups = _unit(chosen[:, :3]), chosen[:, 4:]
    right = _unit(np.cross(ups, back))
    positions = focus + chosen[:, 3:4] * back
    return np.stack([right, np.cross(back, right), back, positions], axis=-1)


def along_views(
    camtoworlds: Float[np.ndarray, "views 3 4"], n: int
) -> Float[np.ndarray, "{n} 3 4"]:
    """Smooth open path through every view, from one end of the capture to the other.

    The views are put in an order without jumps, whatever their names say.
    """
    return through(camtoworlds[_visiting_order(_distances(camtoworlds))], n)


def through(
    keyframes: Float[np.ndarray, "keys 3 4"], n: int
) -> Float[np.ndarray, "{n} 3 4"]:
    """Smooth open path through keyframes, in their order.

    Positions never leave the box between two neighbouring keyframes. Speed follows
    ``_distances``, so a turn on the spot takes its time too.
    """
    poses = keyframes
    steps = np.diagonal(_distances(poses), offset=1)
    distinct = np.concatenate([[True], steps > 1e-6 * max(steps.sum(), 1e-6)])
    poses, steps = poses[distinct], steps[distinct[1:]]
    if len(poses) == 1:
        return np.repeat(poses, n, axis=0).astype(np.float64)
    knots = np.concatenate([[0.0], np.cumsum(steps)])
    times = np.linspace(0.0, knots[-1], n)
    positions = PchipInterpolator(knots, poses[:, :, 3])(times)
    spline = RotationSpline(knots, Rotation.from_matrix(poses[:, :, :3]))
    return np.concatenate([spline(times).as_matrix(), positions[..., None]], axis=-1)


def read_poses(path: Path) -> Float[np.ndarray, "n 3 4"]:
    """Reads a camera path, such as nerfstudio's viewer exports.

    The file holds ``{"camera_path": [{"camera_to_world": M}, ...]}``: M is a
    camera-to-world matrix of 16 numbers, row by row, OpenGL axes, in the frame of
    the scene's pose file (the caller converts it to the model's). Anything else
    in the file, such as ``fps`` and ``fov``, is for other programs: the lens is
    the scene's own and the frame rate is the caller's.

    Raises:
        UserError: the file is missing, is not JSON or has another content.
    """
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))["camera_path"]
        matrices = [
            np.asarray(entry["camera_to_world"], np.float64).reshape(4, 4)
            for entry in entries
        ]
    except OSError as error:
        raise UserError(f"{path}: cannot read the camera path ({error})") from error
    except (ValueError, KeyError, TypeError) as error:
        raise UserError(f"{path}: {JSON_FORM} (found: {error!r})") from error
    if not matrices:
        raise UserError(f"{path}: the camera path is empty; {JSON_FORM}")
    for index, matrix in enumerate(matrices):
        if not _is_rigid(matrix):
            raise UserError(f"{path}: camera {index} is not a rigid pose; {JSON_FORM}")
    return np.stack(matrices)[:, :3]


def write_poses(
    path: Path,
    camtoworlds: Float[np.ndarray, "n 3 4"],
    fps: int,
    facts: Mapping[str, Any] | None = None,
) -> None:
    """Writes what ``read_poses`` reads, and ``fps``, atomically.

    Args:
        camtoworlds: in the frame of the scene's pose file.
        fps: frames per second, for other programs.
        facts: what else the file should state, as JSON can hold it.

    Raises:
        UserError: the folder cannot be written or the disk is full.
    """
    last_row = np.tile([[[0.0, 0.0, 0.0, 1.0]]], (len(camtoworlds), 1, 1))
    matrices = np.concatenate([camtoworlds, last_row], axis=1).reshape(-1, 16)
    entries = [{"camera_to_world": matrix} for matrix in matrices.tolist()]
    content = {"camera_path": entries, "fps": fps, **(facts or {})}
    write_text(path, json.dumps(content))


def _focus_depth(near: float, far: float) -> float:
    """LLFF's depth of interest: a quarter of the way in 1 / depth from far to near."""
    return 1.0 / (0.25 / near + 0.75 / far)


def _upwards(camtoworlds: Float[np.ndarray, "views 3 4"]) -> Float[np.ndarray, " 3"]:
    """The axis that is level in no view, where there is one; else their mean up.

    The mean up leans away from a subject that views look down on from one side.
    """
    mean = _unit(camtoworlds[:, :, 1].mean(axis=0))
    rights = camtoworlds[:, :, 0]
    spread, axes = np.linalg.eigh(rights.T @ rights / len(rights))
    if spread[0] > LEVEL * spread[1]:
        return mean
    return axes[:, 0] * (1.0 if axes[:, 0] @ mean > 0.0 else -1.0)


def _held_upright(
    camtoworlds: Float[np.ndarray, "n 3 4"],
) -> Float[np.ndarray, "n 3"]:
    """The up of each view, or one of its other sides where the camera was turned by
    quarters: the sides that agree best with those of all others."""
    right, up = camtoworlds[:, :, 0], camtoworlds[:, :, 1]
    sides = np.stack([up, right, -up, -right], axis=1)
    agreement = np.einsum("isc,jtc->isjt", sides, sides).max(axis=-1).sum(axis=-1)
    common = sides.reshape(-1, 3)[np.argmax(agreement)]
    heights = (camtoworlds[:, :, 3] - focus_point(camtoworlds)) @ common
    upright = float(np.mean(up @ common))
    # Where most cameras lay on their side, people still look down on things.
    if (upright if abs(upright) > CLEAR else float(np.mean(heights))) < 0.0:
        common = -common
    return sides[np.arange(len(sides)), np.argmax(sides @ common, axis=1)]


def _farthest(
    path: Float[np.ndarray, "n 3 4"], camtoworlds: Float[np.ndarray, "views 3 4"]
) -> float:
    """Greatest distance of a position on a path from its nearest view."""
    apart = path[:, None, :, 3] - camtoworlds[None, :, :, 3]
    return float(np.linalg.norm(apart, axis=-1).min(axis=1).max())


def _look_at(
    positions: Float[np.ndarray, "n 3"],
    target: Float[np.ndarray, " 3"],
    up: Float[np.ndarray, " 3"],
) -> Float[np.ndarray, "n 3 4"]:
    """Poses at ``positions`` whose optical axes meet ``target``."""
    back = _unit(positions - target)
    right = _unit(np.cross(up, back))
    return np.stack([right, np.cross(back, right), back, positions], axis=-1)


def _unit(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _even_angles(radii: Float[np.ndarray, " 2"], n: int) -> Float[np.ndarray, " {n}"]:
    """Angles of ``n`` points evenly spaced by arc length on an ellipse."""
    angle = np.linspace(0.0, 2.0 * np.pi, 4097)
    points = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * radii
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=-1)
    travelled = np.concatenate([[0.0], np.cumsum(lengths)])
    return np.interp(np.arange(n) / n * travelled[-1], travelled, angle)


def _distances(
    camtoworlds: Float[np.ndarray, "n 3 4"],
) -> Float[np.ndarray, "n n"]:
    """How far apart views are: position over the capture's spread, plus radians."""
    positions = camtoworlds[:, :, 3]
    apart = np.linalg.norm(positions[:, None] - positions[None], axis=-1)
    rotations = Rotation.from_matrix(camtoworlds[:, :, :3])
    turns = np.stack([(rotations * r.inv()).magnitude() for r in rotations])
    spread = np.sqrt(np.mean(np.var(positions, axis=0)))
    return apart / (spread if spread > 0.0 else 1.0) + turns


def _visiting_order(distances: Float[np.ndarray, "n n"]) -> Int[np.ndarray, " n"]:
    """A short open tour: nearest neighbour from an outermost view, then 2-opt."""
    order = [int(np.argmax(distances.sum(axis=0)))]
    left = set(range(len(distances))) - set(order)
    while left:
        nearest = min(left, key=lambda view: distances[order[-1], view])
        order.append(nearest)
        left.remove(nearest)
    return _two_opt(np.array(order), distances)


def _two_opt(
    order: Int[np.ndarray, " n"], distances: Float[np.ndarray, "n n"]
) -> Int[np.ndarray, " n"]:
    """Reverses stretches of an open tour while that makes it shorter."""
    order, improved = order.copy(), True
    while improved:
        improved = False
        for start, end in itertools.combinations(range(len(order)), 2):
            if _gain_of_reversal(order, distances, start, end) > 1e-9:
                order[start : end + 1] = order[start : end + 1][::-1]
                improved = True
    return order


def _gain_of_reversal(
    order: Int[np.ndarray, " n"],
    distances: Float[np.ndarray, "n n"],
    start: int,
    end: int,
) -> float:
    """By how much the tour gets shorter when ``start`` to ``end`` is walked back."""
    first, last, gain = order[start], order[end], 0.0
    if start > 0:
        before = order[start - 1]
        gain += distances[before, first] - distances[before, last]
    if end + 1 < len(order):
        after = order[end + 1]
        gain += distances[last, after] - distances[first, after]
    return float(gain)


def _is_rigid(matrix: Float[np.ndarray, "4 4"]) -> bool:
    """Whether a 4x4 matrix is a rotation and a translation, to printed precision."""
    rotation = matrix[:3, :3]
    return bool(
        np.all(np.isfinite(matrix))
        and np.allclose(matrix[3], [0.0, 0.0, 0.0, 1.0], atol=1e-3)
        and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3)
        and np.linalg.det(rotation) > 0.0
    )
