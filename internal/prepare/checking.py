# SPDX-License-Identifier: Apache-2.0
"""Checks a scene that has poses, in any format that the readers know.

Matches between neighbouring views are found afresh; where the poses are right, the
ray of a pixel and the ray of its match lie in one plane with both centres. Where the
files have no points, the photos are asked for some, under the given poses.
"""

import dataclasses
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from internal import poses
from internal.cameras import Lens
from internal.errors import UserError
from internal.files import image_io
from internal.files.scratch import scratch_folder
from internal.prepare import attempts, matching, sharpness, statistics
from internal.prepare.brighten import copy_size
from internal.prepare.checks import USELESS_ERROR
from internal.prepare.depths import find_points
from internal.prepare.matching import Copy, Pairs
from internal.prepare.report import Report, write_report
from internal.prepare.scene_files import HOLDOUT
from internal.prepare.statistics import PhotoStatistics
from internal.prepare.summary import Findings, summarize, train_command
from internal.scene import colmap, exposures, readers
from internal.scene.exposures import Sighted
from internal.scene.gains import measured_exposures
from internal.scene.loading import (
    find_truth,
    fit_lenses,
    held_out,
)
from internal.scene.plausible import cloud_fault
from internal.scene.pose_checks import check_lenses, check_poses, check_sides
from internal.scene.readers.base import POINTS_OF_MODEL, SceneFiles

NEIGHBOURS = 3  # that each view is matched with
PARALLEL = np.radians(0.5)
PixelPairs = dict[tuple[int, int], Float[np.ndarray, "_matches 2 2"]]


def check_scene(data_dir: Path, folder: Path) -> Report:
    """Checks a scene, writes the report into ``folder`` and returns it.

    Raises:
        UserError: no scene, broken pictures, poses or lenses, or an unwritable folder.
    """
    files = readers.read_files(data_dir, "auto", "")
    check_poses(files)
    check_lenses(files)
    lenses = fit_lenses(files, 1)
    files = _with_points(files)
    check_sides(files)
    truth = find_truth(files, data_dir, "", held_out(files, HOLDOUT))
    count = len(files.names)
    copies = [_copy(lens) for lens in lenses]
    photos, pixels, relative = _compare_neighbours(files, copies)
    small = [
        colmap.scale_lens(e, c.width, c.height)
        for e, c in zip(lenses, copies, strict=True)
    ]
    wrong = misplaced(files.camtoworlds, small, pixels, USELESS_ERROR)
    found = Findings(
        source=data_dir.resolve().name,
        photos=photos,
        total=count,
        error=epipolar_error(files.camtoworlds, small, pixels),
        error_kind="median epipolar error",
        misplaced=tuple(files.names[view] for view in wrong),
        sharpness=dict(zip(files.names, relative.tolist(), strict=True)),
        exposures=measured_exposures(data_dir, files, np.ones(count, bool), [data_dir])
        or exposures.measure_gains(
            _sighted(copies, pixels),
            lambda view: image_io.read_srgb(files.image_paths[view], files.upright),
            count,
        ),
        truth=truth.reason,
        next_command=train_command(data_dir, lenses[0].width),
    )
    report, pictured = summarize(files, found)
    try:
        write_report(report, pictured, folder)
    except OSError as error:
        raise UserError(
            f"{folder}: cannot write ({error.strerror}); name a folder with --report"
        ) from error
    return report


def neighbours(camtoworlds: Float[np.ndarray, "n 3 4"]) -> Pairs:
    """Pairs of each view with the ``NEIGHBOURS`` that see most of what it sees.

    Cameras are near if their centres are, seen from the scene, and axes agree.
    """
    centres = camtoworlds[:, :, 3]
    reach = np.linalg.norm(centres - poses.focus_point(camtoworlds), axis=-1).mean()
    apart = np.linalg.norm(centres[:, None] - centres, axis=-1) / max(reach, 1e-12)
    turned = 1.0 - camtoworlds[:, :, 2] @ camtoworlds[:, :, 2].T
    distance = apart + turned
    np.fill_diagonal(distance, np.inf)
    nearest = np.argsort(distance, axis=1, kind="stable")[:, :NEIGHBOURS]
    pairs = {
        (min(i, j), max(i, j)) for i, row in enumerate(nearest.tolist()) for j in row
    }
    return sorted(pair for pair in pairs if pair[0] != pair[1])


def epipolar_error(
    camtoworlds: Float[np.ndarray, "n 3 4"], lenses: list[Lens], pixels: PixelPairs
) -> float:
    """Median distance in pixels of matches from where the poses put them.

    A match whose rays meet behind a camera is as far off as the picture is wide, and
    so is everything without matches. Half a pixel to two is what features allow.
    """
    errors = [
        _match_errors(camtoworlds[[i, j]], (lenses[i], lenses[j]), ends)
        for (i, j), ends in pixels.items()
    ]
    return float(np.median(np.concatenate(errors or [[lenses[0].width]])))


