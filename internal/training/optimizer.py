# SPDX-License-Identifier: Apache-2.0
"""Two Adams: one for the field over the whole run, a fresh one for the enhancement."""

from typing import Any

import jax
import jax.numpy as jnp
import optax
from flax import struct
from jax import Array
from jaxtyping import ArrayLike

from internal.configs import OptimizerConfig, TrainConfig
from internal.structs import Params

ENHANCEMENT = "enhancement"  # the model's module of that name, and its group


def make_optimizer(
    optimizer: OptimizerConfig, train: TrainConfig
) -> optax.GradientTransformation:
    """Clipped Adam for the field over the whole run, which may end at a mean; for the
    enhancement one that starts fresh at ``enhance_start``, with a schedule of its own.
    """

    def started(step: ArrayLike, **_: object) -> Array:
        return jnp.asarray(step) >= train.enhance_start

    def group(schedule: optax.Schedule) -> optax.GradientTransformation:
        clips = [optax.clip(optimizer.clip_value)] * (optimizer.clip_value > 0.0)
        clips += [optax.clip_by_global_norm(optimizer.clip_norm)] * (
            optimizer.clip_norm > 0.0
        )
        adam = optax.adam(schedule, b2=optimizer.b2, eps=optimizer.eps)
        return optax.chain(*clips, adam)

    field = group(field_schedule(optimizer, train.max_steps))
    averaged = round(optimizer.averaged_end * train.max_steps)
    if averaged > 1:
        field = optax.chain(field, end_at_mean(averaged, train.max_steps))
    steps = max(train.max_steps - train.enhance_start, 1)
    return optax.partition(
        {
            "field": field,
            ENHANCEMENT: optax.transforms.conditionally_transform(
                group(
                    optax.exponential_decay(
                        optimizer.enhancement_lr_init,
                        steps,
                        optimizer.enhancement_lr_final / optimizer.enhancement_lr_init,
                    )
                ),
                started,
            ),
        },
        lambda params: {name: group_of(name) for name in params},
    )


@struct.dataclass
class Averaged:
    """The sum of the parameters after ``count`` of the last steps."""

    step: Any  # int32 scalars, or their shapes and types where only these are known
    count: Any
    total: Params


def end_at_mean(averaged: int, max_steps: int) -> optax.GradientTransformation:
    """Moves the parameters, at the last step, to their mean over the last steps.

    Where the noise of single batches throws them about, the mean is nearer to the
    middle (Polyak and Juditsky 1992; Izmailov et al. 2018), so that the learning rate
    need not fall as far. All steps before the last are as without.

    Args:
        averaged: steps, the last one among them.
        max_steps: number of the last step.
    """

    def init(params: Any) -> Any:
        zero = jnp.zeros((), jnp.int32)
        return Averaged(zero, zero, optax.tree.zeros_like(params))

    def update(updates: Any, state: Any, params: Any = None) -> Any:
        step = state.step + 1
        first = step == max_steps - averaged + 1  # also in a run that is extended

        def add(state: Any) -> Any:
            count = jnp.where(first, 0, state.count) + 1
            total = jax.tree.map(
                lambda t, p, u: jnp.where(first, 0.0, t) + p + u,
                *(state.total, params, updates),
            )
            return state.replace(count=count, total=total)

        state = state.replace(step=step)
        state = jax.lax.cond(step > max_steps - averaged, add, lambda s: s, state)
        updates = jax.lax.cond(
            step == max_steps,
            lambda: jax.tree.map(
                lambda t, p: t / state.count.astype(t.dtype) - p, state.total, params
            ),
            lambda: updates,
        )
        return updates, state

    return optax.GradientTransformation(init, update)


def group_of(module: str) -> str:
    """Who trains a top-level module: proposals learn with the field they serve."""
    return ENHANCEMENT if module == ENHANCEMENT else "field"


def group_params(params: Params, group: str) -> Params:
    """The modules that a group trains."""
    return {name: x for name, x in params.items() if group_of(name) == group}


def field_schedule(optimizer: OptimizerConfig, max_steps: int) -> optax.Schedule:
    """Log-linear decay with a warm-up."""
    return optax.warmup_exponential_decay_schedule(
        init_value=optimizer.lr_init * optimizer.warmup_factor,
        peak_value=optimizer.lr_init,
        warmup_steps=optimizer.warmup_steps,
        transition_steps=max(max_steps - optimizer.warmup_steps, 1),
        decay_rate=optimizer.lr_final / optimizer.lr_init,
    )
