# SPDX-License-Identifier: Apache-2.0
"""From photos to a scene: all steps in order, resumable.

The scene's folder is claimed first and filled step by step; ``work`` in it keeps
copies, features and matches until the scene is complete. ``transforms.json`` and
``sparse`` appear last, so a folder that has them is whole.
"""

import dataclasses
import hashlib
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from internal import progress
from internal.errors import UserError
from internal.files import atomic, image_io, listing
from internal.files.listing import LeftOut
from internal.files.made_folder import alone_in, begin_folder, finish_folder
from internal.prepare import (
    attempts,
    mapping,
    matching,
    scene_files,
    sharpness,
    zooms,
)
from internal.prepare.attempts import Attempt
from internal.prepare.brighten import copy_size, make_copy
from internal.prepare.matching import Copy
from internal.prepare.orient import scene_frame
from internal.prepare.photos import Found, Photo, find_photos, read_photo
from internal.prepare.reasons import second_scene, why_unplaced
from internal.prepare.report import FOLDER, Report, Tried, read_report, write_report
from internal.prepare.room import cannot_write
from internal.prepare.summary import (
    Findings,
    summarize,
    summarize_failure,
    train_command,
)
from internal.prepare.video_frames import extract_frames
from internal.scene import colmap, exposures, readers
from internal.scene.gains import GAINS_FILE
from internal.scene.masks import is_of_shape
from internal.scene.pairing import pair_by_name

CONTENT = 2  # counts changes of what is written; older scenes are refused
WORK = "work"
NOTES = "photos.jsonl"
BYTES_PER_PIXEL = 1.0  # of a copy's PNG


@dataclasses.dataclass(frozen=True)
class Inputs:
    """Where the pictures are, and which are taken."""

    photos: Path  # folder or video
    pose_images: Path | None  # bright twins that poses are estimated from
    truth: Path | None  # normal-light twins, for scores
    keep_blurred: bool = False  # in the scene


def prepare(inputs: Inputs, scene: Path, *, overwrite: bool) -> Report:
    """Prepares a scene, unless an earlier run did, and returns its report.

    Raises:
        UserError: the input is unusable, or ``scene`` cannot be written. What was
            computed stays and is used by the next run.
    """
    _check_apart(inputs, scene)
    if begin_folder(scene, _settings(inputs), overwrite=overwrite) is not None:
        return read_report(scene / FOLDER)
    try:
        with alone_in(scene):
            return _prepare(inputs, scene)
    except OSError as error:
        atomic.check_read(scene, error)
        raise cannot_write(scene, error) from error


@dataclasses.dataclass(frozen=True)
class _Placed:
    """Photos with poses, and how these came about."""

    found: Found
    truth: tuple[Sequence[Path], str] | None  # of each photo, and how it was paired
    copies: Sequence[Copy]
    tried: Sequence[Attempt]  # the best first
    failed: tuple[LeftOut, ...]


def _prepare(inputs: Inputs, scene: Path) -> Report:
    placed = _place(inputs, scene)
    photos, truth, best = placed.found.photos, placed.truth, placed.tried[0]
    views = best.models[0].views
    pixels = matching.matched_pixels(best.database)
    relative = _sharpness(photos, placed.copies, pixels)
    left_out = sharpness.find_harmful(relative, pixels, views)
    if inputs.keep_blurred:
        left_out = []
    model = mapping.without(best.models[0], left_out)
    best = dataclasses.replace(best, models=(model,))
    _copy_photos(scene, photos, truth[0] if truth else None, model.views)
    gains = exposures.measure_gains(
        mapping.sighted(model),
        lambda place: read_photo(photos[model.views[place]].path),
        len(model.views),
    )
    names = [photos[view].scene_name for view in model.views]
    exposures.write(gains, names, scene / GAINS_FILE)
    _write_cameras(scene, photos, best)
    source = inputs.photos.name
    scene_files.write_readme(
        scene, source, len(photos), len(names), has_truth=truth is not None
    )
    findings = Findings(
        source=source,
        photos=[p.statistics for v, p in enumerate(photos) if v not in left_out],
        total=len(photos) + len(placed.found.rejected),
        error=best.error,
        error_kind="mean reprojection error",
        sharpness={photos[v].name: float(relative[v]) for v in views},
        exposures=gains,
        truth=f"{inputs.truth}, paired by {truth[1]}" if truth else "none",
        next_command=train_command(scene, photos[0].width),
        failed=placed.failed,
        left_out=tuple(photos[v].name for v in left_out),
        tried=tuple(map(_tried, placed.tried)),
    )
    report, pictured = summarize(readers.read_files(scene, "auto", ""), findings)
    write_report(report, pictured, scene / FOLDER)
    finish_folder(scene, {"registered": float(report.registered)})
    shutil.rmtree(scene / WORK)
    return report


