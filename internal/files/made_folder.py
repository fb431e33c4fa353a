# SPDX-License-Identifier: Apache-2.0
"""Folders that a program makes: made once, never over the user's.

``make_folder`` makes one whole or not at all; ``begin_folder`` and ``finish_folder``
fill one over several runs.

The record beside the content states the settings it was made with and facts about
it, so that a second run with the same settings costs nothing.
"""

import contextlib
import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from internal.errors import UserError
from internal.files import listing
from internal.files.atomic import PARTIAL, naming, write_text
from internal.files.locks import take_lock

RECORD = "made_with.json"

Facts = dict[str, float]


def make_folder(
    folder: Path,
    settings: Mapping[str, Any],
    fill: Callable[[Path], Facts],
    *,
    overwrite: bool,
) -> Facts:
    """Makes a folder, unless it is there and was made with the same settings.

    Args:
        folder: where it will appear, whole; an empty one there is used up.
        settings: everything the content depends on, as JSON can hold it.
        fill: writes the content into the folder it is given and returns its facts.
        overwrite: makes it anew over one that this function made.

    Returns:
        The facts that ``fill`` returned, now or when the folder was made.

    Raises:
        UserError: other things are in the way, or the folder cannot be written.
    """
    record = _own_record(folder, settings, overwrite=overwrite)
    if record and not overwrite:
        return record["facts"]
    partial = folder.with_name(f"{PARTIAL}{folder.name}")
    with naming(folder):
        partial.mkdir(parents=True, exist_ok=True)
    with alone_in(partial):
        try:
            with naming(folder):
                _empty(partial)  # of what a killed one left
                facts = fill(partial)
                _write_record(partial, settings, facts)
                if record:
                    shutil.rmtree(folder)
                partial.replace(folder)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    return facts


@contextlib.contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Runs while no other process runs so in that folder, as far as the file system
    has locks.

    Raises:
        UserError: another process does.
    """
    with naming(folder):
        handle = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):
            if not take_lock(handle):
                raise UserError(
                    f"{folder}: the same command is running there; wait for it, or "
                    "choose another folder"
                )
        yield
    finally:
        os.close(handle)


def _empty(folder: Path) -> None:
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def begin_folder(
    folder: Path, settings: Mapping[str, Any], *, overwrite: bool
) -> Facts | None:
    """Opens a folder that is filled step by step, over several runs if need be.

    Args:
        folder: made if missing; what an earlier run with these settings left stays.
        settings: everything the content depends on, as JSON can hold it.
        overwrite: empties one that this function opened before.

    Returns:
        The facts of ``finish_folder`` if an earlier run got there, else None.

    Raises:
        UserError: other things are in the way, or the folder cannot be written.
    """
    record = _own_record(folder, settings, overwrite=overwrite)
    if record and not overwrite:
        return record["facts"]
    with naming(folder):
        if record:
            shutil.rmtree(folder)
        folder.mkdir(parents=True, exist_ok=True)
        _write_record(folder, settings, None)
    return None


def finish_folder(folder: Path, facts: Facts) -> None:
    """Records that a folder which ``begin_folder`` opened is complete."""
    record = read_record(folder)
    assert record is not None, folder
    _write_record(folder, record["settings"], facts)


def _own_record(
    folder: Path, settings: Mapping[str, Any], *, overwrite: bool
) -> dict[str, Any] | None:
    """The record of a folder that may be used with these settings, if it has one."""
    settings = json.loads(json.dumps(settings))  # as a record holds them
    record = read_record(folder)
    if record is None and folder.exists() and _is_occupied(folder):
        raise UserError(f"{folder}: not made by this program; choose another folder")
    if record and not overwrite and record["settings"] != settings:
        raise UserError(
            f"{folder}: made with other settings ({_difference(record, settings)}); "
            "choose another folder, or --overwrite"
        )
    return record


def _write_record(
    folder: Path, settings: Mapping[str, Any], facts: Facts | None
) -> None:
    content = json.dumps({"settings": settings, "facts": facts}, indent=2)
    write_text(folder / RECORD, content + "\n")


def _is_occupied(folder: Path) -> bool:
    if not folder.is_dir():
        return True
    return not all(map(listing.is_metadata, folder.iterdir()))


def read_record(folder: Path) -> dict[str, Any] | None:
    """The record of a folder that ``make_folder`` made."""
    try:
        record = json.loads((folder / RECORD).read_text())
    except (OSError, ValueError):
        return None
    is_ours = isinstance(record, dict) and {"settings", "facts"} <= record.keys()
    return record if is_ours else None


def _difference(record: Mapping[str, Any], settings: Mapping[str, Any]) -> str:
    """The first setting that differs, old and new."""
    old = record["settings"]
    keys = [*settings, *(key for key in old if key not in settings)]
    key = next(key for key in keys if old.get(key) != settings.get(key))
    return f"{key} was {old.get(key)}, now {settings.get(key)}"
