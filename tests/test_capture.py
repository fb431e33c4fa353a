# SPDX-License-Identifier: Apache-2.0
"""Laws of the camera model: noise-free identity, mean, variance, order, seeds."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from internal import color
from internal.errors import UserError
from internal.night.capture import (
    NORMAL_LIGHT,
    CaptureModel,
    capture,
    collect,
    photon_noise,
    read_noise,
    sense,
    view_key,
)

KEY = jax.random.key(3)
RAMP = np.linspace(0, 1, 3 * 256, dtype=np.float32).reshape(16, 16, 3)
GREY = np.full((200, 200, 3), 0.18, np.float32)


def standard_error(samples: np.ndarray) -> np.ndarray:
    """Of the mean over pixels, per channel."""
    return samples.std(axis=(0, 1)) / np.sqrt(samples[..., 0].size)


def test_a_noise_free_capture_in_normal_light_is_the_rounded_srgb_picture():
    expected = np.round(255 * np.asarray(color.linear_to_srgb(RAMP))).astype(np.uint8)
    np.testing.assert_array_equal(capture(RAMP, NORMAL_LIGHT, KEY), expected)


def test_light_above_white_clips_instead_of_wrapping():
    assert (
        capture(np.full((2, 2, 3), 7.0, np.float32), NORMAL_LIGHT, KEY) == 255
    ).all()


def test_black_stays_black_but_for_read_noise():
    black = np.zeros_like(GREY)
    quiet = CaptureModel(read_noise=0.0)
    assert not capture(black, quiet, KEY).any()
    assert capture(black, CaptureModel(), KEY).any()


@pytest.mark.parametrize("exposure", [1 / 10, 1 / 30, 1 / 60])
def test_the_mean_is_exposure_times_gain_times_light(exposure):
    model = CaptureModel(exposure=exposure, channel_gains=(1.0, 0.8, 0.5))
    sensed = np.asarray(sense(GREY, model, KEY))
    expected = exposure * np.array(model.channel_gains) * 0.18
    assert (np.abs(sensed.mean((0, 1)) - expected) < 4 * standard_error(sensed)).all()


@pytest.mark.parametrize(("full_well", "electrons"), [(1000.0, 5.0), (10_000.0, 3.0)])
def test_the_variance_is_shot_noise_plus_read_noise(full_well, electrons):
    model = CaptureModel(full_well=full_well, read_noise=electrons)
    sensed = np.asarray(sense(GREY, model, KEY))
    shot = 0.18 * model.exposure / full_well
    expected = np.array(model.channel_gains) ** 2 * (
        shot + (electrons / full_well) ** 2
    )
    # The relative standard error of a variance over n samples is sqrt(2 / n) or more.
    np.testing.assert_allclose(sensed.var((0, 1)), expected, rtol=0.05)


def test_photon_noise_counts_whole_electrons():
    electrons = np.asarray(photon_noise(GREY, 50.0, KEY)) * 50.0
    np.testing.assert_allclose(electrons, np.round(electrons), atol=1e-4)
    assert electrons.min() >= 0


def test_read_noise_does_not_depend_on_the_light():
    dark, bright = jnp.zeros((8, 8, 3)), jnp.ones((8, 8, 3))
    noise = read_noise(dark, 4.0, 100.0, KEY)
    np.testing.assert_allclose(
        read_noise(bright, 4.0, 100.0, KEY) - 1, noise, atol=1e-6
    )


@settings(max_examples=30)
@given(st.floats(1e-3, 1.0), st.floats(1e-3, 1.0))
def test_more_exposure_is_never_darker(one, other):
    low, high = (
        capture(RAMP, dataclasses.replace(NORMAL_LIGHT, exposure=e), KEY)
        for e in sorted((one, other))
    )
    assert (low <= high).all()


def test_exposure_is_linear():
    np.testing.assert_allclose(collect(RAMP, 0.1), 0.1 * RAMP, rtol=1e-6)


def test_channels_differ_by_their_gains():
    model = dataclasses.replace(NORMAL_LIGHT, channel_gains=(1.0, 0.5, 0.25))
    red, green, blue = np.moveaxis(np.asarray(sense(GREY, model, KEY)), -1, 0)
    np.testing.assert_allclose(green / red, 0.5, rtol=1e-6)
    np.testing.assert_allclose(blue / red, 0.25, rtol=1e-6)


def test_the_same_seed_and_view_give_the_same_bytes_and_others_do_not():
    model = CaptureModel()
    first = capture(GREY, model, view_key(model, 5))
    np.testing.assert_array_equal(first, capture(GREY, model, view_key(model, 5)))
    other_seed = dataclasses.replace(model, seed=1)
    assert (first != capture(GREY, other_seed, view_key(other_seed, 5))).any()
    assert (first != capture(GREY, model, view_key(model, 6))).any()


@pytest.mark.parametrize(
    "levels",
    [
        {"exposure": 0.0},
        {"exposure": math.nan},
        {"full_well": -1.0},
        {"read_noise": -1.0},
        {"channel_gains": (1.0, 0.0, 1.0)},
    ],
)
def test_impossible_levels_are_refused(levels):
    with pytest.raises(UserError, match=next(iter(levels))):
        CaptureModel(**levels)
