# SPDX-License-Identifier: Apache-2.0
"""Resampling and distortion against naive versions and laws."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from internal import stepfun


def random_bins(seed, rays=4, bins=9):
    rng = np.random.default_rng(seed)
    edges = np.sort(rng.uniform(0, 1, (rays, bins + 1)), axis=-1)
    weights = rng.uniform(0, 1, (rays, bins)) ** 4 + 1e-3
    return jnp.float32(edges), jnp.float32(weights)


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_inverse_cdf_equals_numpy_interpolation(seed):
    edges, weights = random_bins(seed)
    positions = np.sort(np.random.default_rng(seed).uniform(0, 1, (4, 6)), axis=-1)
    found = jax.jit(stepfun.invert_cdf)(jnp.float32(positions), edges, weights)
    for ray in range(4):
        cdf = np.concatenate([[0], np.cumsum(weights[ray] / weights[ray].sum())])
        expected = np.interp(positions[ray], cdf, edges[ray])
        np.testing.assert_allclose(found[ray], expected, atol=1e-4)


def test_inverse_cdf_skips_empty_bins_and_stays_inside():
    edges = jnp.array([[0.0, 0.25, 0.5, 0.75, 1.0]])
    weights = jnp.array([[0.0, 1.0, 0.0, 0.0]])
    positions = jnp.array([[0.0, 0.5, 0.999]])
    found = stepfun.invert_cdf(positions, edges, weights)
    np.testing.assert_allclose(found, [[0.25, 0.375, 0.49975]], atol=1e-5)


def test_resampling_uniform_weights_is_uniform():
    edges = jnp.linspace(0.0, 1.0, 5)[None]
    positions = stepfun.stratified_positions(4, 1, None)
    found = stepfun.invert_cdf(positions, edges, jnp.ones((1, 4)))
    np.testing.assert_allclose(found, [[0.125, 0.375, 0.625, 0.875]], atol=1e-6)


def test_stratified_positions_sit_one_in_each_stratum():
    positions = stepfun.stratified_positions(8, 100, jax.random.key(0))
    strata = np.floor(np.asarray(positions) * 8).astype(int)
    np.testing.assert_array_equal(strata, np.tile(np.arange(8), (100, 1)))
    assert np.std(np.asarray(positions)[:, 0]) > 0


def test_blurred_weights_cover_the_weights_and_their_neighbours():
    weights = jnp.array([[0.0, 0.0, 1.0, 0.0, 0.0]])
    blurred = stepfun.blur_weights(weights, padding=0.01)
    np.testing.assert_allclose(blurred, [[0.01, 0.51, 1.01, 0.51, 0.01]], atol=1e-6)


def naive_distortion(edges, weights):
    middles = (edges[1:] + edges[:-1]) / 2
    between = sum(
        weights[i] * weights[j] * abs(middles[i] - middles[j])
        for i in range(len(weights))
        for j in range(len(weights))
    )
    return between + np.sum(weights**2 * np.diff(edges)) / 3


@pytest.mark.parametrize("seed", range(5))
def test_distortion_and_its_gradient_equal_the_double_sum(seed):
    edges, weights = random_bins(seed, rays=1)
    fast = jax.jit(jax.value_and_grad(stepfun.distortion, argnums=1))
    value, gradient = fast(edges[0], weights[0])
    exact_edges, exact = (np.asarray(x[0], np.float64) for x in (edges, weights))
    np.testing.assert_allclose(value, naive_distortion(exact_edges, exact), rtol=1e-4)
    for i in range(len(exact)):
        step = np.zeros_like(exact)
        step[i] = 1e-4
        high = naive_distortion(exact_edges, exact + step)
        low = naive_distortion(exact_edges, exact - step)
        np.testing.assert_allclose(gradient[i], (high - low) / 2e-4, atol=1e-3)


def test_distortion_of_a_needle_is_less_than_of_a_haze():
    edges = jnp.linspace(0.0, 1.0, 11)
    needle = jnp.zeros(10).at[4].set(1.0)
    haze = jnp.full(10, 0.1)
    assert stepfun.distortion(edges, needle) < 0.2 * stepfun.distortion(edges, haze)


def test_interlevel_is_the_slow_one_and_zero_for_a_cover():
    rng = np.random.default_rng(3)
    edges = np.sort(rng.uniform(size=(4, 6)), axis=-1)
    outer = np.sort(rng.uniform(size=(4, 9)), axis=-1)
    weights = rng.uniform(size=(4, 5)) / 5
    outer_weights = rng.uniform(size=(4, 8)) / 40

    def slow(ray):
        total = 0.0
        for i in range(5):
            bound = sum(
                outer_weights[ray, j]
                for j in range(8)
                if outer[ray, j + 1] > edges[ray, i]
                and outer[ray, j] < edges[ray, i + 1]
            )
            lack = max(weights[ray, i] - bound, 0.0)
            total += lack**2 / (weights[ray, i] + 1e-5)
        return total

    arguments = [jnp.float32(x) for x in (edges, weights, outer, outer_weights)]
    fast = stepfun.interlevel(*arguments)
    np.testing.assert_allclose(fast, [slow(ray) for ray in range(4)], rtol=1e-4)
    assert np.all(fast > 0)
    itself = stepfun.interlevel(*arguments[:2], *arguments[:2])
    np.testing.assert_allclose(itself, 0.0, atol=1e-7)
