# SPDX-License-Identifier: Apache-2.0
"""The tone curve: its laws, its metering, and a model that is lit by it."""

import dataclasses
from typing import Any

import chex
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from internal import losses
from internal.color import linear_to_srgb, srgb_to_linear
from internal.configs import load_config
from internal.enhancements.look import LUMINANCE_WEIGHTS, NEUTRAL
from internal.enhancements.tone import (
    MOST_SATURATION,
    Curve,
    Tone,
    ToneNetwork,
    response,
    saturate,
    tone_map,
)
from internal.structs import Colored, Level, Lit, LitRendering
from internal.training.optimizer import make_optimizer
from tests.conftest import TINY_ENHANCED, TINY_MLP, TINY_SIZES
from tests.test_training import make_run

DARK = jnp.array([[0.02, 0.03, 0.01], [0.1, 0.08, 0.12], [0.0, 0.0, 0.0]])
BRIGHT = Curve(5.0, jnp.float32(1.3), 1.3, 1.5)
TINY_TONE = (
    *TINY_SIZES,
    *TINY_MLP,
    *TINY_ENHANCED,
    "Model.enhancement = @Tone()",
    "Train.batch_size = 24",
    "Optimizer.enhancement_lr_init = 0.3",
    "Optimizer.enhancement_lr_final = 0.03",
)


def test_response_by_hand():
    # x = 4, n = 1.5: 8 / 9
    got = response(jnp.array([[4.0, 1.0, 0.0]]), 1.5, 1.0)
    np.testing.assert_allclose(got, [[8 / 9, 0.5, 0.0]], atol=1e-6)


def test_response_rises_everywhere_and_never_reaches_white():
    x = jnp.geomspace(1e-6, 100.0, 50)[:, None] * jnp.ones(3)
    y = response(x, 1.3, 1.0)
    assert jnp.all(jnp.diff(y, axis=0) > 0) and jnp.all(y < 1)


def test_saturation_keeps_luminance_and_gray_and_one_is_identity():
    gray = jnp.full((1, 3), 0.2)
    np.testing.assert_allclose(saturate(gray, jnp.float32(2.0)), gray, rtol=1e-6)
    np.testing.assert_allclose(saturate(DARK, jnp.float32(1.0)), DARK, atol=1e-7)
    vivid = saturate(DARK, jnp.float32(1.5))
    luminances = vivid @ LUMINANCE_WEIGHTS, DARK @ LUMINANCE_WEIGHTS
    np.testing.assert_allclose(*luminances, rtol=1e-5)
    assert jnp.ptp(vivid[0]) > jnp.ptp(DARK[0])
    assert jnp.all(saturate(jnp.eye(3), jnp.float32(2.0)) >= 0.0)


@pytest.mark.parametrize(("wanted", "kept"), [(0.5, 1.0), (1.4, 1.4), (3.0, 2.0)])
def test_a_saturation_beyond_its_range_keeps_its_gradient(wanted, kept):
    def saturation(parameter):
        held = {"params": {"saturation": parameter}}
        curve: Any = ToneNetwork(Tone()).apply(held, method="curve")
        return curve.saturation

    found, slope = jax.value_and_grad(saturation)(jnp.float32(wanted))
    assert (found, slope) == (pytest.approx(kept), 1.0)


def test_develop_is_gain_then_response_in_linear_light():
    tone = Curve(5.0, jnp.float32(1.0), 1.3, 1.0)
    expected = linear_to_srgb(response(32.0 * srgb_to_linear(DARK), 1.3, 1.0))
    np.testing.assert_allclose(tone_map(DARK, tone, NEUTRAL), expected, rtol=1e-5)


def test_develop_has_finite_gradients_in_the_dark():
    def brightness(dark, saturation):
        return jnp.mean(tone_map(dark, Curve(5.0, saturation, 1.3, 1.5), NEUTRAL))

    gradients = jax.grad(brightness, argnums=(0, 1))(DARK, jnp.float32(1.3))
    assert all(np.all(np.isfinite(x)) for x in gradients)


def test_colorfulness_loss_by_hand():
    pale = jnp.array([[0.5, 0.46, 0.4], [0.2, 0.3, 0.2]])
    assert losses.colorfulness_loss(pale, least=0.14) == pytest.approx(0.04**2)


