# SPDX-License-Identifier: Apache-2.0
"""The pictures that ``transforms*.json`` lists, as they lie on this disk."""

import itertools
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from internal.errors import UserError
from internal.files import image_io
from internal.files.listing import (
    composed,
    find_file,
    is_file,
    is_metadata,
    say_once,
)
from internal.scene.mask_files import HIDING
from internal.scene.pairing import some
from internal.scene.readers.transforms_entries import (
    Entry,
    of_another_machine,
    read_camtoworld,
)

# Of folders that were looked at, the pictures by their names up to the ending.
Folders = dict[Path, dict[str, list[Path]]]


def with_pictures(frames: Sequence[Entry], folders: Folders) -> list[Entry]:
    """The frames without those test views whose photo is not there: benchmarks list
    pictures that they keep for themselves."""
    is_missing = [frame.is_test and not _alike(frame, folders) for frame in frames]
    missing = list(itertools.compress(frames, is_missing))
    if missing:
        shown = ", ".join(frame.image_path.name for frame in missing[:3])
        is_all = len(missing) == sum(frame.is_test for frame in frames)
        instead = "; none is left, so others are held out" if is_all else ""
        print(
            f"WARNING: {missing[0].json_path}: {len(missing)} test views have no photo "
            f"here ({shown}, ...); they are left out{instead}"
        )
    return [f for f, gone in zip(frames, is_missing, strict=True) if not gone]


def find_picture(frame: Entry, folders: Folders) -> Path:
    """The listed file; or the one of that stem, with any extension or case."""
    found = _alike(frame, folders)
    if found is None:
        raise UserError(
            f"{frame.image_path}: image not found, but {frame.json_path} lists it; "
            "copy it there or remove its frame"
        )
    return found


def _alike(frame: Entry, folders: Folders) -> Path | None:
    path = find_file(frame.image_path)
    if is_file(path):
        return path
    if path.parent not in folders:
        folders[path.parent] = _by_stem(path.parent)
    stems = {composed(stem).casefold() for stem in (path.name, path.stem)}
    alike = sorted(x for stem in stems for x in folders[path.parent].get(stem, ()))
    named = composed(path.name).casefold()
    alike = [other for other in alike if other.name.casefold() == named] or alike
    if len(alike) > 1:
        raise UserError(
            f"{path}: not there, and {alike[0].name} and {alike[1].name} could both be "
            f"meant; write its ending into {frame.json_path}"
        )
    return alike[0] if alike else None


def _by_stem(folder: Path) -> dict[str, list[Path]]:
    """The pictures of a folder by their names up to the ending, in lower case."""
    found: dict[str, list[Path]] = {}
    folder = _of_any_case(folder)
    for path in _pictures(folder) if os.path.isdir(folder) else ():
        found.setdefault(composed(path.stem).casefold(), []).append(path)
    return found


def _of_any_case(folder: Path) -> Path:
    """The folder, or the one there whose name differs only in case."""
    if os.path.isdir(folder) or not os.path.isdir(folder.parent):
        return folder
    named = composed(folder.name).casefold()
    beside = folder.parent.glob("*")
    alike = [x for x in beside if composed(x.name).casefold() == named]
    return alike[0] if len(alike) == 1 else folder


def _pictures(folder: Path) -> list[Path]:
    return [
        path
        for path in folder.glob("*")
        if image_io.is_image(path) and is_file(path) and not is_metadata(path)
    ]


def name_unlisted(frames: Sequence[Entry]) -> None:
    """Names the pictures beside those of the frames that no frame lists."""
    listed = {frame.image_path.name for frame in frames}
    file = frames[0].json_path.name
    chosen = " that its lists of filenames name" * bool(
        frames[0].values.get("train_filenames")
    )
    for folder in sorted({frame.image_path.parent for frame in frames}):
        beside = sorted(path.name for path in _pictures(folder))
        unlisted = [
            name
            for name in beside
            if name not in listed and not name.startswith(HIDING)
        ]
        if unlisted:
            say_once(
                f"{folder}: {len(unlisted)} of {len(beside)} pictures are in no frame "
                f"of {file}{chosen}: {some(unlisted)} left out"
            )


def name_outside(data_dir: Path, frames: Sequence[Entry]) -> None:
    """Says so if pictures are taken from elsewhere though the scene has some of these
    names: a scene that was copied still lists those that it was copied from."""
    outside = [f for f in frames if not f.image_path.is_relative_to(data_dir)]
    for frame in outside[:1]:
        inside = of_another_machine(data_dir, frame.image_path.as_posix())
        if inside:
            say_once(
                f"WARNING: {frame.json_path}: {len(outside)} of {len(frames)} pictures "
                f"are taken from elsewhere, as it says, such as {frame.image_path}, "
                f"not {inside}: list paths from its own folder to use these"
            )


def check_repeated(unique: Mapping[Path, Entry], frames: Sequence[Entry]) -> None:
    """Refuses a picture that is listed twice with two poses."""
    for frame in frames:
        last = unique[frame.image_path]
        if last is frame:
            continue
        if not np.allclose(read_camtoworld(last), read_camtoworld(frame)):
            raise UserError(
                f"{frame.json_path}: {frame.image_path} is listed with two different "
                "poses; remove the wrong one"
            )
