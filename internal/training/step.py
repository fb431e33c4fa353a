# SPDX-License-Identifier: Apache-2.0
"""The train step: one pure function from (state, pixels) to (state, numbers).

Total loss = data + coarse * data of the coarse levels + distortion + interlevel
           + the terms of the enhancement,
the last from ``Train.enhance_start`` on. The field learns from all but them, the
enhancement from them alone; each has its own Adam.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import optax
from flax import struct
from jax import Array
from jax.lax import stop_gradient
from jax.sharding import AbstractMesh, Mesh
from jaxtyping import Float, PRNGKeyArray
from tqdm import tqdm

from internal import color, losses, parallel, stepfun
from internal.cameras import Cameras, Rays, cast_rays
from internal.configs import Config, LossConfig
from internal.coord import ForwardFacing, Space
from internal.enhancements.look import NEUTRAL
from internal.errors import Diverged
from internal.models import Model
from internal.scene import noise
from internal.scene.scene import Scene
from internal.structs import Level, Levels, Params, Terms
from internal.training.optimizer import ENHANCEMENT, group_params, make_optimizer
from internal.training.sampler import (
    Batch,
    Chances,
    PixelSource,
    neighbors_of,
    pixel_source,
)


@struct.dataclass
class TrainState:
    """All that a checkpoint holds; ``step`` counts the finished steps."""

    step: Any  # int32 scalar, or its shape and type where only these are known
    params: Params
    opt_state: optax.OptState


@struct.dataclass
class StepStats:
    """What a step reports. A step whose terms or gradients are not finite leaves
    the state as it was, so the state is always the last good one."""

    terms: Terms
    grad_norms: Terms  # of the field and of the enhancement, before clipping
    psnr: Float[Array, ""]  # dark rendering against this batch's pixels
    finite: Array


def initial_state(config: Config, model: Model) -> TrainState:
    """Fresh parameters and optimiser state from ``Train.seed``."""
    ray = jnp.ones((1, 3))
    rays = Rays(ray, ray, ray, jnp.ones((1, 1)))
    space = ForwardFacing(jnp.ones(2))
    key = jax.random.key(config.train.seed)
    params = jax.jit(model.init)(key, rays, space, NEUTRAL)["params"]
    optimizer = make_optimizer(config.optimizer, config.train)
    return TrainState(jnp.zeros((), jnp.int32), params, optimizer.init(params))


def data_eps(config: LossConfig, brightness: float) -> float:
    """epsilon_2 of the data term (LLNeRF Sec. 4.3) for photos of a mean in sRGB."""
    return config.data_eps + config.data_eps_of_mean * brightness


def field_terms(
    config: LossConfig,
    levels: Levels,
    photos: list[Float[Array, "rays 3"]],
    rgb: Float[Array, "rays 3"],
    eps: float,
    share: float | Float[Array, ""],
) -> Terms:
    """Weighted terms that teach the field.

    Args:
        photos: what the levels that have a colour say a photo shows, coarse first.
        rgb: what it does show.
        eps: the data term's epsilon_2.
        share: of the training that is done.
    """
    last = levels.last
    data = [losses.data_loss(photo, rgb, eps=eps) for photo in photos]
    held = stop_gradient((last.s_edges, last.weights))
    lacks = [
        jnp.mean(stepfun.interlevel(*held, x.s_edges, x.weights))
        for x in levels.proposals
    ]
    spread = stepfun.distortion(last.s_edges, last.weights)
    weight = config.distortion * config.distortion_growth**share
    terms = {"data": data[-1], "distortion": weight * jnp.mean(spread)}
    if len(data) > 1:
        terms["coarse"] = config.coarse * sum(data[:-1], jnp.zeros(()))
    if lacks:
        terms["interlevel"] = config.interlevel * sum(lacks, jnp.zeros(()))
    return terms


@dataclasses.dataclass(frozen=True)
class Teacher:
    """The two losses of a model and their gradients.

    Since the enhancement's losses stop at the enhancement and the field's never reach
    it, each gets a gradient of its own.
    """

    config: Config
    model: Model
    data_eps: float
    observe: noise.Observation  # what photos show of a colour on average

    def teach_field(
        self,
        params: Params,
        rays: Rays,
        space: Space,
        batch: Batch,
        key: PRNGKeyArray,
        share: Float[Array, ""],
    ) -> tuple[Params, Level, Float[Array, ""], Terms]:
        """Gradient of the field's terms after a share of the training, its last level,
        the mean squared error of what it says the photos show, and the terms."""
        rgb = jnp.reshape(batch.rgb(), (-1, 3))
        gain = jnp.reshape(jnp.asarray(batch.gains), (-1, 3))
        march: Any = functools.partial(self.model.apply, method="march")

        def loss(params: Params) -> tuple[Float[Array, ""], Any]:
            levels: Levels = march({"params": params}, rays, space, key)
            colored = (*levels.coarse, levels.last)
            photos = [self.observe(color.expose(x.rgb, gain)) for x in colored]
            terms = field_terms(
                self.config.losses, levels, photos, rgb, self.data_eps, share
            )
            total = sum(terms.values(), jnp.zeros(()))
            error = jnp.mean((jnp.clip(photos[-1], 0.0, 1.0) - rgb) ** 2)
            return total, (levels.last, error, terms)

        own = group_params(params, "field")
        grads, (last, error, terms) = jax.grad(loss, has_aux=True)(own)
        return grads, last, error, terms

    def teach_enhancement(
        self, params: Params, level: Level, space: Space
    ) -> tuple[Params, Terms]:
        """Gradient of the enhancement's terms, and the terms."""
        enhancement = self.config.model.enhancement
        assert enhancement is not None
        light_up: Any = functools.partial(self.model.apply, method="light_up")

        def loss(params: Params) -> tuple[Float[Array, ""], Terms]:
            rendering = light_up({"params": params}, level, space, NEUTRAL)
            terms = enhancement.terms(rendering)
            return sum(terms.values(), jnp.zeros(())), terms

        return jax.grad(loss, has_aux=True)(group_params(params, ENHANCEMENT))


