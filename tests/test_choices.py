# SPDX-License-Identifier: Apache-2.0
"""What is masked is never drawn, what is not is drawn evenly, and a training, its
metering and its numbers know nothing of what is under a mask."""

import dataclasses

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from internal import parallel
from internal.color import from_uint16
from internal.configs import TrainConfig, load_config
from internal.enhancements.tone import Tone
from internal.errors import UserError
from internal.files import image_io
from internal.models import Model
from internal.scene.config import SceneConfig
from internal.scene.noise import expected_photo
from internal.scene.scene import Scene, load_scene
from internal.training import exposure, sampler
from internal.training.choices import find_choices
from internal.training.step import initial_state, make_train_step
from tests.conftest import TINY_ENHANCED, TINY_MLP, TINY_MODEL, TINY_SIZES
from tests.scene_writers import facing_world, write_llff

GAINS = np.ones((3, 3), np.float32)
TRAIN = TrainConfig(batch_size=500, enhance_start=10)
BEFORE, AFTER = jnp.int32(9), jnp.int32(10)
PATCH = ((0, 1, 0), (0, 0, 1))
SAMPLE = jax.jit(sampler.sample_pixels, static_argnums=(1, 2))
NTH = jax.jit(lambda choice, view, rank: choice.nth(view, rank))


def some_masks(seed: int, share: float, shapes=((8, 10),) * 3) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [rng.random(shape) < share for shape in shapes]


@given(st.integers(0, 1000), st.floats(0.02, 1.0))
@settings(max_examples=10)
def test_the_nth_pixel_is_the_nth_that_counts(seed, share):
    masks = some_masks(seed, share, ((3, 50), (7, 1), (40, 33), (1, 64)))
    choice = find_choices(masks, (0,), (0,)).singles
    np.testing.assert_array_equal(choice.counts, [mask.sum() for mask in masks])
    np.testing.assert_array_equal(choice.views, np.flatnonzero(choice.counts))
    view, rank = (jnp.asarray(x.ravel()) for x in np.indices((4, 40 * 33)))
    found = np.asarray(NTH(choice, view, rank)).reshape(4, -1)
    for own, mask in zip(found, masks, strict=True):
        np.testing.assert_array_equal(own[: mask.sum()], np.flatnonzero(mask))


def test_every_pixel_that_counts_is_drawn_and_as_often(tiny_cameras):
    masks = some_masks(0, 0.4)
    choices = sampler.choices_of(masks, 2)
    train = dataclasses.replace(TRAIN, batch_size=20_000)
    pixels = SAMPLE(tiny_cameras, train, 2, BEFORE, sampler.Chances(choices))
    drawn = np.zeros((3, 8, 10), int)
    np.add.at(drawn, tuple(np.ravel(p) for p in (pixels.view, pixels.y, pixels.x)), 1)
    np.testing.assert_array_equal(drawn > 0, masks)
    for view, mask in enumerate(masks):  # photos evenly, then pixels
        assert drawn[view].sum() == 20_000
        assert np.ptp(drawn[view][mask]) <= 2  # begun and ended within a round


@pytest.mark.parametrize("neighbors", [0, 2])
@pytest.mark.parametrize("step", [BEFORE, AFTER])
def test_what_is_masked_is_never_drawn_not_even_as_a_neighbour(
    tiny_cameras, neighbors, step
):
    masks = np.array(some_masks(1, 0.6))
    masks[1] = np.indices((8, 10)).sum(0) % 2 == 0  # a board without a patch
    choices = sampler.choices_of(list(masks), neighbors)
    pixels = SAMPLE(tiny_cameras, TRAIN, neighbors, step, sampler.Chances(choices))
    view, x, y = (np.asarray(p) for p in (pixels.view, pixels.x, pixels.y))
    assert masks[view, y, x].all()
    if neighbors and step == AFTER:
        for member, (column, row) in enumerate(zip(*PATCH, strict=True)):
            np.testing.assert_array_equal(x[:, member] - x[:, 0], column)
            np.testing.assert_array_equal(y[:, member] - y[:, 0], row)
        assert set(np.unique(view)) == {0, 2}
        corners = masks[:, :-1, :-1] & masks[:, 1:, :-1] & masks[:, :-1, 1:]
        drawn = {tuple(p) for p in np.stack([view, y, x], -1)[:, 0]}
        assert drawn == {tuple(p) for p in np.argwhere(corners)}


def test_masks_without_a_patch_are_one_line():
    board = np.indices((8, 10)).sum(0) % 2 == 0
    assert sampler.choices_of([board], 0) is not None
    with pytest.raises(UserError, match="leave no 3 neighbouring pixels"):
        sampler.choices_of([board], 2)


