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
from internal.files import atomic, image_io, raw
from internal.prepare.statistics import PhotoStatistics, measure

FEWEST = 3
FILM_DIAGONAL = math.hypot(36.0, 24.0)  # mm
# Light, not sRGB: developed to an 8-bit PNG like RAW.
LINEAR_EXTENSIONS = frozenset([".exr", ".hdr"])
DEVELOPED_EXTENSIONS = image_io.RAW_EXTENSIONS | LINEAR_EXTENSIONS


def scene_name(name: PurePosixPath) -> str:
    """The name of a picture in a scene: RAW and EXR become PNG files."""
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
        return scene_name(PurePosixPath(self.name))


@dataclasses.dataclass(frozen=True)
class Rejected:
    """A file that is not used."""

    name: str
    reason: str


@dataclasses.dataclass(frozen=True)
class Found:
    """What a folder holds, sorted by name."""

    photos: tuple[Photo, ...]
    rejected: tuple[Rejected, ...]


def find_photos(folder: Path, notes: Path) -> Found:
    """Reads every photo once and sorts out what cannot be used; shows progress.

    Args:
        notes: file that says what photos hold; those in it are not read again.

    Raises:
        UserError: the folder is missing, or holds fewer than ``FEWEST`` usable ones.
    """
    names = list_names(folder)
    rejected = _twins(folder, names)
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
        tuple(photos), tuple(Rejected(n, rejected[n]) for n in sorted(rejected))
    )
    if len(photos) < FEWEST:
        raise UserError(
            f"{folder}: {len(photos)} usable photos of {len(names)}; at least {FEWEST} "
            f"from different places make a scene{_examples(found.rejected)}"
        )
    return found


def list_names(folder: Path) -> tuple[str, ...]:
    """Sorted names of all files that end like a photo, RAW included.

    Raises:
        UserError: the folder is missing or there is none.
    """
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder or video; check the path")
    endings = image_io.EXTENSIONS | image_io.RAW_EXTENSIONS
    names = sorted(
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.suffix.lower() in endings and not path.name.startswith(".")
    )
    if not names:
        raise UserError(
            f"{folder}: no photo in it; expected JPG, PNG, TIFF, WebP, EXR or RAW"
        )
    return tuple(names)


def read_photo(path: Path) -> Float[np.ndarray, "height width 3"]:
    """One photo as upright sRGB in [0, 1]; RAW and EXR are developed to 8 bits.

    Raises:
        UserError: it cannot be read.
    """
    if path.suffix.lower() in image_io.RAW_EXTENSIONS:
        return raw.develop(path)
    pixels = image_io.read_srgb(path)
    if path.suffix.lower() in LINEAR_EXTENSIONS:
        return color.quantize(color.linear_to_srgb(pixels))
    return pixels


def _twins(folder: Path, names: Sequence[str]) -> dict[str, str]:
    """Reasons of files that show what another shows: copies, and RAW beside JPEG."""
    reasons: dict[str, str] = {}
    by_content: dict[str, str] = {}
    for name in names:
        content = _digest(folder / name)
        if content in by_content and (folder / name).stat().st_size:
            reasons[name] = f"the same file as {by_content[content]}"
        by_content.setdefault(content, name)
    stems = {
        PurePosixPath(name).with_suffix(""): name
        for name in names
        if PurePosixPath(name).suffix.lower() not in DEVELOPED_EXTENSIONS
    }
    for name in names:
        path = PurePosixPath(name)
        twin = stems.get(path.with_suffix(""))
        if twin and path.suffix.lower() in DEVELOPED_EXTENSIONS:
            reasons[name] = f"the same shot as {twin}, which is 8-bit sRGB already"
    return reasons


def _inspect(folder: Path, name: str) -> Photo | str:
    """The photo, or why it is unusable."""
    path = folder / name
    try:
        srgb = read_photo(path)
    except UserError as error:
        return str(error).removeprefix(f"{path}: ")
    statistics = measure(srgb)
    if statistics.is_black:
        return f"black: nothing in it is brighter than {statistics.bright:.0f} of 255"
    height, width = srgb.shape[:2]
    exif = image_io.read_exif(path)
    focal = exif.focal_35mm / FILM_DIAGONAL * math.hypot(width, height)
    camera = f"{exif.camera} {width}x{height} {exif.focal_35mm:g}".strip()
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
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _examples(rejected: Sequence[Rejected]) -> str:
    shown = [f"{r.name}: {r.reason}" for r in rejected[:2]]
    return f" (e.g. {'; '.join(shown)})" if shown else ""
