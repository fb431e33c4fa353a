# SPDX-License-Identifier: Apache-2.0
"""Mip-NeRF's Gaussians and encoding against sampling and naive formulas."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from internal import mip


def lift_covariance(directions, t_var, r_var):
    """The whole covariance of a Gaussian along a ray (mip-NeRF Eq. 8)."""
    outer = directions[..., :, None] * directions[..., None, :]
    norm = jnp.sum(directions**2, axis=-1)[..., None, None]
    across = jnp.eye(3) - outer / norm
    return t_var[..., None] * outer + r_var[..., None] * across


def points_in_section(t0, t1, radius, cone, count=400_000):
    """Uniform points of a section around the z axis: (t, x)."""
    rng = np.random.default_rng(0)
    if cone:
        t = np.cbrt(rng.uniform(t0**3, t1**3, count))
        size = radius * t
    else:
        t, size = rng.uniform(t0, t1, count), radius
    angle = rng.uniform(0, 2 * np.pi, count)
    x = size * np.sqrt(rng.uniform(0, 1, count)) * np.cos(angle)
    return t, x


@pytest.mark.parametrize("cone", [True, False])
@pytest.mark.parametrize("ends", [(0.5, 0.8), (2.0, 2.1), (0.01, 3.0)])
def test_gaussian_has_the_moments_of_the_section(cone, ends):
    section = mip.conical_frustum_to_gaussian if cone else mip.cylinder_to_gaussian
    moments = section(*(jnp.float32(x) for x in (*ends, 0.05)))
    near, far = ends
    t, x = points_in_section(near, far, 0.05, cone)
    expected = (t.mean(), t.var(), x.var())
    np.testing.assert_allclose(moments, expected, rtol=0.02)


def test_lifted_variance_is_the_diagonal_of_the_covariance():
    direction = jax.random.normal(jax.random.key(0), (5, 3))
    t_var, r_var = jnp.full((5, 1), 0.3), jnp.full((5, 1), 0.02)
    covariance = lift_covariance(direction, t_var, r_var)
    diagonal = jnp.diagonal(covariance, axis1=-2, axis2=-1)
    np.testing.assert_allclose(
        mip.lift_variance(direction, t_var, r_var), diagonal, rtol=1e-5
    )


def test_covariance_is_r_var_across_and_scaled_t_var_along():
    direction = jnp.array([0.0, 0.0, 2.0])
    covariance = lift_covariance(direction, jnp.array([0.5]), jnp.array([0.1]))
    np.testing.assert_allclose(covariance, np.diag([0.1, 0.1, 2.0]), atol=1e-6)


def naive_ipe(mean, var, max_deg):
    """The formula of the paper, one frequency at a time."""
    sines, cosines = [], []
    for degree in range(max_deg):
        scale = 2.0**degree
        damping = np.exp(-0.5 * scale**2 * var)
        sines.append(damping * np.sin(scale * mean))
        cosines.append(damping * np.cos(scale * mean))
    return np.concatenate([*sines, *cosines], axis=-1)


@pytest.mark.parametrize("max_deg", [1, 4, 10])
def test_encoding_equals_the_naive_one(max_deg):
    rng = np.random.default_rng(1)
    mean, var = rng.uniform(-2, 2, (7, 2, 3)), rng.uniform(0, 0.1, (7, 2, 3))
    encoded = mip.integrated_pos_enc(
        jnp.float32(mean), jnp.float32(var), max_deg=max_deg
    )
    np.testing.assert_allclose(encoded, naive_ipe(mean, var, max_deg), atol=3e-4)


def test_encoding_is_the_expected_sine_under_the_gaussian():
    mean, std = 0.7, 0.2
    draws = np.random.default_rng(2).normal(mean, std, 400_000)
    encoded = mip.integrated_pos_enc(jnp.array([mean]), jnp.array([std**2]), max_deg=3)
    expected = [np.sin(2**k * draws).mean() for k in range(3)]
    expected += [np.cos(2**k * draws).mean() for k in range(3)]
    np.testing.assert_allclose(encoded, expected, atol=3e-3)


def test_plain_encoding_keeps_its_input_and_is_undamped():
    x = jnp.array([0.3, -0.4, 0.5])
    encoded = mip.pos_enc(x, max_deg=2)
    np.testing.assert_allclose(encoded[:3], x)
    np.testing.assert_allclose(encoded[3:6], jnp.sin(x), atol=1e-6)
    assert encoded.shape == (3 + 2 * 3 * 2,)
