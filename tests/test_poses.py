# SPDX-License-Identifier: Apache-2.0
"""Similarities, against the matrices that say the same."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from internal.poses import Similarity, rotation_errors
from tests.scene_writers import facing_world, random_rotation

WORLD = facing_world()


@st.composite
def similarities(draw):
    seed = draw(st.integers(0, 10**6))
    shift = np.random.default_rng(seed).normal(size=3)
    return Similarity(draw(st.floats(0.01, 100.0)), random_rotation(seed), shift)


@given(similarities())
def test_points_and_cameras_go_where_the_formula_takes_them(similarity):
    moved = WORLD.moved(similarity.scale, similarity.rotation, similarity.shift)
    np.testing.assert_allclose(similarity.points(WORLD.points), moved.points)
    np.testing.assert_allclose(
        similarity.poses(WORLD.camtoworlds), moved.camtoworlds, atol=1e-12
    )
    homogeneous = np.pad(WORLD.points, ((0, 0), (0, 1)), constant_values=1.0)
    by_matrix = homogeneous @ similarity.matrix.T
    np.testing.assert_allclose(by_matrix[:, :3], moved.points, atol=1e-9)
    np.testing.assert_array_equal(by_matrix[:, 3], 1.0)


@given(similarities())
def test_axes_of_moved_cameras_stay_a_rotation(similarity):
    assert rotation_errors(similarity.poses(WORLD.camtoworlds)).max() < 1e-12


@given(similarities())
def test_the_inverse_is_the_way_back(similarity):
    back = similarity.inverse()
    np.testing.assert_allclose(back.matrix, np.linalg.inv(similarity.matrix), 1e-9)
    again = back.poses(similarity.poses(WORLD.camtoworlds))
    np.testing.assert_allclose(again, WORLD.camtoworlds, atol=1e-9)


@given(similarities(), similarities())
def test_a_product_is_the_right_one_first(second, first):
    both = second @ first
    np.testing.assert_allclose(both.matrix, second.matrix @ first.matrix, 1e-9, 1e-9)
    assert both.scale == pytest.approx(second.scale * first.scale)


@given(similarities(), st.integers(0, 99))
@settings(max_examples=20)
def test_about_a_point_that_point_goes_to_0(similarity, seed):
    origin = np.random.default_rng(seed).normal(size=3)
    about = Similarity.about(origin, similarity.scale, similarity.rotation)
    np.testing.assert_allclose(about.points(origin[None]), 0.0, atol=1e-9)
    np.testing.assert_array_equal(about.matrix[:3, :3], similarity.matrix[:3, :3])
