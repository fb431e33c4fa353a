# SPDX-License-Identifier: Apache-2.0
"""PLY files read back as written, in every encoding, or are refused in one line."""

import random

import numpy as np
import pytest

from internal.errors import UserError
from internal.files import ply

XYZ = np.array([[1.0, 2.0, 3.0], [-4.5, 0.25, 1e3]])
COLORS = np.array([[1, 2, 3], [250, 0, 9]], np.uint8)
ROW = [*((axis, "f8") for axis in "xyz"), *((c, "u1") for c in "rgb")]


def header(kind: str, *before: str) -> bytes:
    lines = ["ply", f"format {kind} 1.0", "comment of another tool", *before]
    lines += ["element vertex 2", *(f"property double {axis}" for axis in "xyz")]
    lines += [*(f"property uchar {c}" for c in "rgb"), "element face 1"]
    lines += ["property list uchar int vertex_indices", "end_header"]
    return "\n".join([*lines, ""]).encode()


def rows(order: str) -> bytes:
    kinds = [(name, kind if kind == "u1" else order + kind) for name, kind in ROW]
    table = np.empty(2, kinds)
    for axis, values in zip("xyz", XYZ.T, strict=True):
        table[axis] = values
    for color, values in zip("rgb", COLORS.T, strict=True):
        table[color] = values
    return table.tobytes()


BEFORE = ("element camera 1", "property float focal", "property int id")
TEXT = "\n".join(
    " ".join(map(str, [*point, *color]))
    for point, color in zip(XYZ, COLORS, strict=True)
)
FILES = {
    "little": header("binary_little_endian") + rows("<") + b"\x03" + bytes(12),
    "big": header("binary_big_endian") + rows(">") + b"\x03" + bytes(12),
    "text": header("ascii") + TEXT.encode() + b"\n3 0 1 0\n",
    "windows": (header("ascii") + TEXT.encode() + b"\n").replace(b"\n", b"\r\n"),
    "after cameras": header("binary_little_endian", *BEFORE) + bytes(8) + rows("<"),
    "text after cameras": header("ascii", *BEFORE) + b"1.5 7\n" + TEXT.encode(),
}


@pytest.mark.parametrize("name", FILES)
def test_vertices_read_as_they_stand_there(tmp_path, name):
    (tmp_path / "x.ply").write_bytes(FILES[name])
    read = ply.read(tmp_path / "x.ply")
    np.testing.assert_array_equal(np.stack([read[a] for a in "xyz"], -1), XYZ)
    np.testing.assert_array_equal(np.stack([read[c] for c in "rgb"], -1), COLORS)


def test_what_is_written_reads_back(tmp_path):
    columns = {"x": XYZ[:, 0].astype(np.float32), "red": COLORS[:, 0]}
    ply.write(tmp_path / "x.ply", columns)
    read = ply.read(tmp_path / "x.ply")
    assert read.dtype.names == ("x", "red")
    for name, values in columns.items():
        np.testing.assert_array_equal(read[name], values)


@pytest.mark.parametrize("name", FILES)
def test_any_damage_ends_in_one_line_or_in_numbers(tmp_path, name):
    """100 files with bytes changed or the end cut off; counts of 10**18 among them."""
    draw = random.Random(name)
    path = tmp_path / "x.ply"
    whole = FILES[name]
    refused = 0
    for number in range(100):
        content = bytearray(whole)
        for _ in range(draw.randrange(1, 6)):
            content[draw.randrange(len(content))] = draw.randrange(256)
        if number % 3 == 0:
            content = content[: draw.randrange(len(content))]
        if number % 10 == 1:
            huge = b"vertex " + str(10**18).encode()
            content = bytearray(whole.replace(b"vertex 2", huge))
        path.write_bytes(bytes(content))
        try:
            ply.read(path)
        except UserError as error:
            refused += 1
            assert str(path) in str(error) and "\n" not in str(error)
    assert refused > 30


@pytest.mark.parametrize("content", [b"", b"ply\n", b"PK\x03\x04"])
def test_what_is_none_is_refused(tmp_path, content):
    path = tmp_path / "x.ply"
    with pytest.raises(UserError, match=r"x\.ply: not a whole PLY file"):
        ply.read(path)
    path.write_bytes(content)
    with pytest.raises(UserError, match=r"x\.ply: not a whole PLY file"):
        ply.read(path)
