# SPDX-License-Identifier: Apache-2.0
"""Laws of compositing."""

import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from internal import volume


@settings(max_examples=30)
@given(st.integers(0, 10_000), st.floats(0.0, 100.0))
def test_weights_are_non_negative_and_sum_to_one(seed, scale):
    rng = np.random.default_rng(seed)
    density = jnp.float32(scale * rng.uniform(0, 1, (3, 8)))
    edges = jnp.float32(np.sort(rng.uniform(0, 4, (3, 9)), axis=-1))
    weights = volume.compute_weights(density, edges, jnp.ones((3, 3)))
    assert np.all(np.asarray(weights) >= 0)
    np.testing.assert_allclose(jnp.sum(weights, axis=-1), 1.0, atol=1e-5)


def test_weights_by_hand():
    # Optical depths ln 2 halve the light: 1/2, 1/4, and the rest ends in the last.
    edges = jnp.array([0.0, 1.0, 2.0, 3.0])
    density = jnp.full(3, jnp.log(2.0))
    weights = volume.compute_weights(density, edges, jnp.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(weights, [0.5, 0.25, 0.25], atol=1e-6)


def test_longer_directions_mean_longer_intervals():
    edges = jnp.array([0.0, 1.0, 2.0])
    density = jnp.array([jnp.log(2.0), 0.0])
    weights = volume.compute_weights(density, edges, jnp.array([0.0, 0.0, 2.0]))
    np.testing.assert_allclose(weights, [0.75, 0.25], atol=1e-6)


def test_a_constant_colour_composites_to_itself():
    weights = jnp.array([[0.2, 0.5, 0.3]])
    color = jnp.broadcast_to(jnp.array([0.1, 0.2, 0.3]), (1, 3, 3))
    result = volume.composite(weights, color)
    np.testing.assert_allclose(result, [[0.1, 0.2, 0.3]], atol=1e-6)
