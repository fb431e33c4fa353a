# SPDX-License-Identifier: Apache-2.0
"""Procedural textures of the synthetic scene: where a surface has which colour.

Vectors and colours are component-first, ``[3, points]``. ``unit`` are points in the
frames of their solids, which span [-1, 1] there on each axis; ``local`` are the same
points in decimetres. A pattern returns a blend in [0, 1] between a material's two
colours, given ``grain``: fractal noise in [0, 1]. Colours are linear RGB.
"""

import enum
import itertools

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import Array
from jaxtyping import Float, Int

from internal import color

# The well-known sRGB values of a 24-patch colour chart, top-left patch first.
CHART_SRGB = (
    np.array(
        [
            [115, 82, 68], [194, 150, 130], [98, 122, 157],
            [87, 108, 67], [133, 128, 177], [103, 189, 170],
            [214, 126, 44], [80, 91, 166], [193, 90, 99],
            [94, 60, 108], [157, 188, 64], [224, 163, 46],
            [56, 61, 150], [70, 148, 73], [175, 54, 60],
            [231, 199, 31], [187, 86, 149], [8, 133, 161],
            [243, 243, 242], [200, 200, 200], [160, 160, 160],
            [122, 122, 121], [85, 85, 85], [52, 52, 52],
        ],
        np.float32,
    )
    / 255
)  # fmt: skip
OCTAVES = 5


class Pattern(enum.IntEnum):
    """Which texture a material wears."""

    MOTTLED = 0
    WOOD = 1
    CHECKER = 2
    BRICK = 3
    STRIPES = 4
    GLOBE = 5
    BOOK = 6
    CUP = 7
    CHART = 8


@struct.dataclass
class Material:
    """The look of a solid; leaves have the solids as leading or the points as last
    axis, whichever they belong to."""

    pattern: Int[Array, "..."]
    colors: Float[Array, "..."]  # two linear RGB, blended by the pattern
    cell: Float[Array, "..."]  # size of one repeat, decimetres
    grain_scale: Float[Array, "..."]  # xyz: noise cells per decimetre
    roughness: Float[Array, "..."]  # 0 mirror, 1 matte
    metalness: Float[Array, "..."]  # 0 dielectric, 1 metal
    emission: Float[Array, "..."]  # linear RGB, as seen


def albedo(
    material: Material, unit: Float[Array, "3 points"], local: Float[Array, "3 points"]
) -> Float[Array, "3 points"]:
    """Linear RGB reflectance of surface points."""
    grain = fractal_noise(local * material.grain_scale)
    cells = local / material.cell[None]
    blend = jnp.select(
        [material.pattern == pattern for pattern in range(Pattern.CHART)],
        [
            grain,
            _wood(cells, grain),
            _checker(cells, grain),
            _brick(cells, grain),
            _stripes(cells, grain),
            _globe(grain),
            _book(unit, local, grain),
            _cup(unit, cells, grain),
        ],
        0.0,
    )
    first, second = material.colors
    color = first + blend[None] * (second - first)
    chart = _chart(unit) * (0.92 + 0.16 * grain)[None]
    return jnp.where((material.pattern == Pattern.CHART)[None], chart, color)


def fractal_noise(point: Float[Array, "3 points"]) -> Float[Array, " points"]:
    """Octaves of value noise, each twice as fine and 0.6 as strong; in [0, 1]."""
    octaves = jnp.arange(OCTAVES, dtype=jnp.float32)
    weights = 0.6**octaves

    def add_octave(total, octave_and_weight):
        octave, weight = octave_and_weight
        # The shift keeps the lattice planes of different octaves apart.
        noise = value_noise(point * 2.0**octave + 17.3 * octave)
        return total + weight * noise, None

    # A loop, not a sum: XLA would compute the noise anew for every use of it.
    total, _ = jax.lax.scan(add_octave, jnp.zeros_like(point[0]), (octaves, weights))
    return jnp.clip(0.5 + 1.8 * (total / jnp.sum(weights) - 0.5), 0.0, 1.0)


def value_noise(point: Float[Array, "3 points"]) -> Float[Array, " points"]:
    """Random values in [0, 1] on the integer lattice, smoothly interpolated."""
    base = jnp.floor(point)
    fraction = point - base
    upper = fraction * fraction * (3.0 - 2.0 * fraction)
    weights = jnp.stack([1.0 - upper, upper])
    total = jnp.zeros_like(point[0])
    for i, j, k in itertools.product((0, 1), repeat=3):
        weight = weights[i, 0] * weights[j, 1] * weights[k, 2]
        total += weight * _hash(base[0] + i, base[1] + j, base[2] + k)
    return total


def _hash(x: Array, y: Array, z: Array) -> Array:
    """A fixed pseudo-random number in [0, 1) per integer cell."""
    x, y, z = (axis.astype(jnp.int32).astype(jnp.uint32) for axis in (x, y, z))
    bits = x * 374761393 + y * 668265263 + z * 1440662683
    bits = (bits ^ (bits >> 15)) * 1911520717
    bits = (bits ^ (bits >> 13)) * 1274126177
    return (bits >> 8).astype(jnp.float32) * 2.0**-24


