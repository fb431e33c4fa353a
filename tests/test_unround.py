# SPDX-License-Identifier: Apache-2.0
"""Laws of taking the steps of rounding out of colours."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from internal.files import image_io
from internal.scene.config import SceneConfig
from internal.scene.scene import load_scene
from internal.scene.unround import CELL, HALF_STEP, YCC_FROM_RGB, is_rounded, unround
from tests.scene_writers import facing_world, write_llff

# Of a surface that light scales: brownish, so that all three steps differ.
HUE = np.array([1.3, 1.0, 0.7])


def shaded(height: int = 96, width: int = 128) -> np.ndarray:
    """A surface of one hue in light of 1 to 6 levels, in levels."""
    light = np.linspace(1.0, 6.0, width) * np.linspace(0.8, 1.0, height)[:, None]
    return light[..., None] * HUE


def error(levels: np.ndarray, truth: np.ndarray) -> float:
    """Of the colour differences."""
    return float(np.sqrt(np.mean(((levels - truth) @ YCC_FROM_RGB[1:].T) ** 2)))


def through_jpeg(levels: np.ndarray, path) -> np.ndarray:
    image_io.write(path, (levels / 255.0).astype(np.float32), jpeg_quality=90)
    return image_io.read_srgb(path)


def test_the_steps_of_a_jpeg_vanish_from_a_shaded_surface(tmp_path):
    photo = through_jpeg(shaded(), tmp_path / "photo.jpg")
    before, after = error(255 * photo, shaded()), error(255 * unround(photo), shaded())
    assert after < 0.7 * before


def test_hues_leak_over_an_edge_no_farther_than_a_cell():
    """Two surfaces of whole levels, which need no mending."""
    levels = np.full((64, 64, 3), (6.0, 3.0, 1.0))
    levels[:, 32:] = (1.0, 3.0, 6.0)
    moved = 255.0 * unround((levels / 255.0).astype(np.float32))
    beyond = np.abs(np.arange(64) - 31.5) > CELL
    np.testing.assert_allclose(moved[:, beyond], levels[:, beyond], atol=0.25)


@settings(max_examples=30, deadline=None)
@given(
    arrays.arrays(
        np.uint8, st.tuples(st.integers(1, 40), st.integers(1, 40), st.just(3))
    )
)
def test_nothing_that_the_photo_states_is_changed(levels):
    """The result rounds to the photo, and stays within black and white."""
    moved = unround((levels / 255.0).astype(np.float32))
    assert moved.min() >= 0.0 and moved.max() <= 1.0
    assert np.all(np.abs(255.0 * moved - levels) <= HALF_STEP + 1e-3)


@pytest.mark.parametrize("level", [0, 1, 3, 200])
def test_grays_and_black_stay(level):
    gray = np.full((20, 30, 3), level / 255.0, np.float32)
    np.testing.assert_allclose(unround(gray), gray, atol=1e-5)


def test_where_nothing_tells_a_hue_none_is_invented():
    """Neutral noise of zeros and ones: what comes out is gray in the mean."""
    speckle = np.random.default_rng(0).integers(0, 2, (64, 64, 1)).repeat(3, -1)
    moved = 255.0 * unround((speckle / 255.0).astype(np.float32))
    np.testing.assert_allclose(moved, speckle, atol=1e-3)


def test_only_whole_levels_count_as_rounded():
    photo = np.arange(0, 252, dtype=np.float32).reshape(12, 7, 3) / 255.0
    assert is_rounded(photo)
    assert not is_rounded(photo + 0.2 / 255.0)


def test_a_scene_unrounds_what_it_trains_on_and_scores_the_photos_themselves(tmp_path):
    world = facing_world()
    write_llff(tmp_path, world)
    rng = np.random.default_rng(0)
    for name in world.names:
        path = tmp_path / "images" / name
        height, width, _ = image_io.read_srgb(path).shape
        photo = rng.integers(0, 4, (height, width, 3)).astype(np.float32) / 255.0
        image_io.write(path, photo)
    load = {
        split: load_scene(SceneConfig(str(tmp_path)), split)
        for split in ("train", "test")
    }
    moved = {
        split: load_scene(SceneConfig(str(tmp_path), unrounded=True), split)
        for split in ("train", "test")
    }
    same = {
        split: np.array_equal(np.array(load[split].images), np.array(scene.images))
        for split, scene in moved.items()
    }
    assert same == {"train": False, "test": True}
