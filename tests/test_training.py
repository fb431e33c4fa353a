# SPDX-License-Identifier: Apache-2.0
"""The train step: learning, who learns from what, devices, NaNs, resuming."""

import dataclasses

import chex
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from internal import parallel
from internal.cameras import cast_rays
from internal.cli import load_split
from internal.color import expose, linear_to_srgb, srgb_to_linear
from internal.configs import load_config
from internal.enhancements.look import NEUTRAL
from internal.errors import Diverged
from internal.models import Model
from internal.scene import noise
from internal.training import optimizer, sampler
from internal.training import step as training
from tests.conftest import TINY_MODEL, bindings


def make_run(
    config, cameras, images, space, devices=None, observe=noise.ideal_photo, gains=None
):
    """A function that runs steps from a state, and the initial state."""
    gains = np.ones((len(images), 3), np.float32) if gains is None else gains
    mesh = parallel.data_mesh(config.train.batch_size, devices)
    model = Model(config.model)
    step = jax.jit(training.make_train_step(config, model, mesh, 0.1, observe))
    fixed = parallel.replicate(
        (cameras, space, sampler.resident_pixels(images, gains, sampler.Chances())),
        mesh,
    )
    state = parallel.replicate(training.initial_state(config, model), mesh)

    def run(state, steps):
        state, stats = step(state, *fixed)
        for _ in range(steps - 1):
            state, stats = step(state, *fixed)
        return state, stats

    return run, state


@pytest.fixture(scope="module")
def tiny_run(tiny_config, tiny_cameras, tiny_images, ndc):
    return make_run(tiny_config, tiny_cameras, tiny_images, ndc, jax.devices()[:1])


@pytest.mark.parametrize("most", [10.0, 0.0], ids=["resident", "fed"])
def test_a_step_moves_nothing_but_its_batch_between_host_and_devices(night, most):
    """No copy that nobody asked for: each would make the devices wait."""
    config = load_config([], [*bindings(night), f"Config.max_image_memory = {most}"])
    model, scene = Model(config.model), load_split(config, "train")
    mesh = parallel.data_mesh(config.train.batch_size)
    state = parallel.replicate(training.initial_state(config, model), mesh)
    take_step = training.compiled_step(
        config, model, scene, mesh, sampler.find_chances(scene, config)
    )
    state, _ = take_step(state, 0)
    with jax.transfer_guard("disallow"):
        state, _ = take_step(state, 1)
    assert int(state.step) == 2


def test_four_devices_give_what_one_gives(
    tiny_run, tiny_config, tiny_cameras, tiny_images, ndc
):
    run_one, state = tiny_run
    run_four, state_four = make_run(tiny_config, tiny_cameras, tiny_images, ndc)
    one, stats_one = run_one(state, 5)
    four, stats_four = run_four(state_four, 5)
    assert len(jax.tree.leaves(four.params)[0].sharding.device_set) == 4
    chex.assert_trees_all_close(stats_one.terms, stats_four.terms, rtol=1e-4)
    chex.assert_trees_all_close(one.params, four.params, atol=2e-5)


def test_the_enhancement_rests_until_enhancement_starts_and_then_learns_alone(tiny_run):
    run, start = tiny_run
    before, _ = run(start, 3)
    chex.assert_trees_all_equal(
        before.params["enhancement"], start.params["enhancement"]
    )
    after, stats = run(before, 1)
    changes = jax.tree.map(
        lambda a, b: float(jnp.max(jnp.abs(a - b))),
        after.params["enhancement"],
        before.params["enhancement"],
    )
    # A fresh Adam moves every weight that has a gradient by its learning rate.
    assert max(jax.tree.leaves(changes)) == pytest.approx(1e-3, rel=0.05)
    assert stats.terms["exposure"] > 0


def test_the_field_does_not_feel_the_enhancement(
    tiny_run, tiny_cameras, tiny_images, ndc
):
    run, state = tiny_run
    loud = load_config([], [*TINY_MODEL, "Gamma.exposure = 1e3"])
    run_loud, _ = make_run(loud, tiny_cameras, tiny_images, ndc, jax.devices()[:1])
    quiet, loud = run(state, 5)[0], run_loud(state, 5)[0]
    chex.assert_trees_all_equal(quiet.params["field"], loud.params["field"])


