# SPDX-License-Identifier: Apache-2.0
"""Two Adams: one for the field over the whole run, a fresh one for the enhancement."""

import jax.numpy as jnp
import optax
from jax import Array
from jaxtyping import ArrayLike

from internal.configs import OptimizerConfig, TrainConfig
from internal.structs import Params

ENHANCEMENT = "enhancement"  # the model's module of that name, and its group


def make_optimizer(
    optimizer: OptimizerConfig, train: TrainConfig
) -> optax.GradientTransformation:
    """Clipped Adam for the field over the whole run; for the enhancement one that
    starts fresh at ``enhance_start``, with a schedule of its own."""

    def started(step: ArrayLike, **_: object) -> Array:
        return jnp.asarray(step) >= train.enhance_start

    def group(schedule: optax.Schedule) -> optax.GradientTransformation:
        clips = [optax.clip(optimizer.clip_value)] * (optimizer.clip_value > 0.0)
        clips += [optax.clip_by_global_norm(optimizer.clip_norm)] * (
            optimizer.clip_norm > 0.0
        )
        adam = optax.adam(schedule, b2=optimizer.b2, eps=optimizer.eps)
        return optax.chain(*clips, adam)

    steps = max(train.max_steps - train.enhance_start, 1)
    return optax.partition(
        {
            "field": group(field_schedule(optimizer, train.max_steps)),
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
