# SPDX-License-Identifier: Apache-2.0
"""What heads make of any field: density, a dark colour, what phi sees."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from internal.fields.mlp import MLP
from internal.heads import DecomposedField, PlainField
from internal.structs import Colored, Decomposed

MEAN = jax.random.uniform(jax.random.key(0), (6, 5, 3), minval=-1.0)
AHEAD, ASIDE = (jnp.tile(jnp.eye(3)[i], (6, 1)) for i in (2, 0))
SILENCE = jnp.zeros((6, 5))


@pytest.fixture(scope="module", params=[DecomposedField, PlainField])
def ask(request):
    """Asks a new field at some samples from a side, under some noise."""
    field = request.param(MLP(depth=2, width=16, max_deg=3), width=8, deg_view=2)
    var = jnp.full_like(MEAN, 1e-4)
    params = field.init(jax.random.key(1), MEAN, var, AHEAD, SILENCE)
    return jax.jit(lambda side, noise: field.apply(params, MEAN, var, side, noise))


def test_noise_is_added_to_the_density_before_it_is_made_positive(ask):
    noise = jax.random.normal(jax.random.key(2), SILENCE.shape)
    calm, noisy = (jnp.log(jnp.expm1(ask(AHEAD, x).density)) for x in (SILENCE, noise))
    np.testing.assert_allclose(noisy - calm, noise, atol=1e-4)


def test_a_new_field_is_as_dark_as_the_photos_it_learns(ask):
    samples: Decomposed | Colored = ask(AHEAD, SILENCE)
    levels = 255.0 * np.asarray(samples.rgb)
    assert np.all((levels > 0.0) & (levels < 10.0))


def test_phi_sees_the_layer_of_f1_that_knows_the_side(ask):
    one, other = (ask(side, SILENCE) for side in (AHEAD, ASIDE))
    if isinstance(one, Colored):
        assert np.any(one.rgb != other.rgb)
        return
    assert one.features.shape == (6, 5, 8)
    assert np.any(one.features != other.features) and np.any(one.v != other.v)
    np.testing.assert_array_equal(one.r, other.r)
