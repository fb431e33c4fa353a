# SPDX-License-Identifier: Apache-2.0
"""The enhancement of v: identity, the paper's formula, light edits."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from internal import losses
from internal.enhancements.gamma import (
    Coefficients,
    Gamma,
    GammaLit,
    enhance_v,
    light_v,
)
from internal.enhancements.look import NEUTRAL, Look
from internal.structs import Decomposed, Level, LitRendering

V = jnp.array([[0.004], [0.05], [0.7]])
COEFFICIENTS = Coefficients(
    alpha=jnp.array([[0.3], [0.5], [0.9]]), gamma=jnp.full((3, 3), 0.4)
)


def test_alpha_one_and_exponent_one_is_identity():
    v_hat = enhance_v(V, jnp.ones((3, 1)), jnp.ones((3, 3)))
    np.testing.assert_array_equal(v_hat, jnp.broadcast_to(V, (3, 3)))


def test_a_small_alpha_lights_up_as_much_as_it_says_and_none_is_finite():
    one = jnp.ones((1, 3))
    v_hat = enhance_v(jnp.array([[2e-3]]), jnp.array([[1e-3]]), one)
    np.testing.assert_allclose(v_hat, 2.0 * one, rtol=1e-5)
    assert jnp.all(jnp.isfinite(enhance_v(V, jnp.zeros((3, 1)), jnp.ones((3, 3)))))


def test_formula_by_hand():
    # (0.05 / 0.5)^(1 / (2.2 + 0.3)) = 0.1^0.4 = 0.398107
    coefficients = Coefficients(jnp.array([[0.5]]), jnp.full((1, 3), 0.3))
    v_hat = light_v(jnp.array([[0.05]]), coefficients, 2.2, NEUTRAL)
    np.testing.assert_allclose(v_hat, np.full((1, 3), 0.398107), rtol=1e-5)


def test_neutral_edit_changes_no_bit():
    exponent = 1.0 / (2.2 + COEFFICIENTS.gamma)
    plain = enhance_v(V, COEFFICIENTS.alpha, exponent)
    edited = light_v(V, COEFFICIENTS, 2.2, Look(1.0, 0.0, 6500.0).edit())
    np.testing.assert_array_equal(edited, plain)


def rendering() -> LitRendering:
    """Two patches of three rays."""
    draw = np.random.default_rng(0).uniform

    def rays(channels):
        return jnp.asarray(draw(0.1, 0.9, (6, channels)), jnp.float32)

    lit = GammaLit(rays(3), rays(3), rays(1), rays(3), rays(1))
    return LitRendering(rays(3), rays(1), rays(1), rays(3), lit)


def terms(enhancement: Gamma) -> dict[str, float]:
    return {name: float(term) for name, term in enhancement.terms(rendering()).items()}


def test_gray_is_asked_of_the_lit_colour_as_far_as_the_basis_is_gray():
    """L_c2 (LLNeRF Eq. 9) compares c_hat with r."""
    seen = rendering()
    expected = losses.gray_world_loss(seen.enhanced, seen.r, bias=0.5)
    np.testing.assert_allclose(
        terms(Gamma(gray=2.0))["gray"], 2.0 * expected, rtol=1e-5
    )


def test_phi_looks_at_v_and_a_white_basis_shows_v_hat():
    network: Any = Gamma(width=4).network("enhancement")
    v = jnp.exp(jax.random.uniform(jax.random.key(0), (3, 2, 1), minval=-4.0))
    white = Decomposed(v[..., 0], v, jnp.ones((3, 2, 3)), jnp.ones((3, 2, 5)))
    level = Level(jnp.ones((3, 3)), jnp.full((3, 2), 0.5), jnp.ones((3, 3)), white)
    params = network.init(jax.random.key(1), level, NEUTRAL)
    lit = network.apply(params, level, NEUTRAL)
    np.testing.assert_allclose(lit.v_enhanced, lit.enhanced, rtol=1e-6)
    brighter = dataclasses.replace(level, samples=dataclasses.replace(white, v=2.0 * v))
    assert jnp.all(network.apply(params, brighter, NEUTRAL).alpha != lit.alpha)


@pytest.mark.parametrize(
    ("changed", "moved"),
    [
        (Gamma(exposure_target=0.7), {"exposure"}),
        (Gamma(gray_bias=0.2), {"gray"}),
        (Gamma(smooth_eps=1e-1), {"alpha_smooth", "gamma_smooth"}),
        (Gamma(smooth_beta=3.0), {"alpha_smooth", "gamma_smooth"}),
    ],
)
def test_a_constant_of_a_loss_moves_this_loss_alone(changed, moved):
    before, after = terms(Gamma()), terms(changed)
    assert {name for name in before if before[name] != after[name]} == moved
