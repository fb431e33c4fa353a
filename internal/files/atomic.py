# SPDX-License-Identifier: Apache-2.0
"""Files that appear under their name only when they are whole, and what is whole of
those that grow line by line."""

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from internal.errors import UserError

PARTIAL = ".partial-"  # before the name of what is being written
BLOCK = bytes(1 << 20)


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Turns an ``OSError`` into a ``UserError`` that names the file it is about:
    ``path``, which is being written, or one that was to be read."""
    try:
        yield
    except OSError as error:
        check_read(path, error)
        raise UserError(
            f"{path}: cannot write ({error.strerror}); free space or pick a folder"
        ) from error


def check_read(path: Path, error: OSError) -> None:
    """Returns if an error is about writing ``path`` or something in it.

    Raises:
        UserError: it is about another file, which could not be read.
    """
    name = error.filename
    if not isinstance(name, str) or PARTIAL in name:
        return
    if not Path(name).is_relative_to(path):
        raise UserError(
            f"{name}: cannot read ({error.strerror}); put it back, or make it readable"
        ) from error


@contextlib.contextmanager
def writing(path: Path) -> Iterator[Path]:
    """Yields the name to write to, in the same folder, and then renames it to ``path``.

    Nothing is left behind when the body fails. The name's ending is kept.

    Raises:
        UserError: the folder cannot be written or the disk is full.
    """
    partial = path.with_name(f"{PARTIAL}{path.name}")
    try:
        with naming(path):
            yield partial
            partial.replace(path)
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Writes a text file, in UTF-8, whole or not at all.

    Raises:
        UserError: the folder cannot be written or the disk is full.
    """
    with writing(path) as partial:
        partial.write_text(text, encoding="utf-8")


def take_room(folder: Path, size: int) -> None:
    """Writes so many bytes and removes them: for libraries that end the process, or
    whose threads do, where a disk is full.

    Raises:
        OSError: they cannot be written.
    """
    probe = folder / f"{PARTIAL}room"
    try:
        with probe.open("wb") as file:
            for start in range(0, size, len(BLOCK)):
                file.write(BLOCK[: size - start])
    finally:
        with contextlib.suppress(OSError):
            probe.unlink(missing_ok=True)


def ensure_folder(folder: Path) -> None:
    """Makes a folder, with its parents, unless it is there.

    Raises:
        UserError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(
            f"{folder}: cannot be made ({error.strerror}); free space or choose "
            "another folder"
        ) from error


def read_json(path: Path, made_by: str) -> Any:
    """The value in a JSON file that a script wrote.

    Args:
        made_by: which script, for the message.

    Raises:
        UserError: the file is missing, cannot be read or is cut short.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise UserError(f"{path}: not found; make it with {made_by}") from error
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise UserError(
            f"{path}: is cut short or was changed; delete it and run {made_by} again"
        ) from error


def whole_lines(path: Path) -> list[Any]:
    """The values of a file of JSON lines; none if there is no file. A line that was
    cut short, by an interruption or a full disk, is left out."""
    values = []
    for line in path.read_text().splitlines() if path.is_file() else ():
        with contextlib.suppress(ValueError):
            values.append(json.loads(line))
    return values