def _place(inputs: Inputs, scene: Path) -> _Placed:
    """Finds the photos and their poses.

    Raises:
        UserError: no scene comes of them; its report says why.
    """
    work = scene / WORK
    folder = inputs.photos
    if folder.is_file():
        extract_frames(folder, work / "frames")
        folder = work / "frames"
    work.mkdir(exist_ok=True)
    found = find_photos(folder, work / NOTES)
    photos = found.photos
    truth = scene_files.pair_twins(photos, inputs.truth) if inputs.truth else None
    sources = _pose_sources(photos, inputs.pose_images)
    copies = [_copy(p, s) for p, s in zip(photos, sources, strict=True)]
    _check_space(scene, photos, copies)
    ways = attempts.WAYS
    if inputs.pose_images:
        ways = (attempts.PLAIN, *ways)
    tried = attempts.try_ways(
        ways, copies, lambda view: read_photo(sources[view]), work
    )
    best = zooms.tell_apart(tried[0], copies, work / "zooms")
    if best is not tried[0]:
        tried = [best, *tried]
    failed = (*found.rejected, *_unplaced(photos, best))
    problem = _problem(photos, best)
    if problem:
        report = summarize_failure(
            inputs.photos.name, found, failed, tuple(map(_tried, tried)), problem
        )
        page = write_report(report, None, scene / FOLDER)
        raise UserError(f"{inputs.photos}: {problem} ({page})")
    return _Placed(found, truth, copies, tried, failed)


def _copy_photos(
    scene: Path,
    photos: Sequence[Photo],
    truth: Sequence[Path] | None,
    views: Sequence[int],
) -> None:
    """Puts the photos of some views, and their truth, into the scene."""
    for view in progress.track(views, len(views), "copying", "photo"):
        scene_files.place_photo(photos[view], scene)
        if truth:
            scene_files.place_truth(photos[view], truth[view], scene)


def _settings(inputs: Inputs) -> dict[str, str | int]:
    """What a scene depends on; the photos by name, size and time of change."""
    paths = {
        "photos": inputs.photos,
        "pose_images": inputs.pose_images,
        "truth": inputs.truth,
    }
    settings: dict[str, str | int] = {"content": CONTENT}
    settings["keep_blurred"] = int(inputs.keep_blurred)
    for name, path in paths.items():
        settings[name] = str(path.resolve()) if path else ""
        settings[f"files of {name}"] = _fingerprint(path) if path else ""
    return settings


def _fingerprint(path: Path) -> str:
    """Changes when a photo comes, goes or changes."""
    files = [path]
    if path.is_dir():
        found = listing.find_pictures(path)
        files = [path / name for name in sorted(found.pictures + found.raw)]
    digest = hashlib.sha256()
    for file in files:
        if file.is_file():
            stat = file.stat()
            digest.update(f"{file}\0{stat.st_size}\0{stat.st_mtime_ns}\n".encode())
    return digest.hexdigest()[:12]


def _check_apart(inputs: Inputs, scene: Path) -> None:
    """Refuses a scene inside a folder of input: those are never written to."""
    for folder in (inputs.photos, inputs.pose_images, inputs.truth):
        if folder and scene.resolve().is_relative_to(folder.resolve()):
            raise UserError(f"{scene}: lies in {folder}; choose another folder")
    if not inputs.photos.exists():
        raise UserError(f"{inputs.photos}: no such folder or video; check the path")


def _pose_sources(photos: Sequence[Photo], twins: Path | None) -> list[Path]:
    """The picture that each photo's pose is estimated from."""
    if twins is None:
        return [photo.path for photo in photos]
    paths, rule = pair_by_name([photo.name for photo in photos], twins)
    print(f"pose images: {twins}, paired by {rule}", flush=True)
    return list(paths)


