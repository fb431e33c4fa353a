# SPDX-License-Identifier: Apache-2.0
"""Metering: level does not matter, shape does, and no scene breaks it."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from internal.color import linear_to_srgb
from internal.enhancements import metering
from internal.enhancements.metering import (
    FITTED,
    MOST_STOPS,
    developed,
    first_exposure,
    largest_channel,
    load_prior,
)
from internal.enhancements.tone import response

PRIOR = load_prior()


def scene(seed: int = 0, spread: float = 1.0) -> np.ndarray:
    """Linear light of ordinary contrast and colours, brightest about 1."""
    rng = np.random.default_rng(seed)
    light = np.exp2(spread * rng.normal(-2.5, 1.2, (4000, 1)))
    light = np.minimum(light, 1.0) * rng.uniform(0.6, 1.0, (4000, 3))
    return light / light.max()


def coded(linear_rgb: np.ndarray) -> np.ndarray:
    return np.asarray(linear_to_srgb(linear_rgb), np.float32)


@pytest.mark.parametrize("darker", [1.0, 3.0, 5.0])
def test_half_the_light_is_one_more_stop(darker):
    light = scene()
    bright, dark = (
        metering.meter(coded(x), PRIOR) for x in (light, light * 2.0**-darker)
    )
    assert dark - bright == pytest.approx(darker, abs=0.02)


def test_order_and_number_of_pixels_do_not_matter():
    dark = coded(scene() / 16)
    once, twice = (
        metering.meter(x, PRIOR) for x in (dark, np.concatenate([dark, dark[::-1]]))
    )
    assert once == pytest.approx(twice, abs=0.01)


def test_the_first_exposure_brings_the_largest_channel_to_the_middle():
    light = scene() / 16
    stops, shape = first_exposure(*largest_channel(light), 1.3, 1.5)
    lit = developed(light.max(axis=-1), stops, 1.3, 1.5)
    assert lit.mean() == pytest.approx(metering.MIDDLE, abs=1e-6)
    assert np.all(np.diff(shape) >= 0)


def test_far_from_all_that_was_seen_the_mean_is_added():
    far = PRIOR.center + 50.0 * PRIOR.scale
    assert metering.correction(far, PRIOR) == pytest.approx(PRIOR.offset, abs=1e-6)


def test_a_kernel_is_one_at_its_examples_and_falls_with_distance():
    a = np.array([[0.0, 0.0], [3.0, 1.0]])
    # d^2 = (9 + 1) / 2 = 5, width 1: exp(-5 / 2)
    np.testing.assert_allclose(
        metering.kernel(a, a, 1.0), [[1, np.exp(-2.5)], [np.exp(-2.5), 1]]
    )


@pytest.mark.parametrize("share", [0.001, 0.01, 0.03])
def test_lamps_do_not_darken_the_room(share):
    room = scene() / 64
    lamps = room.copy()
    lamps[: int(share * len(room))] = 1.0
    plain, lit = (metering.meter(coded(x), PRIOR) for x in (room, lamps))
    assert lit > plain - 1.5


@pytest.mark.parametrize(
    "pixels",
    [
        np.zeros((50, 3)),
        np.ones((50, 3)),
        np.full((50, 3), 0.02),
        np.full((1, 3), 0.5),
        np.tile([0.1, 0.0, 0.0], (50, 1)),
        np.concatenate([np.zeros((99, 3)), np.ones((1, 3))]),
    ],
    ids=["black", "white", "gray", "one pixel", "red", "a lamp in the dark"],
)
def test_any_scene_gets_a_finite_exposure(pixels):
    stops = metering.meter(pixels.astype(np.float32), PRIOR)
    assert np.isfinite(stops) and abs(stops) <= MOST_STOPS


def test_the_shipped_numbers_are_finite_few_and_say_what_made_them():
    assert "experiments.metering" in FITTED.read_text()[:100]
    assert FITTED.stat().st_size < 20_000
    for value in dataclasses.asdict(PRIOR).values():
        assert np.all(np.isfinite(value))


def test_numpy_and_jax_develop_alike():
    light = np.geomspace(1e-6, 30.0, 200)[:, None] * np.ones(3)
    jax_lit = linear_to_srgb(response(jnp.asarray(light), 1.3, 1.5))
    np.testing.assert_allclose(developed(light, 0.0, 1.3, 1.5), jax_lit, atol=1e-5)
