# SPDX-License-Identifier: Apache-2.0
"""Rays from pixels."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from internal.cameras import cast_rays, pixel_directions
from internal.coord import Unbounded
from internal.scene import colmap
from internal.scene.scene import posed_cameras
from tests.test_colmap import LENSES

WORLD = Unbounded(jnp.float32(0.5), jnp.float32(10.0))


def test_rays_leave_the_camera_through_their_pixel(tiny_cameras):
    view, x, y = (jnp.array([k]) for k in (2, 7, 1))
    origin, direction = pixel_directions(tiny_cameras, view, x, y)
    np.testing.assert_allclose(origin, [[0.2, 0.0, 0.0]])
    np.testing.assert_allclose(direction, [[0.25, 0.25, -1.0]], atol=1e-6)


def test_radius_gives_a_cone_the_variance_of_its_pixel(tiny_cameras):
    # Pixels are 0.1 apart at depth 1: radius 0.1 * 2 / sqrt(12), also at borders.
    view = jnp.zeros(4, jnp.int32)
    x, y = jnp.array([0, 9, 0, 9]), jnp.array([0, 0, 7, 7])
    rays = cast_rays(tiny_cameras, WORLD, view, x, y)
    np.testing.assert_allclose(rays.radii, 0.2 / np.sqrt(12), rtol=1e-5)


def test_a_tilted_camera_turns_its_rays(tiny_cameras):
    quarter_turn = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]], np.float32)
    poses = tiny_cameras.camtoworlds.at[:, :, :3].set(quarter_turn)
    turned = tiny_cameras.replace(camtoworlds=poses)
    index = jnp.array([0])
    _, direction = pixel_directions(turned, index, index, index)
    _, straight = pixel_directions(tiny_cameras, index, index, index)
    np.testing.assert_allclose(direction[0], quarter_turn @ straight[0], atol=1e-6)


def test_ndc_radius_is_that_of_the_near_plane(tiny_cameras, ndc):
    view, x, y = (jnp.array([k]) for k in (1, 4, 4))
    rays = cast_rays(tiny_cameras, ndc, view, x, y)
    # x: 0.1 * 2 and y: 0.1 * 2.5 apart in NDC, everywhere along the ray.
    np.testing.assert_allclose(rays.radii, [[0.45 / np.sqrt(12)]], rtol=1e-5)


def test_view_directions_are_the_worlds_in_every_space(tiny_cameras, ndc):
    view, x, y = jnp.array([0, 2]), jnp.array([0, 9]), jnp.array([0, 6])
    _, world = pixel_directions(tiny_cameras, view, x, y)
    expected = world / np.linalg.norm(world, axis=-1, keepdims=True)
    for space in (WORLD, ndc):
        rays = cast_rays(tiny_cameras, space, view, x, y)
        np.testing.assert_allclose(rays.viewdirs, expected, rtol=1e-6)


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
def test_a_small_table_holds_a_large_lens_to_a_fraction_of_a_pixel(lens):
    large = colmap.scale_lens(lens, 30 * lens.width, 30 * lens.height)
    cameras = posed_cameras([large], np.eye(4)[None, :3])
    rng = np.random.default_rng(0)
    x, y = rng.integers(0, [[large.width], [large.height]], (2, 2000))
    places = (jnp.zeros(2000, int), jnp.asarray(x), jnp.asarray(y))
    _, directions = pixel_directions(jax.tree.map(jnp.asarray, cameras), *places)
    pixels = np.stack([x, y], axis=-1) + 0.5
    rays = colmap.pixel_rays(large, pixels)
    beside = colmap.pixel_rays(large, pixels + np.array([0.0, 0.1]))
    found = np.asarray(directions, np.float64)
    found /= np.linalg.norm(found, axis=-1, keepdims=True)
    pixel = np.linalg.norm(beside - rays, axis=-1) / 0.1
    error = np.linalg.norm(found - rays, axis=-1) / pixel
    assert np.max(error) < (1e-3 if lens.model.endswith("PINHOLE") else 0.05)
    assert cameras.directions.nbytes < 2e5 < 12 * large.width * large.height