def _copy(photo: Photo, source: Path) -> Copy:
    """The copy of a photo, or of its bright twin, which may have another size."""
    width, height = photo.width, photo.height
    if source != photo.path:
        width, height = image_io.read_size(source)
        if not is_of_shape((width, height), (photo.width, photo.height)):
            raise UserError(
                f"{source}: {width}x{height} pixels, but its dark twin {photo.path} "
                f"has {photo.width}x{photo.height}, another shape; expected one view"
            )
    small = copy_size(width, height)
    return Copy(*small, photo.camera, photo.focal * small[0] / photo.width)


def _check_space(scene: Path, photos: Sequence[Photo], copies: Sequence[Copy]) -> None:
    """Stops before hours of work that would end with a full disk."""
    features = matching.MAX_FEATURES * matching.BYTES_PER_FEATURE
    needed = sum(photo.path.stat().st_size for photo in photos) + sum(
        int(copy.width * copy.height * BYTES_PER_PIXEL) + features for copy in copies
    )
    free = shutil.disk_usage(scene).free
    if free < needed:
        raise UserError(
            f"{scene}: {free / 1e9:.1f} GB free on its disk, about {needed / 1e9:.1f} "
            "GB needed; free space or choose a folder on another disk"
        )


def _unplaced(photos: Sequence[Photo], best: Attempt) -> tuple[LeftOut, ...]:
    """The photos without a pose, and why."""
    placed = best.models[0].views if best.models else ()
    matches = matching.match_counts(best.database)
    features = matching.feature_counts(best.database)
    return tuple(
        LeftOut(photo.name, why_unplaced(view, matches, features))
        for view, photo in enumerate(photos)
        if view not in placed
    )


def _problem(photos: Sequence[Photo], best: Attempt) -> str:
    """Why there is no scene, with what to do; "" if there is one."""
    matches = matching.match_counts(best.database)
    if best.registered < mapping.FEWEST_IMAGES:
        cause = "show the same things" if matches else "overlap at all"
        return (
            f"{best.registered} of {len(photos)} photos could be placed: too few "
            f"{cause}; take them with two thirds of overlap, in more light, or give "
            "bright twins with --pose-images"
        )
    placed = best.models[0].views
    group = second_scene(matches, len(photos), placed, mapping.FEWEST_IMAGES)
    if group:
        other, first = photos[group[0]].name, photos[placed[0]].name
        return (
            f"two scenes: {len(placed)} photos with {first} and {len(group)} with "
            f"{other} show nothing in common; prepare them from two folders"
        )
    return ""


def _sharpness(
    photos: Sequence[Photo], copies: Sequence[Copy], pixels: sharpness.PixelPairs
) -> Float[np.ndarray, " views"]:
    """Of the photos themselves, where poses come from bright twins, too."""

    def read_copy(view: int) -> Float[np.ndarray, "height width"]:
        copy = make_copy(read_photo(photos[view].path), attempts.WAYS[0].recipe)
        height, width = copy.shape[:2]
        size = copies[view].height / height, copies[view].width / width
        return np.asarray(ndimage.zoom(copy[..., 0], size, order=1))

    return sharpness.against_overlapping(read_copy, len(photos), pixels)


def _write_cameras(scene: Path, photos: Sequence[Photo], best: Attempt) -> None:
    """Writes ``sparse`` and ``transforms.json`` in the scene's own frame."""
    model = best.models[0]
    similarity = scene_frame(
        mapping.camera_poses(model), mapping.point_positions(model)
    )
    partial = scene / WORK / scene_files.MODEL
    names = [photo.scene_name for photo in photos]
    sizes = [(photo.width, photo.height) for photo in photos]
    mapping.write_for_photos(model, partial, names, sizes, similarity)
    shutil.rmtree(scene / "sparse", ignore_errors=True)
    partial.parent.rename(scene / "sparse")
    scene_files.write_transforms(colmap.read_model(scene / scene_files.MODEL), scene)


def _tried(attempt: Attempt) -> Tried:
    error = attempt.error if attempt.models else 0.0
    return Tried(attempt.way.name, attempt.registered, error, attempt.points)