def test_steps_lower_the_loss(tiny_cameras, ndc):
    config = load_config(
        [], [*TINY_MODEL, "Train.max_steps = 60", "Optimizer.lr_init = 1e-2"]
    )
    images = tuple(np.full((8, 10, 3), 9000, np.uint16) for _ in range(3))
    run, state = make_run(config, tiny_cameras, images, ndc, jax.devices()[:1])
    state, first = run(state, 1)
    _, last = run(state, 59)
    assert last.terms["data"] < 0.05 * first.terms["data"]
    assert last.psnr > first.psnr + 5


def test_same_seed_same_run(tiny_run):
    run, state = tiny_run
    chex.assert_trees_all_equal(run(state, 3)[0], run(state, 3)[0])


def test_a_step_that_is_not_finite_keeps_the_state_and_is_named(tiny_run):
    run, state = tiny_run
    state, _ = run(state, 4)
    poisoned = jax.tree.map(lambda x: x, state)
    layer = poisoned.params["field"]["basis"]["Dense_1"]["Dense_0"]
    layer["bias"] = layer["bias"] * jnp.nan
    kept, stats = run(poisoned, 1)
    assert not stats.finite
    chex.assert_trees_all_equal(kept, poisoned)
    with pytest.raises(Diverged, match=r"step 5: .*loss data"):
        training.check_finite(stats, 5)


@pytest.mark.parametrize("group", ["field", "enhancement"])
def test_a_gradient_that_is_not_finite_keeps_the_state(group):
    params = {name: {"w": jnp.ones(2)} for name in ("field", "enhancement")}
    adam = optax.adam(0.1)
    state = training.TrainState(jnp.int32(3), params, adam.init(params))
    terms = {"data": jnp.ones(())}
    moved, _, finite = training.apply_if_finite(adam, state, params, terms)
    assert finite and moved.step == 4
    broken = params | {group: {"w": jnp.array([1.0, jnp.inf])}}
    kept, norms, finite = training.apply_if_finite(adam, state, broken, terms)
    assert not finite and not jnp.isfinite(norms[group])
    chex.assert_trees_all_equal(kept, state)


def test_each_step_draws_samples_of_its_own_even_of_the_same_pixels(
    tiny_config, tiny_cameras, tiny_images, ndc
):
    mesh = parallel.data_mesh(8, jax.devices()[:1])
    model = Model(tiny_config.model)
    step = jax.jit(training.make_train_step(tiny_config, model, mesh, 0.1))
    ones = np.ones((3, 3), np.float32)
    source = sampler.resident_pixels(tiny_images, ones, sampler.Chances())
    batch = source.batch(tiny_cameras, tiny_config.train, 2, jnp.int32(0))
    start = training.initial_state(tiny_config, model)

    def psnr(number):
        state = dataclasses.replace(start, step=jnp.int32(number))
        _, stats = step(state, tiny_cameras, ndc, sampler.FedPixels(batch))
        return stats.psnr

    seen = [psnr(number) for number in (0, 1, 0)]
    assert seen[0] == seen[2] != seen[1]


def test_distortion_has_grown_by_as_much_as_is_done_of_the_training(
    tiny_config, tiny_cameras, tiny_images, ndc
):
    mesh, model = parallel.data_mesh(8, jax.devices()[:1]), Model(tiny_config.model)
    ones = np.ones((3, 3), np.float32)
    source = sampler.resident_pixels(tiny_images, ones, sampler.Chances())
    train = dataclasses.replace(tiny_config.train, max_steps=200)
    state = training.initial_state(tiny_config, model)
    state = dataclasses.replace(state, step=jnp.int32(100))

    def distortion(growth):
        losses = dataclasses.replace(tiny_config.losses, distortion_growth=growth)
        config = dataclasses.replace(tiny_config, train=train, losses=losses)
        step = jax.jit(training.make_train_step(config, model, mesh, 0.1))
        return float(step(state, tiny_cameras, ndc, source)[1].terms["distortion"])

    assert distortion(9.0) == pytest.approx(3.0 * distortion(1.0), rel=1e-5)


def test_finite_steps_pass_the_check(tiny_run):
    run, state = tiny_run
    _, stats = run(state, 1)
    training.check_finite(stats, 1)
    training.check_finite(None, 0)
    numbers = training.log_numbers(stats)
    assert {
        "psnr",
        "loss/data",
        "grad_norm/field",
        "grad_norm/enhancement",
    } <= numbers.keys()