def _repeat(coordinate: Array) -> tuple[Array, Array]:
    """Number of the cell a coordinate lies in, and its place in it in [0, 1)."""
    number = jnp.floor(coordinate)
    return number, coordinate - number


def _odd(number: Array) -> Array:
    """1 for odd whole numbers, 0 for even ones."""
    return 2.0 * _repeat(0.5 * number)[1]


def _step(edge: float, value: Array, width: float = 0.02) -> Array:
    """0 below ``edge``, 1 above it, smooth over ``width``."""
    return jnp.clip((value - edge) / width + 0.5, 0.0, 1.0)


def _wood(cells: Array, grain: Array) -> Array:
    """Planks along x, one cell wide along z, each with its own rings and tone."""
    plank, across = _repeat(cells[2])
    tone = _hash(plank, plank, plank)
    rings = 0.5 + 0.5 * jnp.sin(2 * jnp.pi * (6.0 * grain + tone))
    seam = _step(0.012, jnp.minimum(across, 1.0 - across))
    return (0.45 * rings + 0.25 * grain + 0.3 * tone) * (0.3 + 0.7 * seam)


def _checker(cells: Array, grain: Array) -> Array:
    """Squares in x and z, slightly stained."""
    odd = _odd(jnp.floor(cells[0]) + jnp.floor(cells[2]))
    return 0.8 * odd + 0.2 * grain


def _brick(cells: Array, grain: Array) -> Array:
    """Courses one cell high of bricks 2.4 cells long; 0 is mortar."""
    course, up = _repeat(cells[1])
    number, along = _repeat(cells[0] / 2.4 + 0.5 * _odd(course))
    to_edge = jnp.minimum(
        jnp.minimum(up, 1.0 - up), 2.4 * jnp.minimum(along, 1.0 - along)
    )
    tone = _hash(number, course, course)
    return _step(0.09, to_edge, 0.06) * (0.45 + 0.3 * tone + 0.25 * grain)


def _stripes(cells: Array, grain: Array) -> Array:
    """Bands along y, wavy and stained by the grain."""
    wave = jnp.sin(2 * jnp.pi * (cells[1] + 0.25 * grain))
    return 0.85 * _step(0.0, wave, 0.3) + 0.15 * grain


def _globe(grain: Array) -> Array:
    """Continents of the second colour in a sea of the first."""
    return _step(0.52, grain, 0.05) * (0.6 + 0.4 * grain) + 0.25 * grain * (1 - grain)


def _book(unit: Array, local: Array, grain: Array) -> Array:
    """A lying book, spine towards +z: cloth is 0, paper and gilt are 1."""
    x, y, z = jnp.abs(unit)
    cloth = 0.12 * grain
    page_edge = 0.75 + 0.25 * jnp.sin(90.0 * local[1] + 3.0 * grain)
    frame = jnp.maximum(x, z)
    gilt_line = (y > 0.98) & (frame > 0.86) & (frame < 0.9)
    on_spine = unit[2] > 0.98
    band = on_spine & (jnp.abs(x - 0.75) < 0.04)
    title = on_spine & (x < 0.45) & (y < 0.3) & (_repeat(4.5 * local[0])[1] < 0.7)
    edge = (y < 0.8) & (unit[2] < 0.94) & ~on_spine
    gilt = jnp.where(gilt_line | band | title, 0.7, cloth)
    return jnp.where(edge, page_edge, gilt)


def _cup(unit: Array, cells: Array, grain: Array) -> Array:
    """A glazed cup (1) with dots on its side, full of coffee (0) on top."""
    coffee = (unit[1] > 0.98) & (unit[0] ** 2 + unit[2] ** 2 < 0.74)
    turn = jnp.arctan2(unit[2], unit[0]) * (7.0 / jnp.pi)
    row, up = _repeat(cells[1])
    _, around = _repeat(turn + 0.5 * _odd(row))
    dot = _step(0.1, (up - 0.5) ** 2 + (around - 0.5) ** 2, 0.03)
    side = 0.35 + 0.65 * dot
    return jnp.where(coffee, 0.0, jnp.where(unit[1] > 0.98, 1.0, side)) - 0.08 * grain


def _chart(unit: Array) -> Array:
    """Linear RGB of a board whose +z face shows 24 patches, six by four."""
    column, along = _repeat(3.0 * (1.0 + 1.05 * unit[0]))
    row, down = _repeat(2.0 * (1.0 - 1.08 * unit[1]))
    margin = jnp.minimum(jnp.minimum(along, 1 - along), jnp.minimum(down, 1 - down))
    inside = (column >= 0) & (column < 6) & (row >= 0) & (row < 4) & (unit[2] > 0.9)
    patch = jnp.clip(6 * row + column, 0, 23).astype(jnp.int32)
    colors = color.srgb_to_linear(CHART_SRGB)
    return jnp.where((inside & (margin > 0.07))[None], colors.T[:, patch], 0.03)
