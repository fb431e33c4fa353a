# SPDX-License-Identifier: Apache-2.0
"""The model: decomposition, enhancement, light edits, rays of both spaces."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from internal.cameras import cast_rays
from internal.configs import load_config
from internal.coord import Unbounded
from internal.enhancements.look import NEUTRAL, Look
from internal.models import Model, depth, ray_shape
from internal.structs import Colored, Level, LitRendering, Rendering
from internal.training.step import initial_state
from internal.volume import composite, with_gradient
from tests.conftest import TINY_MODEL, TINY_PLAIN


@pytest.fixture
def rays(tiny_cameras, ndc):
    view = jnp.zeros(12, jnp.int32)
    x, y = jnp.arange(12) % 10, jnp.arange(12) % 8
    return jax.jit(cast_rays)(tiny_cameras, ndc, view, x, y)


@pytest.fixture(scope="module")
def trained():
    """A compiled ``apply`` of a new tiny model and its parameters."""
    config = load_config([], TINY_MODEL)
    model = Model(config.model)
    apply = jax.jit(model.apply, static_argnames="method")
    return apply, {"params": initial_state(config, model).params}


def test_dark_colour_is_v_times_r(trained, rays, ndc):
    apply, params = trained
    last = apply(params, rays, ndc, method="march").last
    samples = last.samples
    composited = composite(last.weights, samples.v * samples.r)
    np.testing.assert_allclose(last.rgb, composited, rtol=1e-5)
    assert samples.v.shape == (12, 7, 1)
    assert samples.r.shape == (12, 7, 3)


def test_r_is_the_same_from_every_side_and_v_is_not(trained, rays, ndc):
    apply, params = trained
    turned = rays.replace(viewdirs=-rays.viewdirs[:, ::-1])
    before = apply(params, rays, ndc, method="march").coarse[0].samples
    after = apply(params, turned, ndc, method="march").coarse[0].samples
    np.testing.assert_array_equal(before.r, after.r)
    np.testing.assert_array_equal(before.density, after.density)
    assert np.max(np.abs(before.v - after.v)) > 1e-6


def test_rendering_has_every_output_and_a_plain_model_only_the_dark_ones(
    trained, rays, ndc
):
    apply, params = trained
    lit = apply(params, rays, ndc, NEUTRAL)
    assert isinstance(lit, LitRendering)
    assert lit.enhanced.shape == (12, 3)
    config = load_config([], TINY_PLAIN)
    plain = Model(config.model)
    plain_params = {"params": initial_state(config, plain).params}
    rendering = jax.jit(plain.apply)(plain_params, rays, ndc, NEUTRAL)
    assert type(rendering) is Rendering


def test_a_warm_light_warms_the_lit_picture_and_no_other(trained, rays, ndc):
    apply, params = trained
    plain = apply(params, rays, ndc, NEUTRAL)
    warm = apply(params, rays, ndc, Look(temperature=3000.0).edit())
    assert np.all(warm.enhanced[:, 0] > plain.enhanced[:, 0])
    assert np.all(warm.enhanced[:, 2] < plain.enhanced[:, 2])
    np.testing.assert_array_equal(warm.rgb, plain.rgb)


def test_an_enhancement_moves_itself_and_nothing_else(trained, rays, ndc):
    apply, params = trained

    def brightness(params):
        return jnp.mean(apply(params, rays, ndc, NEUTRAL).enhanced)

    gradient = jax.jit(jax.grad(brightness))(params)["params"]
    assert all(np.all(x == 0) for x in jax.tree.leaves(gradient["field"]))
    assert any(np.any(x != 0) for x in jax.tree.leaves(gradient["enhancement"]))


def test_a_key_randomises_and_no_key_does_not(trained, rays, ndc):
    apply, params = trained

    def edges(key):
        return apply(params, rays, ndc, key, method="march").coarse[0].s_edges

    np.testing.assert_array_equal(edges(None), edges(None))
    one, two = edges(jax.random.key(1)), edges(jax.random.key(2))
    assert np.max(np.abs(one - two)) > 1e-3
    assert np.all(np.diff(one, axis=-1) >= 0)
    np.testing.assert_array_equal(one[:, [0, -1]], np.tile([0.0, 1.0], (12, 1)))


def test_unbounded_space_renders_with_cones(trained, tiny_cameras):
    apply, params = trained
    space = Unbounded(np.float32(0.5), np.float32(20.0))
    index = jnp.zeros(4, jnp.int32)
    rays = jax.jit(cast_rays)(tiny_cameras, space, index, index, index)
    rendering = apply(params, rays, space, NEUTRAL)
    assert np.all(np.isfinite(rendering.enhanced))
    assert np.all((rendering.depth >= 0.5) & (rendering.depth <= 20.01))
    assert ray_shape("auto", space) == "cone"


@pytest.mark.parametrize("space", [Unbounded(np.float32(1.0), np.float32(9.0)), None])
def test_the_depth_of_a_wall_is_its_depth(space, ndc):
    """A quarter of the light ends before a wall, a quarter behind it."""
    space = ndc if space is None else space
    s_edges = jnp.array([[0.0, 0.3, 0.5, 0.501, 1.0]])
    weights, rgb = jnp.array([[0.1, 0.15, 0.5, 0.25]]), jnp.ones((1, 3))
    level = Level(s_edges, weights, rgb, Colored(jnp.ones((1, 1)), rgb[:, None]))
    wall = space.depth(space.s_to_t(jnp.array([[0.5005]])))
    np.testing.assert_allclose(depth(space, level), wall, rtol=1e-5)


def test_samples_are_where_they_are_whatever_the_loss(trained, rays, ndc):
    """No gradient reaches a field through the places at which it is asked."""
    apply, params = trained

    def middles(params):
        edges = apply(params, rays, ndc, method="march").last.s_edges
        return jnp.sum(edges[:, 1:-1] ** 2)

    gradients = jax.tree.leaves(jax.jit(jax.grad(middles))(params))
    assert all(np.all(x == 0.0) for x in gradients)


def test_what_is_nearer_than_the_reach_learns_less_and_looks_the_same(tiny_cameras):
    space = Unbounded(np.float32(0.5), np.float32(20.0))
    index = jnp.zeros(4, jnp.int32)
    rays = jax.jit(cast_rays)(tiny_cameras, space, index, index, index)

    def learned(reach):
        config = load_config([], [*TINY_MODEL, f"Model.near_reach = {reach}"])
        model = Model(config.model)

        def brightness(params):
            levels: Any = model.apply({"params": params}, rays, space, method="march")
            return jnp.sum(levels.last.rgb), levels.last.rgb

        params = initial_state(config, model).params
        return jax.jit(jax.grad(brightness, has_aux=True))(params)

    (whole, rgb), (all_of_it, same), (little, also) = map(learned, (0.0, 1.0, 1e3))
    np.testing.assert_array_equal(same, rgb)
    np.testing.assert_array_equal(also, rgb)
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, 1e-4), all_of_it, whole)
    most = (20.0 / 500.0) ** 2  # of the farthest sample
    assert 0.0 < optax.tree.norm(little) < most * optax.tree.norm(whole)


def test_with_gradient_passes_on_a_share_of_each_samples_gradient():
    share = jnp.array([[0.25, 1.0]])
    samples = {"a": jnp.ones((1, 2)), "b": jnp.full((1, 2, 3), 2.0)}
    kept, passed_on = jax.vjp(lambda x: with_gradient(x, share), samples)
    jax.tree.map(np.testing.assert_array_equal, kept, samples)
    (got,) = passed_on(samples)
    np.testing.assert_array_equal(got["a"], share)
    np.testing.assert_array_equal(got["b"], 2.0 * np.tile(share[..., None], 3))


def test_ray_shape_is_automatic_or_forced(ndc):
    assert ray_shape("auto", ndc) == "cylinder"
    assert ray_shape("cone", ndc) == "cone"
    assert ray_shape("cylinder", ndc) == "cylinder"
