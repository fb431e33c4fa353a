# SPDX-License-Identifier: Apache-2.0
"""Pixels of a step: neighbours, colours of their own, resident equals fed."""

import dataclasses

import chex
import jax
import jax.numpy as jnp
import numpy as np

from internal import parallel
from internal.configs import TrainConfig
from internal.training import sampler

GAINS = np.array([[1.0, 1.0, 1.0], [0.5, 0.6, 0.7], [2.0, 2.0, 2.0]], np.float32)
EVERY = sampler.Chances()
TRAIN = TrainConfig(batch_size=500, enhance_start=10)
BEFORE, AFTER = jnp.int32(9), jnp.int32(10)


def test_patches_are_a_pixel_its_right_and_its_lower_neighbour(tiny_cameras):
    pixels = sampler.sample_pixels(tiny_cameras, TRAIN, 2, AFTER, EVERY)
    x, y = np.asarray(pixels.x), np.asarray(pixels.y)
    np.testing.assert_array_equal(x[:, 1] - x[:, 0], 1)
    np.testing.assert_array_equal(x[:, 2] - x[:, 0], 0)
    np.testing.assert_array_equal(y[:, 2] - y[:, 0], 1)
    assert x.min() == 0 and x.max() == 9
    assert y.min() == 0 and y.max() == 7
    assert set(np.unique(pixels.view)) == {0, 1, 2}
    assert np.all(pixels.view == pixels.view[:, :1])


def test_before_the_smoothness_loss_every_pixel_is_drawn_by_itself(tiny_cameras):
    pixels = sampler.sample_pixels(tiny_cameras, TRAIN, 2, BEFORE, EVERY)
    drawn = {tuple(p) for p in np.stack(jax.tree.leaves(pixels), -1).reshape(-1, 3)}
    assert len(drawn) == 3 * 10 * 8
    assert np.any(pixels.view != pixels.view[:, :1])


def test_pixels_differ_by_seed_and_step(tiny_cameras):
    drawn = set()
    for seed, step in ((0, 0), (0, 1), (1, 0)):
        train = dataclasses.replace(TRAIN, seed=seed)
        pixels = sampler.sample_pixels(tiny_cameras, train, 0, jnp.int32(step), EVERY)
        drawn.add(np.asarray(pixels.x).tobytes())
    assert len(drawn) == 3


def test_every_member_has_the_colour_of_its_own_pixel(tiny_cameras, tiny_images):
    source = sampler.resident_pixels(tiny_images, GAINS, EVERY)
    for step in (BEFORE, AFTER):
        batch = source.batch(tiny_cameras, TRAIN, 2, step)
        flat = [np.ravel(p) for p in jax.tree.leaves(batch.pixels)]
        expected = [tiny_images[v][y, x] / 65535 for v, x, y in zip(*flat, strict=True)]
        np.testing.assert_allclose(batch.rgb().reshape(-1, 3), expected, atol=1e-7)


def test_pictures_of_different_sizes_live_in_one_array(tiny_cameras):
    images = (
        np.full((4, 5, 3), 1000, np.uint16),
        np.arange(6 * 3 * 3, dtype=np.uint16).reshape(6, 3, 3),
    )
    source = sampler.resident_pixels(images, GAINS[:2], EVERY)
    pixels = sampler.Pixels(*(jnp.array([[k]]) for k in (1, 2, 4)))
    rows = sampler.flat_rows(pixels, source.starts, np.array([5, 3]))
    np.testing.assert_array_equal(source.levels[rows[0, 0]], images[1][4, 2])


def test_a_fed_batch_equals_the_resident_one(tiny_config, tiny_cameras, tiny_images):
    train = tiny_config.train
    mesh = parallel.data_mesh(train.batch_size)
    on_host = dataclasses.replace(tiny_config, max_image_memory=0.0)
    resident = sampler.pixel_source(
        tiny_images, GAINS, tiny_cameras, mesh, tiny_config, EVERY
    )
    fed = sampler.pixel_source(tiny_images, GAINS, tiny_cameras, mesh, on_host, EVERY)
    for step in (0, 5):
        arguments = (tiny_cameras, train, 2, jnp.int32(step))
        one = resident(step).batch(*arguments)
        two = fed(step).batch(*arguments)
        chex.assert_trees_all_equal(one, two)
