# SPDX-License-Identifier: Apache-2.0
"""Rays from pixels."""

import jax.numpy as jnp
import numpy as np

from internal.cameras import cast_rays, pixel_directions
from internal.coord import Unbounded

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
    np.testing.assert_allclose(np.linalg.norm(rays.viewdirs, axis=-1), 1.0, rtol=1e-6)