def gradients(
    teacher: Teacher,
    state: TrainState,
    rays: Rays,
    space: Space,
    batch: Batch,
    key: PRNGKeyArray,
) -> tuple[Params, Terms, Float[Array, ""]]:
    """Gradients, loss terms and mean squared error over some of a batch. The
    enhancement costs nothing before ``enhance_start``."""
    share = state.step / teacher.config.train.max_steps
    grads, last, error, terms = teacher.teach_field(
        state.params, rays, space, batch, key, share
    )
    if teacher.config.model.enhancement is not None:
        teach = functools.partial(teacher.teach_enhancement, level=last, space=space)
        shapes = jax.eval_shape(teach, state.params)
        lit_grads, lit_terms = jax.lax.cond(
            state.step >= teacher.config.train.enhance_start,
            teach,
            lambda _: optax.tree.zeros_like(shapes),
            state.params,
        )
        grads, terms = grads | lit_grads, terms | lit_terms
    return grads, terms, error


def apply_if_finite(
    optimizer: optax.GradientTransformation,
    state: TrainState,
    grads: Params,
    terms: Terms,
) -> tuple[TrainState, Terms, Array]:
    """The state after a step, or as it was where a number is not finite; the norms of
    each group's gradient, and whether all was finite."""

    def apply(state: TrainState, grads: Params) -> TrainState:
        updates, opt_state = optimizer.update(grads, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        return TrainState(state.step + 1, params, opt_state)

    groups = {name: group_params(grads, name) for name in (ENHANCEMENT, "field")}
    norms = {name: optax.tree.norm(own) for name, own in groups.items() if own}
    finite = jnp.all(jnp.isfinite(jnp.stack([*terms.values(), *norms.values()])))
    kept = jax.lax.cond(finite, apply, lambda state, _: state, state, grads)
    return kept, norms, finite


def make_train_step(
    config: Config,
    model: Model,
    mesh: Mesh | AbstractMesh,
    brightness: float,
    observe: noise.Observation = noise.ideal_photo,
) -> Callable[[TrainState, Cameras, Space, PixelSource], tuple[TrainState, StepStats]]:
    """Builds the pure step; the caller jits it and donates the state.

    The batch is split over ``mesh``; the losses are means over all of it, so the
    result does not depend on how many devices share the work, nor on
    ``Train.passes``, in which the batch is worked off one part after the other to
    save memory.

    Args:
        mesh: the devices, or how many there would be, for a program that is only
            lowered.
        brightness: mean of the training photos, sRGB.
        observe: what photos show of a colour on average.
    """
    train = config.train
    optimizer = make_optimizer(config.optimizer, train)
    teacher = Teacher(config, model, data_eps(config.losses, brightness), observe)
    neighbors = neighbors_of(config)

    def train_step(
        state: TrainState, cameras: Cameras, space: Space, source: PixelSource
    ) -> tuple[TrainState, StepStats]:
        key = jax.random.fold_in(jax.random.key(train.seed), state.step)
        batch = source.batch(cameras, train, neighbors, state.step)

        def work(part: Batch, key: PRNGKeyArray) -> tuple[Params, Terms, Array]:
            part = jax.lax.with_sharding_constraint(part, parallel.batch_sharding(mesh))
            pixels = jax.tree.map(jnp.ravel, part.pixels)
            rays = cast_rays(cameras, space, pixels.view, pixels.x, pixels.y)
            return gradients(teacher, state, rays, space, part, key)

        grads, terms, error = mean_over_parts(work, batch, key, train.passes)
        kept, norms, finite = apply_if_finite(optimizer, state, grads, terms)
        return kept, StepStats(terms, norms, psnr_of(error), finite)

    return train_step


def compiled_step(
    config: Config,
    model: Model,
    scene: Scene,
    mesh: jax.sharding.Mesh,
    chances: Chances,
) -> Callable[[TrainState, int], tuple[TrainState, StepStats]]:
    """The train step on a scene, as a function of the state and the finished steps.

    The state it is given is used up. Pictures lie on the devices, or are fed from the
    host when too large.

    Args:
        scene: the training split.
        chances: of ``find_chances`` for that scene, which takes its time.
    """
    pixels_of_step = pixel_source(
        scene.images, scene.gains, scene.cameras, mesh, config, chances
    )
    cameras, space = parallel.replicate((scene.cameras, scene.space), mesh)
    ideal = config.losses.observation == "ideal"
    observe = noise.ideal_photo if ideal else noise.expected_photo(scene.noise)
    train_step = jax.jit(
        make_train_step(config, model, mesh, scene.brightness, observe),
        donate_argnums=0,
    )
    return lambda state, done: train_step(state, cameras, space, pixels_of_step(done))


def mean_over_parts(
    work: Callable[[Batch, PRNGKeyArray], Any],
    batch: Batch,
    key: PRNGKeyArray,
    passes: int,
) -> Any:
    """The mean of ``work`` over equal parts of a batch, one after the other."""
    if passes == 1:
        return work(batch, key)
    parts = jax.tree.map(lambda x: x.reshape(passes, -1, *x.shape[1:]), batch)
    keys = jax.random.split(key, passes)
    results = jax.lax.map(lambda part: work(*part), (parts, keys))
    return jax.tree.map(lambda x: jnp.mean(x, axis=0), results)


def psnr_of(error: Float[Array, ""]) -> Float[Array, ""]:
    """Peak signal-to-noise ratio in dB of a mean squared error of values in [0, 1],
    100 at most."""
    return -10.0 * jnp.log10(jnp.maximum(error, 1e-10))


def check_finite(stats: StepStats | None, step: int) -> None:
    """Waits for a step and stops the run if anything in it was not finite.

    Raises:
        Diverged: names the step and the loss terms or, failing these, the
            gradients that were NaN or infinite.
    """
    if stats is None or stats.finite:
        return
    bad_terms = [f"loss {k}" for k, x in stats.terms.items() if not jnp.isfinite(x)]
    bad_grads = [k for k, x in stats.grad_norms.items() if not jnp.isfinite(x)]
    names = bad_terms or [f"gradient of the {name}" for name in bad_grads]
    raise Diverged(
        f"step {step}: not finite: {', '.join(names)}; the last checkpoint is intact: "
        "lower Optimizer.lr_init or the weight of that loss in another run"
    )


def log_numbers(stats: StepStats) -> dict[str, float]:
    """A step's numbers for logs: psnr, loss/*, grad_norm/*."""
    numbers = {"psnr": stats.psnr}
    numbers |= {f"loss/{name}": x for name, x in stats.terms.items()}
    numbers |= {f"grad_norm/{name}": x for name, x in stats.grad_norms.items()}
    return {name: float(x) for name, x in numbers.items()}


def bar_line(numbers: dict[str, float], shown: tqdm, rays_per_step: int) -> str:
    """PSNR, rays per second and loss terms of ``log_numbers``, for the bar of steps."""
    rate = shown.format_dict["rate"]
    if not rate:
        rate = (shown.n - shown.initial) / max(shown.format_dict["elapsed"], 1e-3)
    rays = rate * rays_per_step
    terms = " ".join(
        f"{name.removeprefix('loss/')} {value:.2g}"
        for name, value in numbers.items()
        if name.startswith("loss/") and value
    )
    return f"PSNR {numbers['psnr']:.1f} dB, {rays:,.0f} rays/s, {terms}"