def test_learning_rate_warms_up_and_decays():
    config = load_config([], []).optimizer
    schedule = optimizer.field_schedule(config, 105_000)
    assert schedule(0) == pytest.approx(1e-5, rel=1e-3)
    assert schedule(2500) == pytest.approx(1e-3, rel=1e-3)
    assert schedule(105_000) == pytest.approx(1e-5, rel=1e-2)


def test_parts_of_a_batch_average_to_the_whole(tiny_cameras, tiny_images):
    resident = sampler.resident_pixels(
        tiny_images, np.ones((3, 3), np.float32), sampler.Chances()
    )
    train = load_config([], TINY_MODEL).train
    key = jax.random.key(0)
    batch = resident.batch(tiny_cameras, train, 2, jnp.int32(0))

    def work(batch, key):
        return {"mean": jnp.mean(batch.rgb()), "sum": jnp.mean(batch.pixels.x)}

    def drawn(batch, key):
        return jnp.stack([jax.random.uniform(key), jax.random.uniform(key) ** 2])

    first, second = training.mean_over_parts(drawn, batch, key, 4)
    assert second > first**2 + 1e-3  # each part draws for itself

    whole = training.mean_over_parts(work, batch, key, 1)
    for passes in (2, 4, 8):
        parts = training.mean_over_parts(work, batch, key, passes)
        chex.assert_trees_all_close(parts, whole, rtol=1e-5)


def test_a_step_in_passes_learns_like_one_in_one(tiny_cameras, tiny_images, ndc):
    """Not the same samples along the rays, but the same pixels and losses."""
    results = []
    for passes in (1, 2):
        config = load_config([], [*TINY_MODEL, f"Train.passes = {passes}"])
        run, state = make_run(config, tiny_cameras, tiny_images, ndc, jax.devices()[:1])
        results.append(run(state, 5)[1])
    chex.assert_trees_all_close(
        results[0].terms["data"], results[1].terms["data"], rtol=0.2
    )


def test_photos_are_compared_with_what_is_observed_of_colours(
    tiny_config, tiny_cameras, ndc
):
    """A camera that sees one grey whatever the scene, and photos of that grey."""
    grey = 9000
    images = tuple(np.full((8, 10, 3), grey, np.uint16) for _ in range(3))

    def observe(rgb):
        return jnp.full_like(rgb, grey / 65535)

    one_device = jax.devices()[:1]
    run, state = make_run(tiny_config, tiny_cameras, images, ndc, one_device, observe)
    _, stats = run(state, 1)
    assert stats.terms["data"] < 1e-9
    assert stats.psnr > 90


def test_known_exposures_explain_the_photos_and_leave_the_scene(tiny_cameras, ndc):
    """Photos of one grey under three exposures; the scene learnt is the grey."""
    grey = 0.2
    gains = np.array([0.5, 1.0, 2.0], np.float32)
    photos = linear_to_srgb(gains * np.asarray(srgb_to_linear(grey)))
    images = tuple(np.full((8, 10, 3), 65535 * float(p), np.uint16) for p in photos)
    config = load_config(
        [], [*TINY_MODEL, "Train.max_steps = 150", "Optimizer.lr_init = 1e-2"]
    )
    run, state = make_run(
        config, tiny_cameras, images, ndc, jax.devices()[:1],
        gains=np.tile(gains[:, None], 3),
    )  # fmt: skip
    state, stats = run(state, 150)
    assert stats.psnr > 25
    index = jnp.arange(3)
    rays = jax.jit(cast_rays)(tiny_cameras, ndc, index, index, index)
    model = Model(config.model)
    rendering = jax.jit(model.apply)({"params": state.params}, rays, ndc, NEUTRAL)
    np.testing.assert_allclose(rendering.rgb, grey, atol=0.04)


def test_a_gain_of_one_changes_no_bit():
    srgb = jax.random.uniform(jax.random.key(0), (50, 3)) * 1.2
    np.testing.assert_array_equal(expose(srgb, jnp.ones((50, 3))), srgb)
    brighter = expose(srgb, jnp.full((50, 3), 2.0))
    np.testing.assert_allclose(
        srgb_to_linear(brighter), 2 * srgb_to_linear(srgb), rtol=1e-4
    )
