# SPDX-License-Identifier: Apache-2.0
"""Files that appear under their name only when they are whole, and what is whole of
those that grow line by line."""

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from internal.errors import UserError


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Turns an ``OSError`` of writing into a ``UserError`` that names ``path``."""
    try:
        yield
    except OSError as error:
        raise UserError(
            f"{path}: cannot write ({error.strerror}); free space or pick a folder"
        ) from error


@contextlib.contextmanager
def writing(path: Path) -> Iterator[Path]:
    """Yields the name to write to, in the same folder, and then renames it to ``path``.

    Nothing is left behind when the body fails. The name's ending is kept.

    Raises:
        UserError: the folder cannot be written or the disk is full.
    """
    partial = path.with_name(f".partial-{path.name}")
    try:
        with naming(path):
            yield partial
            partial.replace(path)
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)


def whole_lines(path: Path) -> list[Any]:
    """The values of a file of JSON lines; none if there is no file. A line that was
    cut short, by an interruption or a full disk, is left out."""
    values = []
    for line in path.read_text().splitlines() if path.is_file() else ():
        with contextlib.suppress(ValueError):
            values.append(json.loads(line))
    return values
