# SPDX-License-Identifier: Apache-2.0
"""How sharp photos are against those that show the same: who moved or was out of focus.

Two photos are compared at their matches, where they show the same texture, in the
copies that features were found in, which are brightened and smoothed. A structure
tensor says how much the light changes in each direction; motion takes the changes along
it and leaves those across. A photo's sharpness against another is what is left in its
worst direction, 1 for equal ones; its sharpness is the median over the photos that it
overlaps.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float
from scipy import ndimage

GRADIENT = 1.0  # pixels of a copy, standard deviations: of the derivative
SURROUNDINGS = 6.0  # and of the window about a match
FEWEST_MATCHES = 25  # of a pair that is compared: chance alone reaches 15
# Of the others' sharpness. Steady photos of a can on a table, at 1/10 and 1/33 of their
# light, had 0.74 and more; moved by 1.5 % of the picture's height they had 0.66, by 2 %
# 0.47.
BLURRED = 0.7
HARMFUL = 0.6
FEWEST_SHARP = 3  # that show what a photo shows, before it is left out
MOST_LEFT_OUT = 0.5  # of all photos

Tensors = Float[np.ndarray, "height width 2 2"]
PixelPairs = Mapping[tuple[int, int], Float[np.ndarray, "_matches 2 2"]]


def against_overlapping(
    read_copy: Callable[[int], Float[np.ndarray, "_height _width"]],
    count: int,
    pixels: PixelPairs,
) -> Float[np.ndarray, " {count}"]:
    """The sharpness of each photo, 1 for one like the others; NaN where nothing says.

    Args:
        read_copy: the copy of a view.
        pixels: matches of pairs of views, as pixels of copies: [match, view, xy].
    """
    compared = {p: ends for p, ends in pixels.items() if len(ends) >= FEWEST_MATCHES}
    found: dict[tuple[int, int], Float[np.ndarray, "_matches 2 2"]] = {}
    for view in range(count):
        own = [pair for pair in compared if view in pair]
        if own:
            tensors = structure(read_copy(view))
            for pair in own:
                places = compared[pair][:, pair.index(view)]
                found[view, sum(pair) - view] = _at(tensors, places)
    ratios: list[list[float]] = [[] for _ in range(count)]
    for first, second in compared:
        own, other = found[first, second], found[second, first]
        ratios[first].append(worst_direction(own, other))
        ratios[second].append(worst_direction(other, own))
    return np.array([np.median(row) if row else np.nan for row in ratios])


def find_harmful(
    relative: Float[np.ndarray, " views"], pixels: PixelPairs, placed: Sequence[int]
) -> list[int]:
    """The placed views that a scene is better without, the most blurred first: each
    has sharp photos that show the same."""
    blurred = {view for view in placed if relative[view] < BLURRED}
    sharp = set(placed) - blurred
    overlaps = Counter(
        view
        for pair, ends in pixels.items()
        if len(ends) >= FEWEST_MATCHES
        for view, other in (pair, pair[::-1])
        if other in sharp
    )
    harmful = [
        view
        for view in sorted(blurred, key=lambda view: relative[view])
        if relative[view] < HARMFUL and overlaps[view] >= FEWEST_SHARP
    ]
    return harmful[: int(MOST_LEFT_OUT * len(placed))]


def structure(copy: Float[np.ndarray, "height width"]) -> Tensors:
    """The structure tensor about each pixel: of x, then y."""
    x, y = (
        ndimage.gaussian_filter1d(ndimage.gaussian_filter1d(copy, GRADIENT, across),
                                  GRADIENT, along, order=1)
        for along, across in ((1, 0), (0, 1))
    )  # fmt: skip
    xx, xy, yy = (
        ndimage.gaussian_filter(product, SURROUNDINGS)
        for product in (x * x, x * y, y * y)
    )
    return np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -1)


def worst_direction(
    own: Float[np.ndarray, "matches 2 2"], other: Float[np.ndarray, "matches 2 2"]
) -> float:
    """What is left of the other's gradients in the direction where least is: 1 if the
    two are equally sharp, 0 if one shows nothing. Every match counts alike."""
    weights = 1.0 / np.maximum(np.trace(own + other, axis1=1, axis2=2), 1e-12)
    mine, theirs = (np.einsum("m,mij->ij", weights, t) for t in (own, other))
    ridge = 1e-6 * np.trace(theirs) * np.eye(2)
    least = np.linalg.eigvals(np.linalg.solve(theirs + ridge, mine)).real.min()
    return float(np.sqrt(max(least, 0.0)))


def _at(
    tensors: Tensors, pixels: Float[np.ndarray, "k 2"]
) -> Float[np.ndarray, "k 2 2"]:
    limits = np.array(tensors.shape[1::-1]) - 1
    column, row = np.minimum(pixels.astype(int), limits).T
    return tensors[row, column]
