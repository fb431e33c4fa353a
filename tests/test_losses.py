# SPDX-License-Identifier: Apache-2.0
"""Every loss against a number worked by hand, and its laws."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from internal import losses, stepfun
from internal.configs import LossConfig
from internal.structs import Colored, Histogram, Level, Levels
from internal.training.step import data_eps, field_terms

GRAY = jnp.full((4, 3), 0.3)


def test_data_loss_by_hand():
    # ((0.2 - 0.1) / (0.2 + 0.05))^2 = 0.16
    rgb, target = jnp.full((2, 3), 0.2), jnp.full((2, 3), 0.1)
    np.testing.assert_allclose(losses.data_loss(rgb, target, eps=0.05), 0.16, rtol=1e-5)


def test_data_loss_gradient_is_that_of_a_weighted_error():
    # The denominator is stopped: d/dc (c - y)^2 / (c + e)^2 = 2 (c - y) / (c + e)^2.
    gradient = jax.grad(
        lambda c: losses.data_loss(jnp.full((1, 3), c), jnp.full((1, 3), 0.1), eps=0.0)
    )(0.2)
    np.testing.assert_allclose(gradient, 2 * 0.1 / 0.2**2, rtol=1e-5)


def test_prediction_above_one_equals_a_clipped_pixel():
    white = jnp.ones((2, 3))
    assert losses.data_loss(3.0 * white, white, eps=1e-3) == 0.0


def test_prediction_above_one_is_pulled_back_from_any_other_pixel():
    gradient = jax.grad(
        lambda c: losses.data_loss(jnp.full((1, 3), c), jnp.full((1, 3), 0.5), eps=0.1)
    )
    assert gradient(3.0) > 0.0


def test_the_weight_of_an_error_is_that_of_the_clipped_prediction():
    # A prediction of 3 weighs as one of 1: (3 - 0.5) / (1 + 0.1), squared.
    value = losses.data_loss(jnp.full((1, 3), 3.0), jnp.full((1, 3), 0.5), eps=0.1)
    np.testing.assert_allclose(value, (2.5 / 1.1) ** 2, rtol=1e-5)


@pytest.mark.parametrize(("level", "pulls"), [(160, True), (254, True), (255, False)])
def test_only_a_photo_at_its_highest_level_may_be_brighter(level, pulls):
    gradient = jax.grad(
        lambda c: losses.data_loss(
            jnp.full((1, 3), c), jnp.full((1, 3), level / 255), eps=0.1
        )
    )(2.0)
    assert (gradient > 0.0) == pulls


def test_exposure_loss_by_hand_and_its_indifference_to_colour():
    # mean channel 0.3 against 0.5: 0.04
    colored = jnp.array([[0.1, 0.3, 0.5]])
    for picture in (jnp.full((1, 3), 0.3), colored):
        value = losses.exposure_loss(picture, target=0.5)
        np.testing.assert_allclose(value, 0.04, rtol=1e-5)


def test_gray_world_loss_of_gray_is_zero():
    assert losses.gray_world_loss(GRAY, GRAY, bias=0.5) < 1e-12


def test_gray_world_loss_by_hand():
    # var(0.1, 0.2, 0.6) = 0.14 / 3; r = (0.5, 1, 1): var = 1/18; 0.0466667 / 0.555556
    enhanced, r = jnp.array([[0.1, 0.2, 0.6]]), jnp.array([[1.0, 2.0, 2.0]])
    value = losses.gray_world_loss(enhanced, r, bias=0.5)
    np.testing.assert_allclose(value, (0.14 / 3) / (0.5 + 1 / 18), rtol=1e-4)


def test_gray_world_loss_is_relaxed_by_saturation_and_blind_to_the_scale_of_r():
    enhanced = jnp.array([[0.1, 0.2, 0.6]])
    saturated, pale = jnp.array([[0.1, 0.2, 1.0]]), jnp.array([[0.9, 0.9, 1.0]])
    strict = losses.gray_world_loss(enhanced, pale, bias=0.5)
    relaxed = losses.gray_world_loss(enhanced, saturated, bias=0.5)
    assert relaxed < strict
    scaled = losses.gray_world_loss(enhanced, 7.0 * saturated, bias=0.5)
    np.testing.assert_allclose(scaled, relaxed, rtol=1e-4)


def test_gray_world_gradient_is_finite_at_gray():
    gradient = jax.grad(lambda c: losses.gray_world_loss(c, GRAY, bias=0.5))(GRAY)
    assert np.all(np.isfinite(gradient))


def test_gamma_norm_by_hand():
    # |gamma|^2 = 0.3 and 0.9 over three channels: mean 0.2
    np.testing.assert_allclose(
        losses.gamma_norm_loss(jnp.array([[0.3], [0.9]])), 0.2, rtol=1e-6
    )


def test_smoothness_by_hand():
    # log v equal: denominators are eps. Right differs by 0.1, below by 0.2:
    # (0.01 + 0.04) / 0.5 / 2 = 0.05
    alpha = jnp.array([[[0.5], [0.6], [0.3]]])
    v = jnp.full((1, 3, 1), 0.2)
    value = losses.smoothness_loss(alpha, v, beta=1.5, eps=0.5)
    np.testing.assert_allclose(value, 0.05, rtol=1e-5)


def test_smoothness_at_an_edge_by_hand():
    # log(v + 0.1) rises by 1 to the right: 0.01 / (1.5 * 1 + 0.1) / 2 = 0.003125
    alpha = jnp.array([[[0.5], [0.6], [0.5]]])
    v = jnp.array([[[0.1], [0.2 * np.e - 0.1], [0.1]]])
    value = losses.smoothness_loss(alpha, v, beta=1.5, eps=0.1)
    np.testing.assert_allclose(value, 0.003125, rtol=1e-4)


def test_smoothness_of_constant_coefficients_is_zero_and_edges_relax_it():
    flat, step = jnp.full((1, 3, 1), 0.2), jnp.array([[[0.02], [0.4], [0.4]]])
    assert losses.smoothness_loss(flat, step, beta=1.5, eps=1e-4) == 0.0
    rough = jnp.array([[[0.2], [0.3], [0.4]]])
    on_flat = losses.smoothness_loss(rough, flat, beta=1.5, eps=1e-4)
    on_edge = losses.smoothness_loss(rough, step, beta=1.5, eps=1e-4)
    assert on_edge < 1e-3 * on_flat


def test_smoothness_does_not_move_v():
    v = jnp.array([[[0.02], [0.4], [0.3]]])
    alpha = jnp.array([[[0.2], [0.3], [0.4]]])
    gradient = jax.grad(lambda x: losses.smoothness_loss(alpha, x, beta=1.5, eps=1e-4))(
        v
    )
    np.testing.assert_array_equal(gradient, jnp.zeros_like(v))


EDGES = jnp.array([[0.0, 0.2, 0.5, 1.0]])
WEIGHTS = jnp.array([[0.2, 0.7, 0.1]])


def terms(config: LossConfig, proposed: jax.Array, seen: jax.Array, share: float = 0.0):
    """Of a ray with a proposal and a coarse level, so far into the training."""
    rgb = jnp.full((1, 3), 0.2)
    level = Level(EDGES, seen, rgb, Colored(jnp.ones((1, 1)), rgb[:, None]))
    levels = Levels((Histogram(EDGES, proposed),), (level,), level)
    return field_terms(config, levels, [0.5 * rgb, rgb], 0.9 * rgb, 0.1, share)


def test_the_epsilon_of_the_data_term_grows_with_the_photos_mean():
    config = LossConfig(data_eps=1e-3, data_eps_of_mean=0.5)
    assert data_eps(config, 0.06) == pytest.approx(0.031)


def test_terms_of_the_field_by_hand():
    got = terms(
        LossConfig(coarse=0.3, interlevel=0.5, distortion=0.7), WEIGHTS / 2, WEIGHTS
    )
    rgb = jnp.full((1, 3), 0.2)
    expected = {
        "data": losses.data_loss(rgb, 0.9 * rgb, eps=0.1),
        "coarse": 0.3 * losses.data_loss(0.5 * rgb, 0.9 * rgb, eps=0.1),
        "interlevel": 0.5 * stepfun.interlevel(EDGES, WEIGHTS, EDGES, WEIGHTS / 2)[0],
        "distortion": 0.7 * stepfun.distortion(EDGES, WEIGHTS)[0],
    }
    assert got.keys() == expected.keys()
    for name, value in expected.items():
        assert value > 0.0
        np.testing.assert_allclose(got[name], value, rtol=1e-5, err_msg=name)


def test_the_weight_of_distortion_grows_in_equal_ratios_and_no_other_does():
    config = LossConfig(distortion=0.2, distortion_growth=9.0)
    start, half, end = (terms(config, WEIGHTS / 2, WEIGHTS, x) for x in (0.0, 0.5, 1.0))
    spread = stepfun.distortion(EDGES, WEIGHTS)[0]
    for got, weight in ((start, 0.2), (half, 0.6), (end, 1.8)):
        np.testing.assert_allclose(got.pop("distortion"), weight * spread, rtol=1e-5)
    assert start == half == end


def test_interlevel_moves_the_proposal_and_not_what_it_proposes_for():
    def interlevel(proposed, seen):
        return terms(LossConfig(), proposed, seen)["interlevel"]

    proposed, seen = jax.grad(interlevel, argnums=(0, 1))(WEIGHTS / 2, WEIGHTS)
    assert jnp.all(proposed < 0.0)
    np.testing.assert_array_equal(seen, jnp.zeros_like(seen))
