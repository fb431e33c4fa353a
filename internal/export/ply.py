# SPDX-License-Identifier: Apache-2.0
"""PLY files with one element, ``vertex``: named columns of numbers, little-endian.

The plain subset that every reader takes, also those that read by position: no
comments, no faces, no alpha beside the colours.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from internal.errors import UserError
from internal.files import atomic

_WORDS = {"<f4": "float", "|u1": "uchar"}
_HEAD = ("ply", "format binary_little_endian 1.0")
_END = b"end_header\n"


def write(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Writes columns of equal length, atomically: uint8 as uchar, others as float."""
    kinds = [
        (name, "|u1" if values.dtype == np.uint8 else "<f4")
        for name, values in columns.items()
    ]
    rows = np.empty(len(next(iter(columns.values()))), kinds)
    for name, values in columns.items():
        rows[name] = values
    header = [
        *_HEAD,
        f"element vertex {len(rows)}",
        *(f"property {_WORDS[kind]} {name}" for name, kind in kinds),
    ]
    with atomic.writing(path) as partial, partial.open("wb") as file:
        file.write("\n".join([*header, ""]).encode("ascii") + _END)
        file.write(rows.tobytes())


def read(path: Path) -> np.ndarray:
    """The rows of a file that ``write`` wrote, a structured array.

    Raises:
        UserError: it is another kind of file, or cut short.
    """
    header, _, body = path.read_bytes().partition(_END)
    head, lines = header.decode("ascii", "replace").splitlines()[:3], []
    lines = header.decode("ascii", "replace").splitlines()[3:]
    kinds = {word: kind for kind, word in _WORDS.items()}
    try:
        count = int(head[2].removeprefix("element vertex "))
        words = [line.removeprefix("property ").split(" ") for line in lines]
        rows = np.frombuffer(body, [(name, kinds[word]) for word, name in words])
    except (IndexError, KeyError, ValueError):
        count, rows = -1, np.empty(0)
    if tuple(head[:2]) != _HEAD or len(rows) != count:
        raise UserError(f"{path}: not a whole PLY file of ours; export it again")
    return rows