def metered(dark: jax.Array) -> tuple[Curve, jax.Array]:
    """What 400 steps of metering make of a scene of these colours."""
    config = load_config(["configs/llnerf_best.gin"], [])
    tone = config.model.enhancement
    assert isinstance(tone, Tone)
    tone = tone.metered(np.asarray(dark))
    train = dataclasses.replace(config.train, max_steps=400, enhance_start=0)
    optimizer = make_optimizer(config.optimizer, train)
    network: Any = tone.network("enhancement")

    def lit(params, dark):
        held = {"params": params["enhancement"]}
        return network.apply(held, level_of(dark), NEUTRAL)

    def loss(params, dark):
        rendering = LitRendering(
            dark, dark[:, :1], dark[:, :1], dark, lit(params, dark)
        )
        return sum(tone.terms(rendering).values(), jnp.zeros(()))

    def step(carry, key):
        params, state = carry
        some = jax.random.choice(key, dark, (512,))
        updates, state = optimizer.update(jax.grad(loss)(params, some), state, params)
        return (optax.apply_updates(params, updates), state), None

    params = network.init(jax.random.key(0), level_of(dark), NEUTRAL)["params"]
    params = {"enhancement": params}
    start = params, optimizer.init(params)
    keys = jax.random.split(jax.random.key(1), 400)
    (params, _), _ = jax.jit(lambda start: jax.lax.scan(step, start, keys))(start)
    held = {"params": params["enhancement"]}
    return network.apply(held, method=ToneNetwork.curve), lit(params, dark).enhanced


def level_of(dark: jax.Array) -> Level:
    """Rays of these colours, of which nothing else is known."""
    one = jnp.ones((len(dark), 1))
    return Level(one, one, dark, Colored(one, dark[:, None]))


def scene_of(colour: tuple[float, float, float], darkness: float) -> jax.Array:
    light = 0.3 + jax.random.uniform(jax.random.key(2), (2000, 1))
    return darkness * light * jnp.array(colour)


@pytest.mark.parametrize("darkness", [0.02, 0.1, 0.8])
def test_a_vivid_scene_keeps_its_colours_at_any_darkness(darkness):
    curve, enhanced = metered(scene_of((1.0, 0.7, 0.4), darkness))
    assert curve.saturation == pytest.approx(1.0, abs=0.02)
    assert 0.3 < jnp.mean(jnp.max(enhanced, -1)) < 0.8


def test_a_pale_scene_gets_the_least_colour_of_normal_photos():
    curve, enhanced = metered(scene_of((1.0, 0.75, 0.67), 0.03))
    spread = jnp.mean(jnp.max(enhanced, -1) - jnp.min(enhanced, -1))
    assert 1.0 < curve.saturation < 1.95
    assert spread == pytest.approx(0.14, abs=0.005)


def test_a_gray_scene_gets_no_more_colour_than_the_most_saturation_gives():
    curve, enhanced = metered(scene_of((1.0, 1.0, 0.99), 0.05))
    assert curve.saturation <= MOST_SATURATION
    assert jnp.mean(jnp.max(enhanced, -1) - jnp.min(enhanced, -1)) < 0.05


def test_a_given_exposure_is_kept_and_a_missing_one_is_metered():
    dark = np.asarray(scene_of((1.0, 0.7, 0.4), 0.03))
    assert Tone(stops=3.0).metered(dark).stops == 3.0
    darker = np.asarray(linear_to_srgb(srgb_to_linear(dark) / 4.0))
    stops = [Tone().metered(x).stops for x in (dark, darker)]
    assert stops[0] is not None and stops[1] == pytest.approx(stops[0] + 2.0, abs=0.1)


def test_the_saturation_rests_until_its_time_and_leaves_the_field(
    tiny_cameras, tiny_images, ndc
):
    own = [*TINY_TONE, "Tone.stops = 2.0", "Train.max_steps = 9"]
    config = load_config([], own)
    run, state = make_run(config, tiny_cameras, tiny_images, ndc, jax.devices()[:1])
    before, _ = run(state, 3)
    own_params = (x.params["enhancement"] for x in (before, state))
    chex.assert_trees_all_equal(*own_params)
    plain = load_config([], [*own, "Tone.colorfulness = 0.0"])
    quiet, _ = make_run(plain, tiny_cameras, tiny_images, ndc, jax.devices()[:1])
    fields = (go(state, 5)[0].params["field"] for go in (run, quiet))
    chex.assert_trees_all_equal(*fields)


def test_how_pale_is_too_pale_is_a_setting():
    rgb, one = jnp.array([[0.5, 0.46, 0.4]]), jnp.ones((1, 1))
    rendering = LitRendering(rgb, one, one, rgb, Lit(rgb))
    pale = [Tone(least_colorfulness=x).terms(rendering) for x in (0.2, 0.3)]
    found = [term["colorfulness"] for term in pale]
    np.testing.assert_allclose(found, [0.1**2, 0.2**2], rtol=1e-5)


def test_settings_of_the_curve_reach_it():
    network = ToneNetwork(Tone(stops=2.0, contrast=1.2, shoulder=5.0))
    curve = network.apply(
        network.init(jax.random.key(0), method="curve"), method="curve"
    )
    assert isinstance(curve, Curve)
    assert (curve.stops, curve.contrast, curve.shoulder) == (2.0, 1.2, 5.0)
