# SPDX-License-Identifier: Apache-2.0
"""Two Adams: their clipping and their schedules."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from internal.configs import OptimizerConfig, TrainConfig
from internal.training.optimizer import field_schedule, make_optimizer

TRAIN = TrainConfig(max_steps=10, enhance_start=4)
FLAT = OptimizerConfig(
    lr_init=1e-2, lr_final=1e-2, warmup_steps=1, clip_value=0.0, clip_norm=0.0
)
RESTING = jnp.zeros(2)


def last_update(config: OptimizerConfig, gradients, group: str = "field"):
    """What a group's parameters move by in the last of some steps of training."""
    optimizer = make_optimizer(config, TrainConfig(max_steps=100, enhance_start=0))
    params = {"field": RESTING, "enhancement": RESTING}
    state, updates = optimizer.init(params), params
    update = jax.jit(optimizer.update)
    for step in gradients:
        given = {name: jnp.asarray(step) * (name == group) for name in params}
        updates, state = update(given, state, params)
    return np.asarray(updates[group])


@pytest.mark.parametrize("group", ["field", "enhancement"])
@pytest.mark.parametrize(
    ("clip", "large", "same"),
    [
        ({"clip_value": 0.1}, [7.0, -0.05], [0.1, -0.05]),
        ({"clip_norm": 0.1}, [3.0, -4.0], [0.06, -0.08]),
        ({"clip_value": 0.1, "clip_norm": 0.1}, [9.0, -9.0], [0.0707107, -0.0707107]),
    ],
)
def test_a_gradient_beyond_a_clip_counts_as_much_as_the_clip(clip, large, same, group):
    """Adam forgets scale but not the proportion of two steps."""
    small = [0.01, 0.02]
    config = OptimizerConfig(**{**vars(FLAT), **clip})
    clipped = last_update(config, [large, small], group)
    np.testing.assert_allclose(
        clipped, last_update(FLAT, [same, small], group), rtol=1e-4
    )
    assert np.max(np.abs(clipped - last_update(FLAT, [large, small], group))) > 1e-5


def test_a_group_is_clipped_alone():
    optimizer = make_optimizer(OptimizerConfig(), TrainConfig(enhance_start=0))
    params = {"field": RESTING, "enhancement": RESTING}

    update = jax.jit(optimizer.update)

    def field_updates(other: float):
        state = optimizer.init(params)
        for gradient in (0.09, 0.01):
            given = {"field": jnp.full(2, gradient), "enhancement": jnp.full(2, other)}
            updates, state = update(given, state, params)
        return updates["field"]

    np.testing.assert_array_equal(field_updates(1e6), field_updates(0.0))


def test_the_enhancements_rate_falls_from_its_start_to_the_end_of_training():
    """With one gradient throughout, Adam moves by the learning rate."""
    config = OptimizerConfig(enhancement_lr_init=1e-2, enhancement_lr_final=1e-3)
    optimizer = make_optimizer(config, TRAIN)
    params = {"field": RESTING, "enhancement": RESTING}
    state, moved = optimizer.init(params), []
    update = jax.jit(optimizer.update)
    for step in range(TRAIN.max_steps + 1):
        ones = {name: jnp.ones(2) for name in params}
        resting = step < TRAIN.enhance_start
        given = ones | {"enhancement": ones["enhancement"] * (not resting)}
        updates, state = update(given, state, params)
        moved.append(-float(updates["enhancement"][0]))
    assert moved[: TRAIN.enhance_start] == [0.0] * TRAIN.enhance_start
    expected = np.geomspace(1e-2, 1e-3, TRAIN.max_steps - TRAIN.enhance_start + 1)
    np.testing.assert_allclose(moved[TRAIN.enhance_start :], expected, rtol=1e-3)


@pytest.mark.parametrize("extended", [0, 6])
def test_a_run_ends_at_the_mean_of_its_last_steps(extended):
    """Against the slow form, which remembers where every step ended; also of a run
    that is extended from the mean it had ended at."""

    def walk(params, averaged_end: float, max_steps: int, begun=None):
        config = dataclasses.replace(FLAT, averaged_end=averaged_end)
        train = TrainConfig(max_steps=max_steps, enhance_start=max_steps)
        optimizer = make_optimizer(config, train)
        step, state = begun or (0, optimizer.init(params))
        update, ended = jax.jit(optimizer.update), []
        for pull in np.cos(np.arange(step, max_steps)):
            gradient = jax.tree.map(lambda x, pull=pull: x - pull, params)
            updates, state = update(gradient, state, params)
            params = optax.apply_updates(params, updates)
            ended.append(params)
        return ended, (max_steps, state)

    def mean(ended):
        return np.mean([np.asarray(params["field"]) for params in ended], axis=0)

    start = {"field": jnp.array([0.3, -0.2]), "enhancement": RESTING}
    last = start
    averaged, begun, plain_begun = None, None, None
    for max_steps in [10, 10 + extended][: 1 + bool(extended)]:
        averaged, begun = walk(last, 0.4, max_steps, begun)
        plain, plain_begun = walk(last, 0.0, max_steps, plain_begun)
        tail = round(0.4 * max_steps)
        for ours, theirs in zip(averaged[:-1], plain[:-1], strict=True):
            np.testing.assert_array_equal(ours["field"], theirs["field"])
        last = averaged[-1]
        assert np.abs(mean(plain[-tail:]) - plain[-1]["field"]).max() > 1e-3
        np.testing.assert_allclose(last["field"], mean(plain[-tail:]), atol=1e-6)


def test_the_warm_up_starts_at_its_part_of_the_rate_and_the_decay_ends_at_the_last():
    rates = OptimizerConfig(
        lr_init=2.0, lr_final=0.5, warmup_steps=10, warmup_factor=0.25
    )
    schedule = field_schedule(rates, 110)
    wanted = {0: 0.5, 5: 1.25, 10: 2.0, 60: 1.0, 110: 0.5}
    found = [np.asarray(schedule(step)) for step in wanted]
    np.testing.assert_allclose(found, list(wanted.values()), rtol=1e-5)
