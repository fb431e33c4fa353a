# SPDX-License-Identifier: Apache-2.0
"""Multiresolution grids in one flat table, hashed where a dense one is too large.

(Mueller et al., Instant Neural Graphics Primitives, 2022.) Positions are in the
unit cube. A cell is cut into six tetrahedra along its main diagonal, so a lookup
reads four vertices instead of eight: half the gathers and half the scatters, and the
scatters are what a step of training waits for. ``tests/test_grids.py`` holds the
slow form.
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int

_PRIMES = (1, 2654435761, 805459861)  # of the spatial hash, one per axis


@dataclasses.dataclass(frozen=True)
class Grid:
    """One grid of the pyramid and its part of the table."""

    resolution: int  # cells along an axis
    start: int  # first row
    rows: int  # a power of two where hashed

    @property
    def hashed(self) -> bool:
        return (self.resolution + 1) ** 3 > self.rows


def make_levels(resolutions: tuple[int, ...], max_rows: int) -> tuple[Grid, ...]:
    """Levels end to end in one table; more than ``max_rows`` vertices are hashed."""
    levels: list[Grid] = []
    start = 0
    for resolution in resolutions:
        rows = min((resolution + 1) ** 3, max_rows)
        levels.append(Grid(resolution, start, rows))
        start += rows
    return tuple(levels)


def geometric_resolutions(coarsest: int, finest: int, count: int) -> tuple[int, ...]:
    """``count`` resolutions in equal ratios."""
    return tuple(int(x) for x in np.round(np.geomspace(coarsest, finest, count)))


def vertices(
    position: Float[Array, "n 3"], levels: tuple[Grid, ...]
) -> tuple[list[Int[Array, "levels n"]], list[Float[Array, "levels n"]]]:
    """Table rows and barycentric weights of the four vertices around positions.

    From a cell's lowest corner to its highest, the path that first steps along the
    axis with the largest fraction, then along the second, then along the third.
    """
    cells = _column([level.resolution for level in levels], np.float32)
    side = _column([level.resolution + 1 for level in levels], np.uint32)
    hashed = _column([level.hashed for level in levels], bool)
    strides = (jnp.ones_like(side), side, side * side)
    lowest, steps, fractions = [], [], []
    for axis in range(3):
        scaled = position[:, axis] * cells
        cell = jnp.clip(jnp.floor(scaled), 0.0, cells - 1.0)
        fractions.append(scaled - cell)
        stride = jnp.where(hashed, jnp.uint32(_PRIMES[axis]), strides[axis])
        lowest.append(cell.astype(jnp.uint32) * stride)
        steps.append(stride)
    x, y, z = fractions
    largest = jnp.maximum(jnp.maximum(x, y), z)
    smallest = jnp.minimum(jnp.minimum(x, y), z)
    middle = x + y + z - largest - smallest
    weights = [1.0 - largest, largest - middle, middle - smallest, smallest]

    first = [(x >= y) & (x >= z), (y > x) & (y >= z), (z > x) & (z > y)]
    last = [(x < y) & (x < z), (y <= x) & (y < z), (z <= x) & (z <= y)]
    always, never = jnp.ones_like(first[0]), jnp.zeros_like(first[0])
    stepped = [[never] * 3, first, [~a for a in last], [always] * 3]
    mask = _column([level.rows - 1 for level in levels], np.uint32)
    start = _column([level.start for level in levels], np.uint32)
    rows = []
    for taken in stepped:
        terms = [
            low + jnp.where(go, step, jnp.uint32(0))
            for low, step, go in zip(lowest, steps, taken, strict=True)
        ]
        dense = terms[0] + terms[1] + terms[2]
        spread = (terms[0] ^ terms[1] ^ terms[2]) & mask
        rows.append((jnp.where(hashed, spread, dense) + start).astype(jnp.int32))
    return rows, weights


def lookup(
    table: Float[Array, "rows f"],
    position: Float[Array, "n 3"],
    levels: tuple[Grid, ...],
) -> Float[Array, "levels n f"]:
    """Interpolates every level at positions in [0, 1]^3 (Instant NGP Sec. 3).

    Only the table has a gradient: positions follow from the rays. Its gradient is
    one scatter; autodiff would make a table of zeros for each vertex.
    """
    return _interpolate(table, *vertices(position, levels))


@jax.custom_vjp
def _interpolate(table: Any, rows: Any, weights: Any) -> Any:
    parts = [
        table.at[row].get(mode="promise_in_bounds") * weight[..., None]
        for row, weight in zip(rows, weights, strict=True)
    ]
    return parts[0] + parts[1] + parts[2] + parts[3]


def _interpolate_forward(table, rows, weights):
    return _interpolate(table, rows, weights), (table, rows, weights)


def _interpolate_backward(saved, gradient):
    table, rows, weights = saved
    parts = jnp.stack([weight[..., None] * gradient for weight in weights])
    scattered = (
        jnp.zeros_like(table).at[jnp.stack(rows)].add(parts, mode="promise_in_bounds")
    )
    return scattered, None, None


_interpolate.defvjp(_interpolate_forward, _interpolate_backward)


def seen_fraction(
    std: Float[Array, " n"], levels: tuple[Grid, ...]
) -> Float[Array, "levels n"]:
    """How much of each level's detail a footprint leaves: the part of a Gaussian of
    ``std`` (in units of the cube) that lies inside one cell (Zip-NeRF Sec. 2)."""
    cells = _column([level.resolution for level in levels], np.float32)
    return jax.lax.erf(1.0 / (np.sqrt(8.0) * jnp.maximum(std * cells, 1e-6)))


def _column(values: list, dtype: type) -> Array:
    return jnp.asarray(np.array(values, dtype)[:, None])
