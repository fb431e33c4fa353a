# SPDX-License-Identifier: Apache-2.0
"""Splats to pictures and back: tiles of 8 x 8 pixels, front to back, with gradients.

The CPU's counterpart of the 3DGS rasterizer. The host sorts splats into tiles; the
device walks down many tiles' lists at once, one splat of each per step, until the
lists end or nothing shines through. The backward pass walks the same lists again,
so nothing is kept in between. Pictures are sRGB over black.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from internal.export.splats import (
    CUTOFF,
    FAINTEST,
    OPAQUEST,
    Footprints,
    Pinhole,
    Splats,
    project_splats,
)

TILE = 8  # pixels
TILES_PER_WALK = 512
PAIRS_STEP = 1 << 18  # lists are padded to multiples, so that few shapes are compiled
NOTHING_SHINES_THROUGH = 1e-3  # transmittance where a walk may end

PIXELS = TILE * TILE
PIXELS_OF_WALK = (TILES_PER_WALK, PIXELS)
# Centres of a tile's pixels from its corner, [1, pixels], and their products.
PIXEL_X = (np.arange(PIXELS) % TILE + 0.5).astype(np.float32)[None]
PIXEL_Y = (np.arange(PIXELS) // TILE + 0.5).astype(np.float32)[None]
MOMENTS = np.concatenate(
    [
        np.ones_like(PIXEL_X), PIXEL_X, PIXEL_Y,
        PIXEL_X**2, PIXEL_X * PIXEL_Y, PIXEL_Y**2,
    ]
).T  # fmt: skip


class Lists(NamedTuple):
    """Which splats a tile may show, nearest first; all tiles' lists lie end to end.

    Tiles come in the order of falling length, padded by empty ones to whole walks.
    """

    splats: Int[np.ndarray, " pairs"]
    starts: Int[np.ndarray, " tiles"]
    counts: Int[np.ndarray, " tiles"]
    corners: Int[np.ndarray, "tiles 2"]  # x, y of the first pixel


def list_splats(footprints: Footprints, width: int, height: int) -> Lists:
    """Sorts footprints into tiles, by depth."""
    means = np.asarray(footprints.means, np.float64)
    extents = np.asarray(footprints.extents, np.float64)
    tiles = np.array([-(-width // TILE), -(-height // TILE)])
    # A pixel's centre lies half a pixel inside.
    low = np.clip(np.floor((means - extents - 0.5) / TILE), 0, tiles).astype(np.int32)
    high = np.floor((means + extents - 0.5) / TILE) + 1
    sides = np.clip(high, 0, tiles).astype(np.int32) - low
    shown = np.flatnonzero((extents[:, 0] > 0.0) & (sides > 0).all(axis=-1))
    order = shown[np.argsort(np.asarray(footprints.depths)[shown], kind="stable")]
    low, sides = low[order], sides[order]
    repeats = sides[:, 0] * sides[:, 1]
    ends = np.cumsum(repeats)
    place = np.arange(ends[-1] if len(ends) else 0) - np.repeat(ends - repeats, repeats)
    across = np.repeat(sides[:, 0], repeats)
    column = np.repeat(low[:, 0], repeats) + place % across
    row = np.repeat(low[:, 1], repeats) + place // across
    tile = (row * tiles[0] + column).astype(np.uint32)
    by_tile = _stable_order(tile, int(tiles.prod()))
    counts = np.bincount(tile, minlength=tiles.prod())
    starts = np.cumsum(counts) - counts

    longest_first = np.argsort(-counts, kind="stable")
    missing = -len(longest_first) % TILES_PER_WALK
    corners = np.stack([longest_first % tiles[0], longest_first // tiles[0]], axis=-1)
    pairs = np.repeat(order, repeats)[by_tile]
    return Lists(
        np.pad(pairs, (0, -len(pairs) % PAIRS_STEP + 1)).astype(np.int32),
        np.pad(starts[longest_first], (0, missing)).astype(np.int32),
        np.pad(counts[longest_first], (0, missing)).astype(np.int32),
        np.pad(TILE * corners, ((0, missing), (0, 0))).astype(np.int32),
    )


def _stable_order(keys: np.ndarray, limit: int) -> np.ndarray:
    """Stable argsort of integers below a limit, by counting where 16 bits do."""
    small = keys.astype(np.uint16) if limit <= 1 << 16 else keys
    return np.argsort(small, kind="stable")


def rasterize(
    splats: Splats, camera: Pinhole
) -> tuple[Float[np.ndarray, "height width 3"], Float[np.ndarray, "height width"]]:
    """A picture in sRGB over black, and the share of the background that is left."""
    footprints = _project(splats, camera)
    width, height = camera.width, camera.height
    lists = list_splats(footprints, width, height)
    srgb, through = _walk_all(_pack(footprints), *lists)
    left = from_tiles(np.asarray(through)[:, None], lists, width, height)
    return from_tiles(np.asarray(srgb), lists, width, height), left[..., 0]


def gradient(
    splats: Splats,
    camera: Pinhole,
    slope: Callable[
        [Float[np.ndarray, "height width 3"]], Float[np.ndarray, "height width 3"]
    ],
) -> Splats:
    """The gradient of a loss of the picture to the splats.

    Args:
        slope: from the picture to the loss's gradient to it.
    """
    footprints = _project(splats, camera)
    width, height = camera.width, camera.height
    lists = list_splats(footprints, width, height)
    packed = _pack(footprints)
    srgb, _ = _walk_all(packed, *lists)
    by_picture = slope(from_tiles(np.asarray(srgb), lists, width, height))
    by_packed = _walk_all_back(packed, *lists, srgb, to_tiles(by_picture, lists))
    return _pull_back(splats, camera, by_packed)


def from_tiles(
    pixels: Float[np.ndarray, "tiles c tile_pixels"],
    lists: Lists,
    width: int,
    height: int,
) -> Float[np.ndarray, "height width c"]:
    """Puts tiles' pixels into their places."""
    columns, rows = -(-width // TILE), -(-height // TILE)
    channels = pixels.shape[1]
    grid = np.zeros((rows, columns, channels, TILE, TILE), np.float32)
    column, row = lists.corners[: rows * columns].T // TILE
    grid[row, column] = pixels[: rows * columns].reshape(-1, channels, TILE, TILE)
    whole = grid.transpose(0, 3, 1, 4, 2).reshape(rows * TILE, columns * TILE, channels)
    return whole[:height, :width]


def to_tiles(
    picture: Float[np.ndarray, "height width c"], lists: Lists
) -> Float[np.ndarray, "tiles c tile_pixels"]:
    """The inverse of ``from_tiles``; what lies outside the picture is 0."""
    height, width, channels = picture.shape
    padded = np.pad(picture, ((0, -height % TILE), (0, -width % TILE), (0, 0)))
    rows, columns = padded.shape[0] // TILE, padded.shape[1] // TILE
    grid = padded.reshape(rows, TILE, columns, TILE, channels).transpose(0, 2, 4, 1, 3)
    column, row = lists.corners.T // TILE
    pixels = grid[row, column].reshape(len(row), channels, PIXELS)
    pixels[rows * columns :] = 0.0
    return pixels


_project = jax.jit(project_splats)


@jax.jit
def _pack(footprints: Footprints) -> Float[Array, "n 9"]:
    """mean x y, conic xx xy yy, opacity, colour."""
    columns = [footprints.means, footprints.conics, footprints.opacities[:, None]]
    return jnp.concatenate([*columns, footprints.srgb], axis=-1)


@jax.jit
def _pull_back(
    splats: Splats, camera: Pinhole, by_packed: Float[Array, "n 9"]
) -> Splats:
    _, back = jax.vjp(lambda some: _pack(project_splats(some, camera)), splats)
    return back(by_packed)[0]


def _alphas(
    row: Float[Array, "tiles 9"], corners: Float[Array, "tiles 2"], alive: Array
) -> Float[Array, "tiles tile_pixels"]:
    """Alpha of a splat in each pixel of its tile."""
    dx = PIXEL_X - (row[:, 0:1] - corners[:, 0:1])
    dy = PIXEL_Y - (row[:, 1:2] - corners[:, 1:2])
    squared = (
        row[:, 2:3] * dx * dx + 2.0 * row[:, 3:4] * dx * dy + row[:, 4:5] * dy * dy
    )
    alpha = row[:, 5:6] * jnp.exp(-0.5 * squared)
    drawn = (squared <= CUTOFF) & (alpha >= FAINTEST) & alive[:, None]
    return jnp.where(drawn, jnp.minimum(alpha, OPAQUEST), 0.0)


def _goes_on(step: Array, through: Array, counts: Array) -> Array:
    """Whether any tile has splats left and a pixel that would show them."""
    open_tiles = (through > NOTHING_SHINES_THROUGH).any(axis=-1)
    return (open_tiles & (counts > step)).any()


@jax.jit
def _walk_all(packed, splats, starts, counts, corners):
    def walk_some(some):
        starts, counts, corners = some

        def advance(state):
            step, srgb, through = state
            row = packed[splats[starts + step]]
            alpha = _alphas(row, corners, step < counts)
            srgb = srgb + row[:, 6:, None] * (alpha * through)[:, None]
            return step + 1, srgb, through * (1.0 - alpha)

        state = (
            jnp.int32(0),
            jnp.zeros((TILES_PER_WALK, 3, PIXELS)),
            jnp.ones(PIXELS_OF_WALK),
        )
        _, srgb, through = jax.lax.while_loop(
            lambda state: _goes_on(state[0], state[2], counts), advance, state
        )
        return srgb, through

    srgb, through = jax.lax.map(walk_some, _walks(starts, counts, corners))
    return srgb.reshape(-1, 3, PIXELS), through.reshape(-1, PIXELS)


@jax.jit
def _walk_all_back(packed, splats, starts, counts, corners, srgb, gradient):
    def walk_some(total, some):
        (starts, counts, corners), srgb, gradient = some
        # How the loss would change by what is still to come at each pixel.
        to_come = jnp.sum(srgb * gradient, axis=1)

        def advance(state):
            step, to_come, through, total = state
            index = splats[starts + step]
            row = packed[index]
            alpha = _alphas(row, corners, step < counts)
            weight = alpha * through
            own = jnp.sum(row[:, 6:, None] * gradient, axis=1)
            to_come = to_come - weight * own
            by_alpha = through * own - to_come / (1.0 - alpha)
            by_log = jnp.where(alpha < OPAQUEST, by_alpha * alpha, 0.0)
            by_color = jnp.einsum("tp,tcp->tc", weight, gradient)
            by_row = _by_ellipse(by_log @ MOMENTS, row, corners)
            total = total.at[index].add(jnp.concatenate([by_row, by_color], axis=-1))
            return step + 1, to_come, through * (1.0 - alpha), total

        state = jnp.int32(0), to_come, jnp.ones(PIXELS_OF_WALK), total
        *_, total = jax.lax.while_loop(
            lambda state: _goes_on(state[0], state[2], counts), advance, state
        )
        return total, None

    walks = _walks(starts, counts, corners)
    parts = [x.reshape(-1, TILES_PER_WALK, 3, PIXELS) for x in (srgb, gradient)]
    return jax.lax.scan(walk_some, jnp.zeros_like(packed), (walks, *parts))[0]


def _by_ellipse(
    moments: Float[Array, "tiles 6"],
    row: Float[Array, "tiles 9"],
    corners: Float[Array, "tiles 2"],
) -> Float[Array, "tiles 6"]:
    """The gradient to mean, conic and opacity, from moments about the tile's corner
    of the gradient to the logarithm of alpha."""
    total, x, y, xx, xy, yy = jnp.moveaxis(moments, -1, 0)
    mean_x, mean_y = row[:, 0] - corners[:, 0], row[:, 1] - corners[:, 1]
    dx, dy = x - mean_x * total, y - mean_y * total
    dxx = xx - mean_x * (x + dx)
    dyy = yy - mean_y * (y + dy)
    dxy = xy - mean_x * y - mean_y * dx
    a, b, c = row[:, 2], row[:, 3], row[:, 4]
    opacity = jnp.maximum(row[:, 5], FAINTEST)
    columns = [
        a * dx + b * dy, b * dx + c * dy, -0.5 * dxx, -dxy, -0.5 * dyy, total / opacity,
    ]  # fmt: skip
    return jnp.stack(columns, axis=-1)


def _walks(starts, counts, corners):
    return (
        starts.reshape(-1, TILES_PER_WALK),
        counts.reshape(-1, TILES_PER_WALK),
        corners.reshape(-1, TILES_PER_WALK, 2).astype(jnp.float32),
    )
