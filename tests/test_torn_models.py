# SPDX-License-Identifier: Apache-2.0
"""Damaged pose files end at once: with the scene, or with one line that names the file.

Each test reads 100 files with bytes changed, cut out or cut off, by plain seeds.
"""

import dataclasses
import random
from pathlib import Path

import numpy as np
import pytest

from internal.errors import UserError
from internal.scene import colmap
from internal.scene.readers import llff
from tests.scene_writers import facing_world, write_llff, write_model

WORLD = dataclasses.replace(facing_world(), points=facing_world().points[:20])


def damaged(whole: bytes, draw: random.Random) -> bytes:
    content = bytearray(whole)
    for _ in range(draw.randrange(1, 5)):
        place = draw.randrange(
            min(len(content), 400) if draw.random() < 0.7 else len(content)
        )
        kind = draw.randrange(4)
        if kind == 0:
            content[place] = draw.randrange(256)
        elif kind == 1:
            content[place : place + 8] = draw.randrange(2**64).to_bytes(8, "little")
        elif kind == 2:
            del content[place : place + draw.randrange(1, 20)]
        elif len(content) > 500:
            del content[-draw.randrange(1, 400) :]
    return bytes(content)


def outcomes(path: Path, read) -> tuple[int, int]:
    """(read, refused) over 100 damages of a file; anything else fails."""
    whole, draw, refused = path.read_bytes(), random.Random(path.name), 0
    for _ in range(100):
        path.write_bytes(damaged(whole, draw))
        try:
            read()
        except UserError as error:
            refused += 1
            assert str(path.parent) in str(error) and "\n" not in str(error)
    path.write_bytes(whole)
    read()
    return 100 - refused, refused


@pytest.mark.parametrize("part", ["cameras", "images", "points3D"])
@pytest.mark.parametrize("binary", [True, False], ids=["bin", "txt"])
def test_a_damaged_colmap_model(tmp_path, part, binary):
    write_model(tmp_path, WORLD, binary)
    path = tmp_path / f"{part}.{'bin' if binary else 'txt'}"
    read, refused = outcomes(path, lambda: colmap.read_model(tmp_path))
    assert refused > 10 and read + refused == 100


def test_a_damaged_llff_file(tmp_path):
    write_llff(tmp_path, WORLD)
    path = tmp_path / "poses_bounds.npy"
    read, refused = outcomes(path, lambda: llff.read(tmp_path, "", "name"))
    assert refused > 10 and read + refused == 100


@pytest.mark.parametrize("header", ["{'descr': '<f8', (", "{", "\x00", "'" * 50])
def test_a_header_of_llff_that_no_parser_takes(tmp_path, header):
    write_llff(tmp_path, WORLD)
    path = tmp_path / "poses_bounds.npy"
    text = header.ljust(117).encode() + b"\n"
    path.write_bytes(b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text)
    with pytest.raises(UserError, match=r"poses_bounds\.npy: not a NumPy file"):
        llff.read(tmp_path, "", "name")


def test_tracks_that_contradict_each_other_are_passed_over(tmp_path):
    """As editors leave them: an image sees points that are not there."""
    write_model(tmp_path, WORLD, binary=False)
    whole = colmap.read_model(tmp_path)
    path = tmp_path / "images.txt"
    lines = path.read_text().split("\n")
    path.write_text("\n".join(line or "10.5 7.5 99999" for line in lines[:-1]) + "\n")
    edited = colmap.read_model(tmp_path)
    assert edited.names == whole.names
    np.testing.assert_array_equal(edited.camtoworlds, whole.camtoworlds)
    np.testing.assert_array_equal(edited.points, whole.points)


def test_a_model_as_an_editor_left_it(captures):
    folder = captures / "orbit/mug/edited/sparse/0"
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    assert len(colmap.read_model(folder).names) == 77
