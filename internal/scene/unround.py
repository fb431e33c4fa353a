# SPDX-License-Identifier: Apache-2.0
"""Colours of dark 8-bit photos without the steps that rounding cut into them.

A photo stores luma and two colour differences (a JPEG) or three channels (a PNG) in
whole levels. Of a signal of four levels half a level is an eighth, the same in photo
after photo where nothing dithers it (the noise is gone from a JPEG), and no average
over photos takes it away. But light scales all channels alike: over a surface of one
colour the differences are its hue times luma, and where luma varies the steps tell the
hue. ``unround`` asks neighbours that may have the same hue for it and moves the
differences of each pixel towards hue times luma, no channel by more than the half level
that rounding hides: nothing that the photo states is changed, no hue is made up, and
black, which has none, turns gray.

Pictures are sRGB in [0, 1]; inside, 8-bit levels of Y, Cb and Cr (JFIF, Cb and Cr
around 0). Sizes are in pixels of the picture that is trained on.
"""

import itertools

import numpy as np
from jaxtyping import Float

from internal.squares import square_means

HALF_STEP = 0.5  # levels; what rounding hides
CELL = 4  # pixels; hues are compared by cells of as many squared
REACH = 8  # cells; neighbours count as a Gaussian of half of it
STRIDE = 4  # cells from neighbour to neighbour
TOLERANCE = 0.7  # of hues that may be one: 1 is as far as rounding explains
OTHER = 2.0  # levels; a pixel farther from its neighbours' hue is another surface
ROUNDS = 4  # of asking and moving
FAINT = 0.02  # levels squared: darker cells count as gray
LEAST_LUMA = 0.25  # levels
YCC_FROM_RGB = np.array(
    [[0.299, 0.587, 0.114], [-0.168736, -0.331264, 0.5], [0.5, -0.418688, -0.081312]],
    np.float32,
)
RGB_FROM_YCC = np.linalg.inv(YCC_FROM_RGB)


def is_rounded(srgb: Float[np.ndarray, "height width 3"]) -> bool:
    """Whether all values are whole 8-bit levels."""
    levels = 255.0 * srgb
    return bool(np.all(np.abs(levels - np.round(levels)) < 1e-3))


def unround(
    srgb: Float[np.ndarray, "height width 3"],
) -> Float[np.ndarray, "height width 3"]:
    """The picture with colours as likely as its neighbours make them.

    No channel moves by more than ``HALF_STEP``, so the result rounds to the picture;
    the area average of a rounded picture is within the same bounds.
    """
    levels = 255.0 * srgb
    luma, stored = _split(levels)
    shape = luma.shape[:2]
    weights = _kinship(_cells(luma), _cells(stored))
    power = _gather(_cells(luma**2), weights) + FAINT
    lowest, highest = np.maximum(levels - HALF_STEP, 0.0), levels + HALF_STEP
    differences, moved = stored, levels
    for _ in range(ROUNDS):
        hue = _gather(_cells(luma * differences), weights) / power
        change = _pixels(hue, *shape) * luma - stored
        unlike = np.sum((change / OTHER) ** 2, axis=-1, keepdims=True)
        moved = levels + (np.exp(-0.5 * unlike) * change) @ RGB_FROM_YCC[:, 1:].T
        moved = np.clip(moved, lowest, highest)
        differences = _split(moved)[1]
    return np.minimum(moved / 255.0, 1.0).astype(np.float32)


def _split(
    levels: Float[np.ndarray, "height width 3"],
) -> tuple[Float[np.ndarray, "height width 1"], Float[np.ndarray, "height width 2"]]:
    """Luma, kept above black, and colour differences."""
    ycc = levels @ YCC_FROM_RGB.T
    return np.maximum(ycc[..., :1], LEAST_LUMA), ycc[..., 1:]


def _kinship(
    luma: Float[np.ndarray, "rows columns 1"],
    stored: Float[np.ndarray, "rows columns 2"],
) -> dict[tuple[int, int], Float[np.ndarray, "rows columns 1"]]:
    """Weight of the neighbour so many rows and columns away, for each cell.

    It falls with distance, and with how far the neighbour's differences are from what
    this cell's would be in its light, in units of what rounding allows.
    """
    weights = {}
    others_luma, others_stored = _bordered(luma), _bordered(stored)
    steps = range(-REACH, REACH + 1, STRIDE)
    for row, column in itertools.product(steps, steps):
        distance = (row**2 + column**2) / (REACH / 2.0) ** 2
        place = _shifted(row, column, luma.shape)
        light = others_luma[place] / luma
        allowed = TOLERANCE * HALF_STEP * (1.0 + light)
        apart = (others_stored[place] - light * stored) / allowed
        unlike = np.sum(apart**2, axis=-1, keepdims=True)
        weights[row, column] = np.exp(-0.5 * (distance + unlike))
    return weights


def _gather(
    values: Float[np.ndarray, "rows columns c"],
    weights: dict[tuple[int, int], Float[np.ndarray, "rows columns 1"]],
) -> Float[np.ndarray, "rows columns c"]:
    """The weighted mean of each cell's neighbourhood."""
    others = _bordered(values)
    total = np.zeros_like(values)
    for place, weight in weights.items():
        total += weight * others[_shifted(*place, values.shape)]
    return total / np.sum(list(weights.values()), axis=0)


def _bordered(
    values: Float[np.ndarray, "rows columns c"],
) -> Float[np.ndarray, "_rows _columns c"]:
    return np.pad(values, ((REACH, REACH), (REACH, REACH), (0, 0)), mode="edge")


def _shifted(row: int, column: int, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Where the neighbours of all cells lie in what ``_bordered`` made."""
    top, left = REACH + row, REACH + column
    return slice(top, top + shape[0]), slice(left, left + shape[1])


def _cells(
    values: Float[np.ndarray, "height width c"],
) -> Float[np.ndarray, "rows columns c"]:
    """Means of squares of ``CELL`` pixels; the last ones repeat the border."""
    height, width, _ = values.shape
    missing = (-height % CELL, -width % CELL)
    padded = np.pad(values, ((0, missing[0]), (0, missing[1]), (0, 0)), mode="edge")
    return square_means(padded, CELL)


def _pixels(
    cells: Float[np.ndarray, "rows columns c"], height: int, width: int
) -> Float[np.ndarray, "{height} {width} c"]:
    """Interpolates cells linearly at the centres of pixels."""
    for axis, size in enumerate((height, width)):
        place = (np.arange(size) + 0.5) / CELL - 0.5
        place = np.clip(place, 0.0, cells.shape[axis] - 1.0)
        lower = place.astype(int)
        upper = np.minimum(lower + 1, cells.shape[axis] - 1)
        part = (place - lower).astype(np.float32)
        part = part[:, None, None] if axis == 0 else part[None, :, None]
        cells = (1.0 - part) * cells.take(lower, axis) + part * cells.take(upper, axis)
    return cells
