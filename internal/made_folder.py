# SPDX-License-Identifier: Apache-2.0
"""Folders that a program makes: whole or absent, made once, never over the user's.

The record beside the content states the settings it was made with and facts about
it, so that a second run with the same settings costs nothing.
"""

import json
import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from internal.errors import UserError

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
    settings = json.loads(json.dumps(settings))
    record = _read_record(folder)
    if record is None and folder.exists() and _is_occupied(folder):
        raise UserError(f"{folder}: not made by this program; choose another folder")
    if record and not overwrite:
        if record["settings"] == settings:
            return record["facts"]
        raise UserError(
            f"{folder}: made with other settings ({_difference(record, settings)}); "
            "choose another folder, or --overwrite"
        )
    partial = folder.with_name(f".partial-{folder.name}-{os.getpid()}")
    try:
        partial.mkdir(parents=True)
        facts = fill(partial)
        content = json.dumps({"settings": settings, "facts": facts}, indent=2)
        (partial / RECORD).write_text(content + "\n")
        if record:
            shutil.rmtree(folder)
        partial.replace(folder)
    except OSError as error:
        raise UserError(
            f"{folder}: cannot write ({error.strerror}); free space or pick a folder"
        ) from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return facts


def _is_occupied(folder: Path) -> bool:
    return not folder.is_dir() or any(folder.iterdir())


def _read_record(folder: Path) -> dict[str, Any] | None:
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
