# SPDX-License-Identifier: Apache-2.0
"""What is written as transforms.json is read back as the same scene."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from internal.cameras import Lens
from internal.scene import readers
from internal.scene.transforms_file import (
    DISTORTION_TERMS,
    SINGLE_FILE,
    View,
    write_single,
    write_split,
)
from tests.scene_writers import facing_world, write_pictures

WORLD = facing_world()
FILES = [f"images/{name}" for name in WORLD.names]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    write_pictures(folder / "images", WORLD.names)
    return folder


def lenses(model):
    """What makes a lens of a model; no term is 0, for without any it is a pinhole."""
    sizes, focal, middle = (
        st.integers(20, 5000),
        st.floats(0.3, 4.0),
        st.floats(0.3, 0.7),
    )
    distortion = [st.floats(0.001, 0.5)] * len(DISTORTION_TERMS[model])

    def in_pixels(size, shares, terms):
        return model, *size, tuple(np.multiply(shares, size * 2).tolist()) + terms

    return st.builds(
        in_pixels,
        st.tuples(sizes, sizes),
        st.tuples(focal, focal, middle, middle),
        st.tuples(*distortion),
    )


SIX_LENSES = st.sampled_from(sorted(DISTORTION_TERMS)).flatmap(
    lambda model: st.tuples(*[lenses(model)] * len(FILES))
)
BOUNDS = st.tuples(st.floats(0.01, 1.0), st.floats(2.0, 900.0))


def read(folder, loader):
    return readers.read_files(folder, loader, "")


@settings(max_examples=30)
@given(SIX_LENSES, st.sets(st.sampled_from(FILES), max_size=5), st.none() | BOUNDS)
def test_a_single_file_reads_back_as_it_was_written(folder, through, test, bounds):
    through = tuple(Lens(*made_of) for made_of in through)
    views = map(View, FILES, through, WORLD.camtoworlds)
    write_single(folder, list(views), test=test, bounds=bounds)
    files = read(folder, "nerfstudio")
    assert files.image_paths == tuple(folder / file for file in FILES)
    np.testing.assert_array_equal(files.camtoworlds, WORLD.camtoworlds)
    assert files.lenses == through
    assert (files.test_names or set()) == {file.split("/")[1] for file in test}
    expected = np.array([bounds] * len(FILES) if bounds else []).reshape(-1, 2)
    np.testing.assert_array_equal(files.bounds, expected)


@settings(max_examples=10)
@given(lenses("PINHOLE"), BOUNDS, st.integers(1, len(FILES) - 1))
def test_files_per_split_read_back_as_they_were_written(folder, lens, bounds, tested):
    lens = Lens(*lens)
    views = [
        View(*entry) for entry in zip(FILES, [lens] * 6, WORLD.camtoworlds, strict=True)
    ]
    write_split(folder, "train", views[tested:], bounds)
    write_split(folder, "test", views[:tested], bounds)
    files = read(folder, "blender")
    np.testing.assert_array_equal(files.camtoworlds, WORLD.camtoworlds)
    assert set(files.lenses) == {lens}
    assert files.test_names == set(WORLD.names[:tested])
    np.testing.assert_array_equal(files.bounds, [bounds] * len(FILES))


def test_nerfstudio_finds_all_three_lists_or_none(folder):
    """Its nerfstudio_dataparser.py stops where one of them is missing."""
    lens = Lens("PINHOLE", 24, 18, (20.0, 20.0, 12.0, 9.0))
    views = [View(file, lens, WORLD.camtoworlds[0]) for file in FILES]
    for test in ([], FILES[:2]):
        write_single(folder, views, test=test)
        content = json.loads((folder / SINGLE_FILE).read_text())
        stated = [content.get(f"{s}_filenames") for s in ("train", "val", "test")]
        assert stated == ([FILES[2:], test, test] if test else [None] * 3)
