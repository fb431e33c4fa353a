# SPDX-License-Identifier: Apache-2.0
"""PLY files: the vertices of any, text or binary; written in the plainest subset.

Written is one element, ``vertex``, of named columns of numbers, little-endian, which
every reader takes, also those that read by position: no comments, no faces, no alpha
beside the colours.
"""

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from internal.errors import UserError, one_line
from internal.files import atomic

_WORDS = {"<f4": "float", "|u1": "uchar"}
_HEAD = ("ply", "format binary_little_endian 1.0")
_END = b"end_header\n"
_KINDS = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2"},
    **{"int": "i4", "uint": "u4", "float": "f4", "double": "f8"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"},
    **{"int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"},
}
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclasses.dataclass(frozen=True)
class _Element:
    name: str
    count: int
    row: np.dtype | None  # None: it has lists, so its rows differ in length


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
    """The vertices of a file, a structured array of their properties.

    Raises:
        UserError: it cannot be read, is no PLY file, or is cut short.
    """
    try:
        content = path.read_bytes()
        found = re.search(rb"^end_header[ \t]*\r?\n", content, re.MULTILINE)
        if not (content.startswith(b"ply") and found):
            raise ValueError("it has no header of one")
        lines = content[: found.start()].decode("ascii", "replace").splitlines()
        order, elements = _header([line.split() for line in lines if line.split()])
        body = content[found.end() :]
        return (_text if order == "=" else _binary)(body, elements)
    except (OSError, ValueError, IndexError, KeyError) as error:
        raise UserError(
            f"{path}: not a whole PLY file ({one_line(error)}); export it again"
        ) from error


def _header(lines: list[list[str]]) -> tuple[str, list[_Element]]:
    """The order of bytes ("=": text) and all elements up to the vertices."""
    order, elements = "", []
    for words in lines:
        if words[0] == "format":
            order = _ORDERS[words[1]]
        elif words[0] == "element":
            elements.append(_Element(words[1], int(words[2]), np.dtype([])))
        elif words[0] == "property":
            elements[-1] = _with_property(elements[-1], order, words[1:])
    names = [element.name for element in elements]
    elements = elements[: names.index("vertex") + 1]
    if not order or min(element.count for element in elements) < 0:
        raise ValueError("its header is broken")
    return order, elements


def _with_property(element: _Element, order: str, words: list[str]) -> _Element:
    if words[0] == "list" or element.row is None:
        return dataclasses.replace(element, row=None)
    column = (words[1], order + _KINDS[words[0]])
    return dataclasses.replace(element, row=np.dtype([*element.row.descr, column]))


def _binary(body: bytes, elements: list[_Element]) -> np.ndarray:
    *before, vertices = elements
    if vertices.row is None or any(element.row is None for element in before):
        raise ValueError("lists of numbers stand before or in its vertices")
    start = sum(e.count * e.row.itemsize for e in before if e.row is not None)
    return np.frombuffer(body, vertices.row, vertices.count, start)


def _text(body: bytes, elements: list[_Element]) -> np.ndarray:
    *before, vertices = elements
    if vertices.row is None:
        raise ValueError("lists of numbers stand in its vertices")
    start = sum(element.count for element in before)
    lines = body.decode("ascii", "replace").splitlines()[start:]
    lines = lines[: vertices.count]
    columns = len(vertices.row.descr)
    if len(lines) < vertices.count:
        raise ValueError(f"{len(lines)} of {vertices.count} vertices are there")
    numbers = np.array([line.split() for line in lines], np.float64)
    numbers = numbers.reshape(vertices.count, columns)
    rows = np.empty(vertices.count, vertices.row)
    for name, values in zip(vertices.row.names or (), numbers.T, strict=True):
        rows[name] = values
    return rows