def test_a_fed_batch_of_masked_photos_equals_the_resident_one(
    tiny_config, tiny_cameras, tiny_images
):
    mesh = parallel.data_mesh(tiny_config.train.batch_size)
    on_host = dataclasses.replace(tiny_config, max_image_memory=0.0)
    inputs = (tiny_images, GAINS, tiny_cameras, mesh)
    chances = sampler.Chances(sampler.choices_of(some_masks(2, 0.5), 2))
    resident = sampler.pixel_source(*inputs, tiny_config, chances)
    fed = sampler.pixel_source(*inputs, on_host, chances)
    arguments = (tiny_cameras, tiny_config.train, 2, jnp.int32(5))
    one = jax.jit(resident(5).batch, static_argnums=(1, 2))(*arguments)
    chex.assert_trees_all_equal(one, fed(5).batch(*arguments))


@pytest.fixture(scope="module")
def twins(tmp_path_factory) -> list[Scene]:
    """Two scenes that differ under their masks alone, in their files and, should these
    be forgotten there, in memory."""
    world = facing_world()
    rng = np.random.default_rng(0)
    own = rng.uniform(0.0, 0.3, (6, 18, 24, 3))
    masks = rng.random((6, 18, 24)) < 0.7
    scenes = []
    for rubbish in (0.0, 1.0):
        folder = tmp_path_factory.mktemp("twin")
        write_llff(folder, world)
        (folder / "masks").mkdir()
        for photo, mask, name in zip(own, masks, world.names, strict=True):
            shown = np.where(mask[..., None], photo, rubbish)
            image_io.write(folder / "images" / name, np.asarray(shown, np.float32))
            white = np.repeat(mask[..., None], 3, -1).astype(np.float32)
            image_io.write(folder / "masks" / name, white)
        scenes.append(load_scene(SceneConfig(str(folder), unrounded=True), "train"))
    images = [
        np.where(mask[..., None], image, np.uint16(50_000))
        for image, mask in zip(scenes[1].images, scenes[1].masks, strict=True)
    ]
    return [scenes[0], dataclasses.replace(scenes[1], images=images)]


def test_training_is_the_same_whatever_is_under_the_masks(twins):
    """Gamma with its patches, a data term that knows brightness and noise."""
    own = ["Losses.data_eps_of_mean = 0.1", "Losses.observation = 'noisy'"]
    own += ["Model.num_samples = (4,)", "MLP.depth = 1"]
    config = load_config([], [*TINY_MODEL, *own])
    mesh = parallel.data_mesh(config.train.batch_size, jax.devices()[:1])
    model = Model(config.model)
    first, second = twins
    assert (first.brightness, first.noise) == (second.brightness, second.noise)
    known = (first.brightness, expected_photo(first.noise))
    step = jax.jit(make_train_step(config, model, mesh, *known))
    inputs = parallel.replicate((first.cameras, first.space), mesh)
    begun = parallel.replicate(initial_state(config, model), mesh)
    trained = []
    for scene in twins:
        arguments = (scene.images, scene.gains, scene.cameras, mesh, config)
        chances = sampler.find_chances(scene, config)
        pixels = sampler.pixel_source(*arguments, chances)(0)
        state, stats = begun, None
        for _ in range(config.train.max_steps):
            state, stats = step(state, *inputs, pixels)
        trained.append((state, stats))
    chex.assert_trees_all_equal(*trained)
    state, _ = trained[-1]
    assert int(state.step) == config.train.max_steps > config.train.enhance_start


def test_a_training_knows_its_scenes_masks(twins, tiny_config):
    board = np.indices((18, 24)).sum(0) % 2 == 0
    scene = dataclasses.replace(twins[0], masks=(board,) * 5)
    with pytest.raises(UserError, match="leave no 3 neighbouring pixels"):
        sampler.find_chances(scene, tiny_config)


def test_metering_sees_what_counts_alone(twins):
    model = (*TINY_SIZES, *TINY_MLP, *TINY_ENHANCED)
    tone = load_config([], [*model, "Model.enhancement = @Tone()"])
    first, second = (exposure.metered(tone, scene) for scene in twins)
    assert first == second
    counted = [i[m] for i, m in zip(twins[0].images, twins[0].masks, strict=True)]
    expected = Tone().metered(from_uint16(np.concatenate(counted)))
    assert first.model.enhancement == expected
    without = dataclasses.replace(twins[1], masks=())
    assert exposure.metered(tone, without) != first
