# SPDX-License-Identifier: Apache-2.0
"""Where photos have detail, and how much more often a training draws there."""

import dataclasses

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from internal import parallel
from internal.configs import TrainConfig
from internal.training import sampler
from internal.training.detail import FLOOR, STEPS, TILE, Detail, find_detail

TRAIN = TrainConfig(batch_size=20_000, enhance_start=10, seek_detail=True)
SAMPLE = jax.jit(sampler.sample_pixels, static_argnums=(1, 2))
BEFORE, AFTER = jnp.int32(9), jnp.int32(10)


def photo(height: int = 64, width: int = 96) -> np.ndarray:
    """Even light with a checkered square of 32 pixels, whose cells are 4 pixels."""
    image = np.full((height, width, 3), 4000, np.uint16)
    rows, columns = np.indices((32, 32)) // 4
    image[16:48, 16:48] += (3000 * ((rows + columns) % 2))[..., None].astype(np.uint16)
    return image


def at(detail: Detail, view: int, x: int, y: int) -> float:
    return float(detail.at(jnp.int32(view), jnp.int32(x), jnp.int32(y)))


def test_detail_lies_where_light_changes_whatever_the_exposure():
    """Also of a photo whose sides are no multiples of a tile, the second here."""
    images = [photo(), photo(63, 93), photo() // 4]
    detail = find_detail(images)
    for view in range(3):
        assert at(detail, view, 32, 32) > 4 * at(detail, view, 80, 8)
        assert at(detail, view, 80, 8) == pytest.approx(FLOOR, abs=0.02)
        assert at(detail, view, 92, 62) == pytest.approx(FLOOR, abs=0.02)
    assert detail.tiles.mean() / STEPS == pytest.approx(1.0, abs=0.05)
    size = 64 * 96 // TILE**2
    np.testing.assert_allclose(detail.tiles[:size], detail.tiles[-size:], atol=1)


def test_a_large_photo_has_the_detail_of_the_small_one(monkeypatch):
    small = find_detail([photo()])
    monkeypatch.setattr("internal.training.detail.MOST_PIXELS", 64 * 96)
    large = find_detail([photo().repeat(5, axis=0).repeat(5, axis=1)[:318]])
    np.testing.assert_array_equal(large.tiles, small.tiles)
    for x, y in ((32, 32), (80, 8), (95, 62)):
        assert at(large, 0, 5 * x + 3, 5 * y + 3) == at(small, 0, x, y)


def test_what_is_masked_has_no_part_in_it():
    mask = np.ones((64, 96), bool)
    mask[10:30, 50:83] = False
    own = photo()
    covered = np.where(mask[..., None], own, np.uint16(65535))
    one, other = (find_detail([image], [mask]) for image in (own, covered))
    np.testing.assert_array_equal(one.tiles, other.tiles)
    assert at(one, 0, 66, 8) == pytest.approx(FLOOR, abs=0.02)  # beside the mask
    chex.assert_trees_all_equal(
        find_detail([own, own], [np.zeros_like(mask), ~mask]).starts,
        find_detail([own, own]).starts,
    )


def test_of_two_pixels_the_richer_is_taken_as_much_more_often(tiny_cameras):
    """Ten columns and eight rows in tiles of 4: the first tile of each row has three
    times the detail of the other two."""
    tiles = np.tile(np.round(np.array([3.0, 1.0, 1.0]) * STEPS / 2), 2)
    starts, across = np.array([0, 6, 12], np.int32), np.full(3, 3, np.int32)
    sides = np.full(3, 4, np.int32)
    detail = Detail(np.tile(tiles, 3).astype(np.uint8), starts, across, sides)
    pixels = SAMPLE(tiny_cameras, TRAIN, 0, BEFORE, sampler.Chances(detail=detail))
    rich = 0.4  # of the pixels
    expected = rich**2 + 2 * rich * (1 - rich) * 0.75
    assert np.mean(np.asarray(pixels.x) < 4) == pytest.approx(expected, abs=0.01)
    counts = np.zeros((3, 8, 10), int)
    np.add.at(counts, tuple(map(np.ravel, (pixels.view, pixels.y, pixels.x))), 1)
    for part in (counts[:, :, :4], counts[:, :, 4:]):  # alike for all that are alike
        assert np.ptp(part) < 0.6 * part.mean()
    assert np.ptp(counts.sum(axis=(1, 2))) < 300
    plain, seeking = (
        SAMPLE(tiny_cameras, TRAIN, 0, AFTER, chances)
        for chances in (sampler.Chances(), sampler.Chances(detail=detail))
    )
    chex.assert_trees_all_equal(plain, seeking)


def test_a_fed_batch_that_seeks_detail_equals_the_resident_one(
    tiny_config, tiny_cameras, tiny_images
):
    train = tiny_config.train
    on_host = dataclasses.replace(tiny_config, max_image_memory=0.0)
    mesh = parallel.data_mesh(train.batch_size)
    inputs = (tiny_images, np.ones((3, 3), np.float32), tiny_cameras, mesh)
    seeking = sampler.Chances(detail=find_detail(tiny_images))
    resident, fed, alike = (
        sampler.pixel_source(*inputs, config, chances)(1).batch(
            tiny_cameras, train, 2, jnp.int32(1)
        )
        for config, chances in (
            (tiny_config, seeking), (on_host, seeking), (tiny_config, sampler.Chances())
        )
    )  # fmt: skip
    chex.assert_trees_all_equal(resident, fed)
    assert not np.array_equal(resident.pixels.x, alike.pixels.x)
