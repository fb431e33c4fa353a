# SPDX-License-Identifier: Apache-2.0
"""The train step: one pure function from (state, pixels) to (state, numbers).

Total loss = data + coarse * data of the coarse levels + distortion
           + L_c (exposure, gray world, norm of gamma) + L_s (alpha, gamma),
L_c and L_s from ``Train.enhance_start`` on. The field learns from the first three
terms alone, phi from the others alone; each has its own Adam.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import optax
from flax import struct
from jax import Array
from jax.lax import stop_gradient
from jaxtyping import ArrayLike, Float, PRNGKeyArray

from internal import color, losses, parallel, stepfun
from internal.cameras import Cameras, Rays, cast_rays
from internal.configs import Config, LossConfig, OptimizerConfig, TrainConfig
from internal.coord import ForwardFacing, Space
from internal.enhancements.editing import NEUTRAL
from internal.enhancements.tone import Meter, Tone, develop
from internal.errors import Diverged
from internal.models import GammaRendering, Histogram, Level, Model
from internal.scene import noise
from internal.scene.scene import Scene
from internal.training.sampler import Batch, PixelSource, pixel_source, step_keys

METERED = 0.01  # sRGB: an exposure as near as this is right

Params = Any  # flax's nested dictionary of arrays by module name
Terms = dict[str, Float[Array, ""]]  # weighted loss terms by name


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
    grad_norms: Terms  # of the field and of phi, before clipping
    psnr: Float[Array, ""]  # dark rendering against this batch's pixels
    finite: Array


def make_optimizer(
    optimizer: OptimizerConfig, train: TrainConfig
) -> optax.GradientTransformation:
    """Clipped Adam for the field over the whole run; for phi one that starts fresh
    at ``enhance_start``, with a schedule of its own."""

    def started(step: ArrayLike, **_: object) -> Array:
        return jnp.asarray(step) >= train.enhance_start

    def group(schedule: optax.Schedule) -> optax.GradientTransformation:
        clips = [optax.clip(optimizer.clip_value)] * (optimizer.clip_value > 0.0)
        clips += [optax.clip_by_global_norm(optimizer.clip_norm)] * (
            optimizer.clip_norm > 0.0
        )
        adam = optax.adam(schedule, b2=optimizer.b2, eps=optimizer.eps)
        return optax.chain(*clips, adam)

    phi_steps = max(train.max_steps - train.enhance_start, 1)
    return optax.partition(
        {
            "field": group(field_schedule(optimizer, train.max_steps)),
            "phi": optax.transforms.conditionally_transform(
                group(
                    optax.exponential_decay(
                        optimizer.phi_lr_init,
                        phi_steps,
                        optimizer.phi_lr_final / optimizer.phi_lr_init,
                    )
                ),
                started,
            ),
        },
        lambda params: {name: _group(name) for name in params},
    )


def _group(module: str) -> str:
    """Who trains a top-level module: proposals learn with the field they serve."""
    return "phi" if module == "phi" else "field"


def field_schedule(optimizer: OptimizerConfig, max_steps: int) -> optax.Schedule:
    """Log-linear decay with a warm-up."""
    return optax.warmup_exponential_decay_schedule(
        init_value=optimizer.lr_init * optimizer.warmup_factor,
        peak_value=optimizer.lr_init,
        warmup_steps=optimizer.warmup_steps,
        transition_steps=max(max_steps - optimizer.warmup_steps, 1),
        decay_rate=optimizer.lr_final / optimizer.lr_init,
    )


def initial_state(config: Config, model: Model) -> TrainState:
    """Fresh parameters and optimiser state from ``Train.seed``."""
    ray = jnp.ones((1, 3))
    rays = Rays(ray, ray, ray, jnp.ones((1, 1)))
    space = ForwardFacing(jnp.ones(2))
    key = jax.random.key(config.train.seed)
    params = jax.jit(model.init)(key, rays, space, NEUTRAL)["params"]
    optimizer = make_optimizer(config.optimizer, config.train)
    return TrainState(jnp.zeros((), jnp.int32), params, optimizer.init(params))


def field_terms(
    config: LossConfig,
    levels: list[Histogram],
    photos: list[Float[Array, "rays 3"]],
    rgb: Float[Array, "rays 3"],
    eps: float,
) -> Terms:
    """Weighted terms that teach the field.

    Args:
        photos: what the levels that have a colour say a photo shows, coarse first.
        rgb: what it does show.
        eps: the data term's epsilon_2.
    """
    last = levels[-1]
    data = [losses.data_loss(photo, rgb, eps=eps) for photo in photos]
    lacks = [
        jnp.mean(
            stepfun.interlevel(
                *stop_gradient((last.s_edges, last.weights)), x.s_edges, x.weights
            )
        )
        for x in levels
        if not isinstance(x, Level)
    ]
    spread = stepfun.distortion(last.s_edges, last.weights)
    terms = {"data": data[-1], "distortion": config.distortion * jnp.mean(spread)}
    if len(data) > 1:
        terms["coarse"] = config.coarse * sum(data[:-1], jnp.zeros(()))
    if lacks:
        terms["interlevel"] = config.interlevel * sum(lacks, jnp.zeros(()))
    return terms


def tone_terms(
    config: LossConfig, dark: Float[Array, "rays 3"], tone: Tone, contrast: float
) -> Terms:
    """Weighted terms that meter a tone curve. The exposure answers to the first alone
    and the saturation to the second alone, once the exposure is right: in the dark
    every scene is pale."""
    held = stop_gradient(tone)
    exposed = develop(dark, Tone(tone.stops, held.saturation), contrast, NEUTRAL)
    colored = develop(dark, Tone(held.stops, tone.saturation), contrast, NEUTRAL)
    metering = losses.metering_loss(exposed, target=config.exposure_target)
    pale = losses.colorfulness_loss(colored, least=config.least_colorfulness)
    metered = stop_gradient(metering) < METERED**2
    return {
        "exposure": config.exposure * metering,
        "colorfulness": config.colorfulness * jnp.where(metered, pale, 0.0),
    }


def phi_terms(
    config: LossConfig, rendering: GammaRendering, patches: int, neighbors: int
) -> Terms:
    """Weighted terms that teach phi: L_c and L_s of the paper."""
    members = (patches, neighbors + 1, -1)
    smooth = functools.partial(
        losses.smoothness_loss,
        v=rendering.v.reshape(members),
        beta=config.smooth_beta,
        eps=config.smooth_eps,
    )
    return {
        "exposure": config.exposure
        * losses.exposure_loss(rendering.enhanced, target=config.exposure_target),
        "gray": config.gray
        * losses.gray_world_loss(
            rendering.enhanced, rendering.r, bias=config.gray_bias
        ),
        "gamma_norm": config.gamma_norm
        * losses.gamma_norm_loss(rendering.gamma_energy),
        "alpha_smooth": config.alpha_smooth * smooth(rendering.alpha.reshape(members)),
        "gamma_smooth": config.gamma_smooth * smooth(rendering.gamma.reshape(members)),
    }


def make_train_step(
    config: Config,
    model: Model,
    mesh: jax.sharding.Mesh,
    brightness: float,
    observe: noise.Observation = noise.ideal_photo,
) -> Callable[[TrainState, Cameras, Space, PixelSource], tuple[TrainState, StepStats]]:
    """Builds the pure step; the caller jits it and donates the state.

    The batch is split over ``mesh``; the losses are means over all of it, so the
    result does not depend on how many devices share the work, nor on
    ``Train.passes``, in which the batch is worked off one part after the other to
    save memory. Since phi's losses stop at phi and the field's never reach it, each
    gets a gradient of its own, and phi costs nothing before ``enhance_start``.

    Args:
        brightness: mean of the training photos, sRGB.
        observe: what photos show of a colour on average.
    """
    train = config.train
    optimizer = make_optimizer(config.optimizer, train)
    data_eps = config.losses.data_eps + config.losses.data_eps_of_mean * brightness
    march: Any = functools.partial(model.apply, method="march")
    light_up: Any = functools.partial(model.apply, method="light_up")

    def field_loss(
        params: Params,
        rgb: Float[Array, "rays 3"],
        gain: Float[Array, "rays 3"],
        rays: Rays,
        space: Space,
        key: PRNGKeyArray,
    ) -> tuple[Float[Array, ""], tuple[Level, Float[Array, "rays 3"], Terms]]:
        levels = march({"params": params}, rays, space, key)
        colored = [x for x in levels if isinstance(x, Level)]
        photos = [observe(color.expose(x.rgb, gain)) for x in colored]
        terms = field_terms(config.losses, levels, photos, rgb, data_eps)
        return sum(terms.values(), jnp.zeros(())), (levels[-1], photos[-1], terms)

    def phi_loss(
        params: Params, level: Level, space: Space
    ) -> tuple[Float[Array, ""], Terms]:
        if config.model.enhancement == "tone":
            tone: Any = Meter().apply({"params": params})
            contrast = config.model.tone_contrast
            terms = tone_terms(config.losses, level.rgb, tone, contrast)
        else:
            rendering = light_up({"params": {"phi": params}}, level, space, NEUTRAL)
            patches = train.batch_size // train.passes
            terms = phi_terms(config.losses, rendering, patches, train.neighbors)
        return sum(terms.values(), jnp.zeros(())), terms

    def gradients(
        state: TrainState, cameras: Cameras, space: Space, batch: Batch, key: Array
    ) -> tuple[Params, Terms, Float[Array, ""]]:
        """Gradients, loss terms and mean squared error over some of a batch."""
        batch = jax.lax.with_sharding_constraint(batch, parallel.batch_sharding(mesh))
        pixels = jax.tree.map(jnp.ravel, batch.pixels)
        rgb = jnp.reshape(batch.rgb(), (-1, 3))
        gain = jnp.asarray(cameras.gains)[pixels.view]
        rays = cast_rays(cameras, space, pixels.view, pixels.x, pixels.y)
        field_params = {k: x for k, x in state.params.items() if _group(k) == "field"}
        grads, (last, photo, terms) = jax.grad(field_loss, has_aux=True)(
            field_params, rgb, gain, rays, space, key
        )
        if config.model.decomposition:
            phi_gradient = functools.partial(
                jax.grad(phi_loss, has_aux=True), level=last, space=space
            )
            shapes = jax.eval_shape(phi_gradient, state.params["phi"])
            grads["phi"], enhancement_terms = jax.lax.cond(
                state.step >= train.enhance_start,
                phi_gradient,
                lambda _: optax.tree.zeros_like(shapes),
                state.params["phi"],
            )
            terms = terms | enhancement_terms
        return grads, terms, jnp.mean((jnp.clip(photo, 0.0, 1.0) - rgb) ** 2)

    def apply(state: TrainState, grads: Params) -> TrainState:
        updates, opt_state = optimizer.update(grads, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        return TrainState(state.step + 1, params, opt_state)

    def train_step(
        state: TrainState, cameras: Cameras, space: Space, source: PixelSource
    ) -> tuple[TrainState, StepStats]:
        pixel_key, render_key = step_keys(train.seed, state.step)
        batch = source.batch(pixel_key, cameras, train, state.step)
        work = functools.partial(gradients, state, cameras, space)
        grads, terms, error = mean_over_parts(work, batch, render_key, train.passes)

        grad_norms = {
            group: optax.global_norm(
                {k: x for k, x in grads.items() if _group(k) == group}
            )
            for group in sorted({_group(k) for k in grads})
        }
        numbers = jnp.stack([*terms.values(), *grad_norms.values()])
        finite = jnp.all(jnp.isfinite(numbers))
        kept = jax.lax.cond(finite, apply, lambda state, _: state, state, grads)
        return kept, StepStats(terms, grad_norms, psnr(error), finite)

    return train_step


def compiled_step(
    config: Config, model: Model, scene: Scene, mesh: jax.sharding.Mesh
) -> Callable[[TrainState, int], tuple[TrainState, StepStats]]:
    """The train step on a scene, as a function of the state and the finished steps.

    The state it is given is used up. Pictures lie on the devices, or are fed from the
    host when too large; ``scene`` is the training split.
    """
    pixels_of_step = pixel_source(
        scene.images, scene.cameras, mesh, config.train, config.max_image_memory
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


def psnr(error: Float[Array, ""]) -> Float[Array, ""]:
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


def summarize(stats: StepStats) -> dict[str, float]:
    """A step's numbers for logs: psnr, loss/*, grad_norm/*."""
    numbers = {"psnr": stats.psnr}
    numbers |= {f"loss/{name}": x for name, x in stats.terms.items()}
    numbers |= {f"grad_norm/{name}": x for name, x in stats.grad_norms.items()}
    return {name: float(x) for name, x in numbers.items()}
