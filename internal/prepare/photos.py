# SPDX-License-Identifier: Apache-2.0
"""The photos of a folder: which are usable, by which camera, and why others are not.

Sizes are upright (width, height) in pixels. A name is a path relative to the folder.
"""

import dataclasses
import hashlib
import json
import math
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import numpy as np
from jaxtyping import Float

from internal import color, progress
from internal.errors import UserError
from internal.files import atomic, heif, image_io, listing, raw
from internal.files.listing import LeftOut
from internal.prepare.statistics import PhotoStatistics, measure_photo

FEWEST = 3
VIDEO_ENDINGS = tuple(".mp4 .mov .m4v .mkv .avi .webm .mts .3gp .insv .lrv".split())
FILM_DIAGONAL = math.hypot(36.0, 24.0)  # mm
# Not 8-bit sRGB, or not read by other programs: developed to an 8-bit PNG.
DEVELOPED_EXTENSIONS = (
    image_io.RAW_EXTENSIONS | image_io.LINEAR_EXTENSIONS | heif.EXTENSIONS
)


def name_in_scene(name: PurePosixPath) -> str:
    """The name of a picture in a scene: RAW, EXR and HEIC become PNG files."""
    developed = name.suffix.lower() in DEVELOPED_EXTENSIONS
    return (name.with_suffix(".png") if developed else name).as_posix()


@dataclasses.dataclass(frozen=True)
class Photo:
    """A usable photo."""

    path: Path
    name: str
    width: int
    height: int
    camera: str  # photos with equal ones were taken by one camera at one zoom
    focal: float  # pixels; 0 if unknown
    statistics: PhotoStatistics

    @property
    def scene_name(self) -> str:
        """Its name in a scene."""
        return name_in_scene(PurePosixPath(self.name))


@dataclasses.dataclass(frozen=True)
class Found:
    """What a folder holds, sorted by name."""

    photos: tuple[Photo, ...]
    rejected: tuple[LeftOut, ...]


def find_photos(folder: Path, notes: Path) -> Found:
    """Reads every photo once and sorts out what cannot be used; shows progress.

    Args:
        notes: file that says what photos hold; those in it are not read again.

    Raises:
        UserError: the folder is missing, or holds fewer than ``FEWEST`` usable ones.
    """
    names, left_out = list_names(folder)
    rejected = _twins(folder, names) | left_out
    photos = []
    known = _read_notes(notes, folder)
    for name in progress.track(names, len(names), "reading photos", "photo"):
        if name in rejected:
            continue
        result = known.get(name) or _inspect(folder, name)
        if name not in known:
            _note(notes, name, result)
        if isinstance(result, Photo):
            photos.append(result)
        else:
            rejected[name] = result
    found = Found(
        tuple(photos), tuple(LeftOut(n, rejected[n]) for n in sorted(rejected))
    )
    if len(photos) < FEWEST:
        raise UserError(
            f"{folder}: {len(photos)} usable photos of {len(names) + len(left_out)}; "
            f"at least {FEWEST} "
            f"from different places make a scene{_examples(found.rejected)}"
        )
    return found


def list_names(folder: Path) -> tuple[tuple[str, ...], dict[str, str]]:
    """Sorted names of all photos, RAW included; and of pictures that are not taken,
    why.

    Raises:
        UserError: the folder is missing or there is none.
    """
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder or video; check the path")
    found = listing.find_pictures(folder)
    names = tuple(sorted(found.pictures + found.raw))
    if not names:
        left_out = listing.by_reason(found.left_out)
        files = sorted(listing.list_files(folder))
        videos = [path for path in files if path.suffix.lower() in VIDEO_ENDINGS]
        raise UserError(
            f"{folder}: no photo in it; expected JPG, PNG, TIFF, WebP, HEIC, EXR or RAW"
            + (f"; left out: {left_out}" if left_out else "")
            + (f"; of the video {videos[0]} give the path itself" if videos else "")
        )
    return names, {entry.name: entry.reason for entry in found.left_out}