def misplaced(
    camtoworlds: Float[np.ndarray, "n 3 4"],
    lenses: list[Lens],
    pixels: PixelPairs,
    largest: float,
) -> list[int]:
    """Views that agree with none of the views that they share matches with, where most
    do with some.

    Args:
        largest: error in pixels, the median over a pair's matches.
    """
    fits: dict[int, list[bool]] = {}
    for (i, j), ends in pixels.items():
        errors = _match_errors(camtoworlds[[i, j]], (lenses[i], lenses[j]), ends)
        for view in (i, j):
            fits.setdefault(view, []).append(bool(np.median(errors) <= largest))
    wrong = [view for view, held in fits.items() if not any(held)]
    return sorted(wrong) if len(wrong) < len(fits) / 2 else []


def _match_errors(
    camtoworlds: Float[np.ndarray, "2 3 4"],
    lenses: tuple[Lens, Lens],
    ends: Float[np.ndarray, "m 2 2"],
) -> Float[np.ndarray, " m"]:
    """Angles between each ray and the plane of the other ray and the baseline, as
    pixels at the middle of the picture; the mean of both sides."""
    baseline = camtoworlds[1, :, 3] - camtoworlds[0, :, 3]
    rays = [
        colmap.pixel_rays(lens, ends[:, side]) @ camtoworlds[side, :, :3].T
        for side, lens in enumerate(lenses)
    ]
    errors = np.zeros(len(ends))
    for side, lens in enumerate(lenses):
        normals = np.cross(rays[1 - side], baseline)
        lengths = np.maximum(np.linalg.norm(normals, axis=-1), np.finfo(float).tiny)
        sines = np.abs((rays[side] * normals).sum(axis=-1)) / lengths
        focal = sum(colmap.focal_lengths(lens)) / 2.0
        errors += np.arcsin(np.clip(sines, 0.0, 1.0)) * focal / 2.0
    behind = _meet_behind(rays[0], rays[1], baseline)
    return np.where(behind, lenses[0].width, errors)


def _meet_behind(
    first: Float[np.ndarray, "m 3"],
    second: Float[np.ndarray, "m 3"],
    baseline: Float[np.ndarray, " 3"],
) -> Bool[np.ndarray, " m"]:
    """Whether two unit rays come nearest to each other behind where one starts.

    Rays that are as good as parallel meet far away, before or behind: not counted.
    """
    cosines = (first * second).sum(axis=-1)
    along_first, along_second = first @ baseline, second @ baseline
    ahead = np.minimum(
        along_first - along_second * cosines, along_first * cosines - along_second
    )
    return (ahead < 0.0) & (1.0 - cosines**2 > np.sin(PARALLEL) ** 2)


def _with_points(files: SceneFiles) -> SceneFiles:
    """The files with points, from the photos where they have none.

    Raises:
        UserError: points of theirs that do not rest on the photos do not fit these.
    """
    if files.points_source == POINTS_OF_MODEL and len(files.points):
        return files
    points = find_points(files, range(len(files.names)), ())
    if not len(files.points):
        return dataclasses.replace(files, points=points)
    fault = cloud_fault(files, points)
    if fault:
        raise UserError(f"{files.pose_paths[0]}: {fault}")
    return files


def _compare_neighbours(
    files: SceneFiles, copies: list[Copy]
) -> tuple[list[PhotoStatistics], PixelPairs, Float[np.ndarray, " n"]]:
    """What each photo holds, matches of neighbouring views, and each photo's sharpness
    against those; decodes each photo once. Shows progress."""
    photos = []

    def read(view: int) -> Float[np.ndarray, "_height _width 3"]:
        srgb = image_io.read_srgb(files.image_paths[view], files.upright)
        photos.append(statistics.measure_photo(srgb))
        return srgb

    with scratch_folder() as work:
        way = attempts.WAYS[0]
        attempts.make_copies(way.recipe, len(copies), read, work)
        database = work / "database.db"
        matching.extract_features(database, work, copies, way.peak_threshold)
        matching.match(database, neighbours(files.camtoworlds))
        pixels = matching.matched_pixels(database)
        relative = sharpness.against_overlapping(
            lambda v: image_io.read_srgb(work / matching.copy_name(v))[..., 0],
            len(copies),
            pixels,
        )
    return photos, pixels, relative


def _sighted(copies: list[Copy], pixels: PixelPairs) -> dict[int, Sighted]:
    """Each match as a point that two views see."""
    seen: dict[int, list[Sighted]] = {}
    first = 0
    for pair, ends in pixels.items():
        points = np.arange(first, first + len(ends))
        first += len(ends)
        for side, view in enumerate(pair):
            size = copies[view].width, copies[view].height
            seen.setdefault(view, []).append(Sighted(points, ends[:, side] / size))
    return {
        view: Sighted(
            np.concatenate([part.points for part in parts]),
            np.concatenate([part.places for part in parts]),
        )
        for view, parts in seen.items()
    }


def _copy(lens: Lens) -> Copy:
    """The lens matters to nothing here: matches are checked against given poses."""
    width, height = copy_size(lens.width, lens.height)
    return Copy(width, height, f"{width}x{height}", 0.0)
