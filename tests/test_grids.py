# SPDX-License-Identifier: Apache-2.0
"""Grids: the fast lookup against a slow one, and what interpolation must obey."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from internal import grids
from internal.fields.hash_grid import to_cube

PRIMES = (1, 2654435761, 805459861)
LEVELS = grids.make_levels((2, 5, 40), max_rows=512)  # dense, dense, hashed
lookup = jax.jit(grids.lookup, static_argnums=2)
vertices = jax.jit(grids.vertices, static_argnums=1)
ROWS = LEVELS[-1].start + LEVELS[-1].rows


def slow_row(level, vertex):
    """The row of a vertex, in Python's integers."""
    if level.hashed:
        mixed = 0
        for coordinate, prime in zip(vertex, PRIMES, strict=True):
            mixed ^= int(coordinate) * prime % 2**32
        return level.start + mixed % level.rows
    side = level.resolution + 1
    x, y, z = (int(c) for c in vertex)
    return level.start + x + side * y + side**2 * z


def slow_lookup(table, point, level):
    """Walks from the cell's lowest corner, one axis at a time, largest first."""
    scaled = point * level.resolution
    vertex = np.minimum(np.floor(scaled), level.resolution - 1)
    fraction = scaled - vertex
    order = np.argsort(-fraction, kind="stable")
    heights = [1.0, *fraction[order], 0.0]
    value = (heights[0] - heights[1]) * table[slow_row(level, vertex)]
    for step, axis in enumerate(order):
        vertex[axis] += 1
        weight = heights[step + 1] - heights[step + 2]
        value = value + weight * table[slow_row(level, vertex)]
    return value


@pytest.fixture(scope="module")
def table():
    return np.random.default_rng(0).normal(size=(ROWS, 2)).astype(np.float32)


@pytest.fixture(scope="module")
def points():
    ties = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [0.5, 0.5, 0.5], [0.3, 0.3, 0.9]]
    drawn = np.random.default_rng(1).uniform(size=(60, 3))
    return np.concatenate([ties, drawn]).astype(np.float32)


def test_lookup_is_the_slow_one(table, points):
    fast = lookup(jnp.array(table), jnp.array(points), LEVELS)
    for index, level in enumerate(LEVELS):
        slow = np.array([slow_lookup(table, point, level) for point in points])
        np.testing.assert_allclose(fast[index], slow, atol=2e-5)


def test_gradient_is_that_of_autodiff(table, points):
    def plain(table):
        rows, weights = grids.vertices(jnp.array(points), LEVELS)
        return sum(table[r] * w[..., None] for r, w in zip(rows, weights, strict=True))

    def energy(look_up):
        return jax.grad(lambda table: jnp.sum(look_up(table) ** 2))(jnp.array(table))

    fast = energy(lambda table: lookup(table, jnp.array(points), LEVELS))
    np.testing.assert_allclose(fast, energy(plain), rtol=1e-5, atol=1e-5)


@given(st.lists(st.floats(0.0, 1.0, width=32), min_size=3, max_size=3))
@settings(max_examples=40)
def test_weights_are_barycentric(point):
    rows, weights = vertices(jnp.array([point], jnp.float32), LEVELS)
    assert np.all(np.array(weights) >= -1e-6)
    np.testing.assert_allclose(sum(weights), 1.0, atol=1e-5)
    for level, index in zip(LEVELS, np.array(rows)[:, :, 0].T, strict=True):
        assert np.all((index >= level.start) & (index < level.start + level.rows))


def test_a_linear_function_is_reproduced(points):
    level = grids.make_levels((5,), 1000)
    grid = np.stack(np.meshgrid(*[np.arange(6) / 5] * 3, indexing="ij"), -1)
    values = grid @ [1.0, -2.0, 3.0] + 0.5
    rows = values.transpose(2, 1, 0).reshape(-1, 1).astype(np.float32)
    found = lookup(jnp.array(rows), jnp.array(points), level)[0, :, 0]
    np.testing.assert_allclose(found, points @ [1.0, -2.0, 3.0] + 0.5, atol=1e-5)


def test_the_interpolant_is_continuous(table):
    """Across faces of cells and of tetrahedra: a tiny step is a tiny change."""
    line = np.linspace(0.01, 0.99, 4001, dtype=np.float32)
    path = jnp.array(np.stack([line, line[::-1] ** 2, np.sqrt(line)], axis=-1))
    values = lookup(jnp.array(table), path, LEVELS)
    assert np.abs(np.diff(values, axis=1)).max() < 0.25


def test_a_footprint_hides_levels_finer_than_itself():
    std = jnp.array([1e-6, 0.01, 0.1, 10.0])
    seen = np.array(grids.seen_fraction(std, LEVELS))
    assert np.all(np.diff(seen, axis=0) <= 1e-6)  # finer levels are hidden first
    assert np.all(np.diff(seen, axis=1) <= 1e-6)  # wider footprints hide more
    np.testing.assert_allclose(seen[:, 0], 1.0, atol=1e-4)
    assert np.all(seen[:, -1] < 0.05)


def test_the_cube_holds_all_of_space_and_keeps_the_middle():
    far = jnp.array([[1e6, -1e6, 0.5], [0.5, -0.25, 1.0]])
    position, std = to_cube(far, jnp.full((2, 3), 0.04))
    assert np.all((position >= 0.0) & (position <= 1.0))
    np.testing.assert_allclose(position[1], far[1] / 4.0 + 0.5, atol=1e-6)
    np.testing.assert_allclose(std, 0.2 / 4.0, rtol=1e-5)


def test_resolutions_grow_in_equal_ratios():
    assert grids.geometric_resolutions(16, 1024, 4) == (16, 64, 256, 1024)