def read_photo(path: Path) -> Float[np.ndarray, "height width 3"]:
    """One photo as upright sRGB in [0, 1]; RAW, EXR and HEIC are developed to 8 bits.

    Raises:
        UserError: it cannot be read.
    """
    if path.suffix.lower() in image_io.RAW_EXTENSIONS:
        return raw.develop(path)
    pixels = image_io.read_srgb(path)
    is_developed = path.suffix.lower() in DEVELOPED_EXTENSIONS
    return color.quantize(pixels) if is_developed else pixels


def _twins(folder: Path, names: Sequence[str]) -> dict[str, str]:
    """Reasons of files that show what another shows: copies, and of a shot that was
    saved as JPEG, HEIC or RAW at once, all but the first of these."""
    reasons: dict[str, str] = {}
    by_content: dict[str, str] = {}
    for name in names:
        content = _digest(folder / name)
        if content in by_content:
            reasons[name] = f"the same file as {by_content[content]}"
        if content:
            by_content[content] = by_content.get(content, name)
    shots: dict[PurePosixPath, str] = {}
    for name in sorted(names, key=_development):
        path = PurePosixPath(name)
        twin = shots.setdefault(path.with_suffix(""), name)
        if twin != name and _development(name):
            reasons[name] = f"the same shot as {twin}, which is less to be developed"
    return reasons


def _development(name: str) -> int:
    """How far a file is from 8-bit sRGB that all programs read, which is 0."""
    ending = PurePosixPath(name).suffix.lower()
    kinds = (heif.EXTENSIONS, image_io.LINEAR_EXTENSIONS, image_io.RAW_EXTENSIONS)
    return next((rank for rank, kind in enumerate(kinds, 1) if ending in kind), 0)


def _inspect(folder: Path, name: str) -> Photo | str:
    """The photo, or why it is unusable."""
    path = folder / name
    try:
        srgb = read_photo(path)
    except UserError as error:
        return str(error).removeprefix(f"{path}: ")
    statistics = measure_photo(srgb)
    if statistics.is_black:
        return f"black: nothing in it is brighter than {statistics.bright:.0f} of 255"
    if statistics.is_white:
        return "white: all of it is at 255 of 255; expose shorter"
    height, width = srgb.shape[:2]
    exif = image_io.read_exif(path)
    focal = exif.focal_35mm / FILM_DIAGONAL * math.hypot(width, height)
    zoom = f"{exif.focal:g} mm ({exif.focal_35mm:g} mm)"
    camera = f"{exif.camera} {exif.lens} {width}x{height} {zoom}".strip()
    return Photo(path, name, width, height, camera, focal, statistics)


def _note(notes: Path, name: str, result: Photo | str) -> None:
    """Appends what a photo holds, or why it is unusable, as a line of JSON."""
    entry = result
    if isinstance(result, Photo):
        entry = dataclasses.asdict(dataclasses.replace(result, path=Path()))
        del entry["path"]
    with notes.open("a") as file:
        file.write(json.dumps([name, entry]) + "\n")


def _read_notes(notes: Path, folder: Path) -> dict[str, Photo | str]:
    """What ``_note`` wrote; a last line that was cut short does not count."""
    known: dict[str, Photo | str] = {}
    for name, entry in atomic.whole_lines(notes):
        if isinstance(entry, dict):
            histogram = tuple(entry["statistics"].pop("histogram"))
            measured = PhotoStatistics(**entry.pop("statistics"), histogram=histogram)
            entry = Photo(folder / name, **entry, statistics=measured)
        known[name] = entry
    return known


def _digest(path: Path) -> str:
    """Of the content; "" for a file that is empty, unreadable or gone: reading it
    says why."""
    try:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            return digest if file.tell() else ""
    except OSError:
        return ""


def _examples(rejected: Sequence[LeftOut]) -> str:
    shown = [f"{r.name}: {r.reason}" for r in rejected[:2]]
    return f" (e.g. {'; '.join(shown)})" if shown else ""
