# SPDX-License-Identifier: Apache-2.0
"""Fields behind one interface: each one renders and learns; the fast one is fast
for the right reasons."""

from typing import Any

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import linen as nn

from internal import grids
from internal.cameras import cast_rays
from internal.configs import load_config
from internal.enhancements.look import NEUTRAL
from internal.fields.base import FieldConfig
from internal.fields.hash_grid import HashGrid
from internal.fields.mlp import MLP
from internal.losses import data_loss
from internal.models import Histogram, Level, Model
from internal.training.step import initial_state
from tests.conftest import TINY_GAMMA, TINY_SIZES
from tests.test_training import make_run

TINY_GRID = (
    *TINY_SIZES,
    *TINY_GAMMA,
    "Model.field = @HashGrid()",
    "HashGrid.levels = 3",
    "HashGrid.finest = 32",
    "HashGrid.log2_rows = 10",
    "HashGrid.proposal_resolutions = (4, 8)",
    "Losses.data_eps_of_mean = 0.5",
)


@pytest.fixture(scope="module")
def grid_run(tiny_cameras, tiny_images, ndc):
    config = load_config([], TINY_GRID)
    return make_run(config, tiny_cameras, tiny_images, ndc, jax.devices()[:1])


def grid_and_rays(cameras, space):
    """A model of the fast field, its parameters, and five rays."""
    config = load_config([], TINY_GRID)
    model = Model(config.model)
    params = {"params": initial_state(config, model).params}
    index = jnp.zeros(5, jnp.int32)
    return model, params, jax.jit(cast_rays)(cameras, space, index, index, index)


@pytest.mark.parametrize("name", ["MLP", "HashGrid"])
def test_every_field_keeps_the_interface(name):
    config = load_config([], [f"Model.field = @{name}()"])
    assert isinstance(config.model.field, FieldConfig)
    assert type(config.model.field).__name__ == name


def test_a_proposal_chooses_where_the_field_is_asked(tiny_cameras, ndc):
    model, params, rays = grid_and_rays(tiny_cameras, ndc)
    apply = jax.jit(model.apply, static_argnames="method")
    levels = apply(params, rays, ndc, method="march")
    (first,), last = levels.proposals, levels.last
    assert type(first) is Histogram and isinstance(last, Level)
    rendering = apply(params, rays, ndc, NEUTRAL)
    assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves(rendering))
    np.testing.assert_allclose(jnp.sum(last.weights, -1), 1.0, atol=1e-5)


def test_a_proposal_does_not_learn_through_the_places_it_chose(tiny_cameras, ndc):
    model, params, rays = grid_and_rays(tiny_cameras, ndc)

    def middles(params):
        levels: Any = model.apply(params, rays, ndc, method="march")
        edges = levels.last.s_edges
        return jnp.sum(edges[:, 1:-1] ** 2)

    gradients = jax.tree.leaves(jax.jit(jax.grad(middles))(params))
    assert all(np.all(x == 0.0) for x in gradients)


def test_the_fast_field_and_its_proposal_learn(grid_run):
    run, start = grid_run
    state, stats = run(start, 3)
    assert stats.terms["interlevel"] > 0.0
    for name in ("field", "proposal"):
        before, after = start.params[name], state.params[name]
        moved = jax.tree.map(lambda a, b: float(jnp.abs(a - b).max()), before, after)
        assert max(jax.tree.leaves(moved)) > 0.0, name


def test_the_fast_field_on_four_devices_gives_what_one_gives(
    grid_run, tiny_cameras, tiny_images, ndc
):
    run_one, state = grid_run
    config = load_config([], TINY_GRID)
    run_four, state_four = make_run(config, tiny_cameras, tiny_images, ndc)
    one, stats_one = run_one(state, 5)
    four, stats_four = run_four(state_four, 5)
    chex.assert_trees_all_close(stats_one.terms, stats_four.terms, rtol=1e-3)
    chex.assert_trees_all_close(one.params, four.params, atol=1e-4)


def test_far_and_near_views_of_a_texture_agree_better_with_footprints():
    """A far pixel should see what the near pixels inside it see on average."""
    levels = grids.make_levels(grids.geometric_resolutions(8, 512, 7), 2**14)
    key = jax.random.key(0)
    table = jax.random.normal(key, (levels[-1].start + levels[-1].rows, 2))
    centres = jax.random.uniform(jax.random.fold_in(key, 1), (40, 3), minval=0.2)
    std = 1.0 / 100.0
    inside = centres[:, None] + std * jax.random.normal(
        jax.random.fold_in(key, 2), (40, 500, 3)
    )
    lookup = jax.jit(grids.lookup, static_argnums=2)
    near = lookup(table, jnp.clip(inside, 0, 1).reshape(-1, 3), levels)
    near = jnp.mean(near.reshape(len(levels), 40, 500, 2), axis=2)
    far = lookup(table, centres, levels)
    weighted = far * grids.seen_fraction(jnp.full(40, std), levels)[..., None]
    error, error_weighted = (
        jnp.mean((far - near) ** 2),
        jnp.mean((weighted - near) ** 2),
    )
    assert error_weighted < 0.2 * error


def test_the_data_term_is_the_same_at_any_brightness():
    """With epsilon in proportion, so regularisers keep their proportion to it."""
    key = jax.random.key(0)
    rgb, target = jax.random.uniform(key, (2, 50, 3)) * 0.9
    bright = data_loss(rgb, target, eps=0.2)
    dark = data_loss(rgb / 16.0, target / 16.0, eps=0.2 / 16.0)
    np.testing.assert_allclose(bright, dark, rtol=1e-5)


def shapes(trunk: nn.Module) -> dict[str, Any]:
    """Of a trunk's parameters, and the number of its features."""
    place = jnp.zeros((4, 3))
    params = jax.eval_shape(trunk.init, jax.random.key(0), place, place)
    _, features = jax.eval_shape(trunk.apply, params, place, place)
    return {**jax.tree.map(lambda x: x.shape, params["params"]), "tau": features.shape}


def test_the_encoding_enters_again_every_so_many_layers():
    found = shapes(MLP(depth=5, width=8, skip=2, max_deg=2).trunk("trunk"))
    inputs = [found[f"Dense_{layer}"]["Dense_0"]["kernel"][0] for layer in range(6)]
    assert inputs == [12, 8, 8, 8 + 12, 8, 8 + 12]


def test_a_grid_has_the_sizes_that_are_asked_for():
    sizes = HashGrid(levels=2, coarsest=4, finest=6, features=3, width_out=5)
    found = shapes(sizes.trunk("trunk"))
    assert found["tau"] == (4, 5)
    assert found["_Encoding_0"]["table"] == (5**3 + 7**3, 3)


@pytest.mark.parametrize("antialias", [True, False])
def test_a_footprint_fades_what_it_cannot_resolve_unless_told_not_to(antialias):
    trunk = HashGrid(levels=2, finest=32, antialias=antialias).trunk("trunk")
    place = jnp.full((1, 3), 0.3)
    params = trunk.init(jax.random.key(0), place, place)
    sharp, wide = (trunk.apply(params, place, jnp.full((1, 3), x)) for x in (0.0, 1.0))
    assert (sharp[0] == wide[0]).all() == (not antialias)
