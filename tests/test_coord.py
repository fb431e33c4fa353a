# SPDX-License-Identifier: Apache-2.0
"""The spaces: NDC, contraction, distances."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from internal.coord import ForwardFacing, Unbounded, contract
from tests.test_mip import lift_covariance

NDC = ForwardFacing(jnp.array([2.0, 2.5]))
CONTRACTED = Unbounded(jnp.float32(0.5), jnp.float32(40.0))


def contract_gaussians(mean, cov):
    """The slow way: whole matrices, and the Jacobian by autodiff."""
    flat = mean.reshape(-1, 3)
    jacobian = jax.vmap(jax.jacfwd(contract))(flat).reshape(cov.shape)
    warped = jnp.einsum("...ij,...jk,...lk->...il", jacobian, cov, jacobian)
    return contract(mean), warped


def project(point):
    """A point to NDC by the projection matrix of NeRF's appendix C, near 1."""
    x, y, z = point
    return np.array([-2.0 * x / z, -2.5 * y / z, 1.0 + 2.0 / z])


@pytest.mark.parametrize("t", [0.0, 0.3, 0.9])
def test_ndc_ray_holds_the_projections_of_the_ray(t):
    origin, direction = np.array([0.2, -0.1, 0.3]), np.array([0.3, 0.1, -1.0])
    o, d = NDC.enter(jnp.float32(origin), jnp.float32(direction))
    depth = float(NDC.depth(jnp.float32(t)))  # of the sample at t
    world = origin + (depth + origin[2]) * direction
    np.testing.assert_allclose(o + t * d, project(world), atol=1e-5)


def test_ndc_starts_at_depth_one_and_ends_at_infinity():
    assert float(NDC.depth(jnp.float32(0.0))) == 1.0
    assert float(NDC.depth(jnp.float32(1.0))) >= 999.0


def test_unbounded_distances_run_from_near_to_far_evenly_in_disparity():
    t = CONTRACTED.s_to_t(jnp.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(t, [0.5, 1 / (0.5 / 40 + 0.5 / 0.5), 40.0], rtol=1e-5)


def test_near_samples_learn_by_the_square_of_their_distance():
    t = jnp.array([0.5, 1.0, 1.5, 2.0, 30.0])
    share = CONTRACTED.gradient_share(t, reach=3.0)
    np.testing.assert_allclose(share, [1 / 9, 4 / 9, 1.0, 1.0, 1.0], rtol=1e-6)
    np.testing.assert_array_equal(NDC.gradient_share(t, reach=3.0), 1.0)


def test_contraction_is_identity_inside_and_reaches_two():
    inside = jnp.array([0.3, -0.5, 0.1])
    np.testing.assert_allclose(contract(inside), inside, rtol=1e-6)
    far = contract(jnp.array([1e5, 0.0, 0.0]))
    np.testing.assert_allclose(far, [2.0, 0.0, 0.0], atol=1e-4)


def test_contraction_keeps_direction_and_follows_the_paper():
    x = jnp.array([3.0, 4.0, 0.0])  # norm 5: (2 - 1/5) x/5
    np.testing.assert_allclose(contract(x), 1.8 * x / 5, rtol=1e-6)


def test_contraction_has_finite_gradients_at_the_origin():
    jacobian = jax.jacfwd(contract)(jnp.zeros(3))
    np.testing.assert_allclose(jacobian, np.eye(3))


def test_contracted_gaussian_has_the_moments_of_contracted_points():
    mean, std = np.array([2.0, 1.0, -1.5]), 0.02
    points = np.random.default_rng(0).normal(mean, std, (200_000, 3))
    contracted = np.asarray(jax.vmap(contract)(jnp.float32(points)))
    new_mean, new_cov = contract_gaussians(
        jnp.float32(mean), jnp.float32(std**2 * np.eye(3))
    )
    np.testing.assert_allclose(new_mean, contracted.mean(0), atol=1e-3)
    np.testing.assert_allclose(new_cov, np.cov(contracted.T), atol=3e-6)


def test_unbounded_warp_gives_the_diagonal_of_the_full_covariance():
    mean = jnp.array([[2.0, 0.5, 0.1], [0.3, -0.2, 0.5], [0.0, -30.0, 4.0]])
    direction = jnp.array([[0.2, 0.3, -1.0], [1.0, 0.0, 0.0], [0.1, 2.0, 0.5]])
    t_var, r_var = jnp.full((3, 1), 0.01), jnp.full((3, 1), 0.001)
    warped, variance = CONTRACTED.warp(mean, direction, t_var, r_var)
    covariance = lift_covariance(direction, t_var, r_var)
    expected_mean, expected = contract_gaussians(mean, covariance)
    np.testing.assert_allclose(warped, expected_mean)
    diagonal = jnp.diagonal(expected, axis1=-2, axis2=-1)
    np.testing.assert_allclose(variance, diagonal, rtol=1e-4, atol=1e-9)
