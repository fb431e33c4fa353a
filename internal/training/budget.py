# SPDX-License-Identifier: Apache-2.0
"""A training that lasts as long as the user said: ``Config.max_minutes``.

The configured schedule is stretched as a whole to the steps that fit, by the step
times measured on this machine. The stretched one stands in the run's config.json, so
a run that goes on keeps it; with more minutes it goes on for longer, the enhancement
where it stands and the learning rates stretched.
"""

import dataclasses
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp

from internal import parallel, progress
from internal.configs import Config
from internal.errors import UserError
from internal.models import Model
from internal.scene.scene import Scene
from internal.training.sampler import Chances
from internal.training.step import compiled_step, initial_state

MEASURED_STEPS = 20  # of each phase
UNMEASURED_STEPS = 3  # the first ones are slower
SHARE_FOR_THE_REST = 0.97  # checkpoints, previews and a machine that slows down
_SCALED = ("max_steps", "enhance_start", "checkpoint_every", "preview_every")
SCHEDULE = frozenset(["Optimizer.warmup_steps", *(f"Train.{x}" for x in _SCALED)])


@dataclasses.dataclass(frozen=True)
class StepTimes:
    """Seconds of a step before and after ``enhance_start``, and of compiling."""

    field: float
    enhanced: float
    compilation: float


def fit_schedule(
    config: Config,
    own: Config | None,
    log: Sequence[Mapping[str, Any]],
    measure_steps: Callable[[], StepTimes],
) -> Config:
    """The configuration whose schedule fills ``Config.max_minutes`` of training.

    Args:
        own: that of the run in this folder, if one has begun. It keeps its schedule,
            unless there are more minutes now than it was given, or none and then the
            configured steps.
        log: the lines it logged: steps, and seconds of training up to each.
        measure_steps: called only for a run that begins and has a budget.

    Raises:
        UserError: there is no time for a single step, or there are several
            processes, which would each measure another time.
    """
    if own and own.max_minutes:
        return _go_on(config, own, log)
    if own or not config.max_minutes:
        return config
    if jax.process_count() > 1:
        raise UserError(
            "Config.max_minutes is for one process; give several Train.max_steps"
        )
    started = time.perf_counter()
    print("measuring the time of a step", flush=True)
    times = measure_steps()
    left = 60.0 * config.max_minutes - (time.perf_counter() - started)
    fitted = stretch(config, left, times)
    print(
        f"{1e3 * times.field:.0f} ms per step, {1e3 * times.enhanced:.0f} ms with "
        f"enhancement: {fitted.train.max_steps} steps in {config.max_minutes:g} min",
        flush=True,
    )
    return fitted


def with_schedule(config: Config, own: Config) -> Config:
    """A configuration with the schedule that another one has."""
    schedule = {name: getattr(own.train, name) for name in _SCALED}
    return dataclasses.replace(
        config,
        train=dataclasses.replace(config.train, **schedule),
        optimizer=dataclasses.replace(
            config.optimizer, warmup_steps=own.optimizer.warmup_steps
        ),
    )


def _go_on(config: Config, own: Config, log: Sequence[Mapping[str, Any]]) -> Config:
    """The schedule of a run that was given minutes and goes on."""
    kept = with_schedule(config, own)
    steps = own.train.max_steps
    if not config.max_minutes:
        steps = config.train.max_steps
        reason = "Train.max_steps, for Config.max_minutes is not given any more"
    elif config.max_minutes > own.max_minutes and log:
        seconds, done = log[-1]["seconds"], log[-1]["step"]
        left = SHARE_FOR_THE_REST * (60.0 * config.max_minutes - seconds)
        steps = max(steps, int(done + left * done / max(seconds, 1e-3)))
        reason = f"fitted to Config.max_minutes = {config.max_minutes:g}"
    else:
        reason = f"fitted to Config.max_minutes = {own.max_minutes:g} when it began"
    print(f"the run goes on to step {steps}: {reason}", flush=True)
    return dataclasses.replace(
        kept, train=dataclasses.replace(kept.train, max_steps=steps)
    )


def stretch(config: Config, seconds: float, times: StepTimes) -> Config:
    """The schedule in the same proportions, as long as ``seconds`` allow."""
    train = config.train
    enhanced = max(0.0, 1.0 - train.enhance_start / train.max_steps)
    step = (1.0 - enhanced) * times.field + enhanced * times.enhanced
    steps = int((SHARE_FOR_THE_REST * seconds - times.compilation) / step)
    if steps < 1:
        raise UserError(
            f"Config.max_minutes = {config.max_minutes:g}: not a single step fits "
            f"(compiling {times.compilation:.0f} s, a step {step:.2f} s); give more"
        )
    factor = steps / train.max_steps
    scaled = {name: max(1, round(factor * getattr(train, name))) for name in _SCALED}
    warmup = max(1, round(factor * config.optimizer.warmup_steps))
    return dataclasses.replace(
        config,
        train=dataclasses.replace(train, **scaled),
        optimizer=dataclasses.replace(config.optimizer, warmup_steps=warmup),
    )


def time_steps(
    config: Config,
    scene: Scene,
    model: Model,
    mesh: jax.sharding.Mesh,
    chances: Chances,
) -> StepTimes:
    """Times steps of both phases on a state that is then thrown away."""
    train = config.train
    take_step = compiled_step(config, model, scene, mesh, chances)
    state = parallel.replicate(initial_state(config, model), mesh)
    medians: list[float] = []
    started = time.perf_counter()
    state, _ = jax.block_until_ready(take_step(state, 0))
    compilation = time.perf_counter() - started
    with progress.bar(2 * MEASURED_STEPS, "measuring", "step") as bar:
        for first in (0, train.enhance_start):
            state = state.replace(step=jnp.int32(first) + jnp.zeros_like(state.step))
            seconds = []
            for step in range(UNMEASURED_STEPS + MEASURED_STEPS):
                started = time.perf_counter()
                state, _ = jax.block_until_ready(take_step(state, first + step))
                seconds.append(time.perf_counter() - started)
            bar.update(MEASURED_STEPS)
            medians.append(statistics.median(seconds[UNMEASURED_STEPS:]))
    field, enhanced = medians
    return StepTimes(field, enhanced, compilation)
