# SPDX-License-Identifier: Apache-2.0
"""Which frames of a video make photos: sharp ones, each a step on from the last.

How far a picture moved is measured between small copies, tile by tile, so that a walk
forwards and a turn about a thing in the middle count as motion too. Motions are shares
of the picture's width and height. Copies are ``[HEIGHT, WIDTH]`` uint8, brightened,
whatever the video's proportions.
"""

import dataclasses
import functools
import itertools
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float, UInt8
from scipy import ndimage

WIDTH, HEIGHT = 128, 96  # pixels of a small copy
TILE, STRIDE = 64, 16  # pixels
BAND = 0.08  # cycles per pixel that shifts are read from; finer ones are noise
# Height of a tile's peak, 1 for a pure shift, from which it is believed. Of random
# textures, shifts by a tenth have 0.6 and more under as much noise, and what has
# nothing in common has 0.35.
CLEAR = 0.5
FEWEST_CLEAR = 0.25  # of the tiles; else the pictures do not overlap
# A frame may follow a chosen one from the first of these motions on; the sharpest one
# does before the second.
NEAREST, FARTHEST = 0.04, 0.08
BLURRED = 0.5  # of the sharpness of the best of NEARBY frames; those are left out
NEARBY = 15  # frames, of both sides
ENOUGH = 24  # frames; where there are fewer, steps are halved
HALVINGS = 2

Copy = UInt8[np.ndarray, "96 128"]


@dataclasses.dataclass(frozen=True)
class ChosenFrames:
    """What was chosen of a video and why not the rest."""

    chosen: tuple[int, ...]  # numbers of frames
    blurred: int  # frames left out for that
    alike: int  # frames left out because a sharper one shows nearly the same
    step: float  # median motion between neighbours among the chosen ones

    def describe(self) -> str:
        """One line for people."""
        frames = len(self.chosen) + self.blurred + self.alike
        step = "farther than can be followed"
        if math.isfinite(self.step):
            step = f"by {self.step:.0%} of the picture"
        return (
            f"{frames} frames, {len(self.chosen)} chosen, each moved on "
            f"{step}; left out: {self.blurred} blurred, "
            f"{self.alike} that show nearly the same as a sharper one"
        )


def choose(copies: Sequence[Copy], sharpness: Sequence[float]) -> ChosenFrames:
    """Goes through a video in steps of motion; takes the sharpest frame of each."""
    sharp = np.asarray(sharpness)
    best = ndimage.maximum_filter1d(sharp, NEARBY)
    clear = np.flatnonzero(sharp >= BLURRED * best).tolist()
    taken = [copies[number] for number in clear]
    chosen = _walk(taken, sharp[clear], 1.0)
    for halving in range(1, HALVINGS + 1):
        if len(chosen) < ENOUGH:
            chosen = _walk(taken, sharp[clear], 0.5**halving)
    moved = [motion(taken[a], taken[b]) for a, b in itertools.pairwise(chosen)]
    return ChosenFrames(
        tuple(clear[i] for i in chosen),
        len(copies) - len(clear),
        len(clear) - len(chosen),
        float(np.median(moved)) if moved else 0.0,
    )


def _walk(
    copies: Sequence[Copy], sharpness: Float[np.ndarray, " n"], scale: float
) -> list[int]:
    """The sharpest copy of each step."""
    chosen: list[int] = []
    first = 0
    nearest, farthest = scale * NEAREST, scale * FARTHEST
    while first < len(copies):
        end = _reach(copies, chosen[-1], first, farthest) if chosen else first
        if end == first:  # the start, or a motion too fast to follow
            end = _reach(copies, first, first + 1, nearest)
        best = first + int(np.argmax(sharpness[first:end]))
        chosen.append(best)
        first = _reach(copies, best, max(best + 1, end), nearest)
    return chosen


def _reach(copies: Sequence[Copy], key: int, start: int, limit: float) -> int:
    """The first frame from ``start`` on that moved so far from ``key``, or the end."""
    frames = range(start, len(copies))
    return next(
        (i for i in frames if motion(copies[key], copies[i]) >= limit), len(copies)
    )


def motion(one: Copy, other: Copy) -> float:
    """How far tiles moved from one picture to another, the median; infinite where the
    pictures have nothing in common."""
    cross = _spectra(one) * _spectra(other).conj()
    # Half-way between correlation and phase correlation, whose peaks noise drowns.
    cross = _band() * cross / np.maximum(np.abs(cross), 1e-9) ** 0.5
    total = np.abs(cross).sum(axis=(1, 2))
    peaks = np.fft.ifft2(cross).real.reshape(len(cross), -1) * TILE**2
    clear = peaks.max(axis=1) > CLEAR * total
    if clear.mean() < FEWEST_CLEAR:
        return float("inf")
    place = np.stack(np.unravel_index(peaks.argmax(axis=1), (TILE, TILE)), axis=-1)
    shifts = (place + TILE // 2) % TILE - TILE // 2
    return float(np.median(np.hypot(*(shifts[clear] / [HEIGHT, WIDTH]).T)))


def _spectra(copy: Copy) -> Complex[np.ndarray, "tiles side side"]:
    windows = np.lib.stride_tricks.sliding_window_view(copy, (TILE, TILE))
    tiles = windows[::STRIDE, ::STRIDE].reshape(-1, TILE, TILE).astype(np.float32)
    tiles = tiles - tiles.mean(axis=(1, 2), keepdims=True)
    return np.fft.fft2(tiles * np.outer(np.hanning(TILE), np.hanning(TILE)))


@functools.cache
def _band() -> Float[np.ndarray, "side side"]:
    """Weights of frequencies; the mean is left out."""
    frequency = np.fft.fftfreq(TILE)
    weights = np.exp(-0.5 * np.hypot(frequency[:, None], frequency) ** 2 / BAND**2)
    weights[0, 0] = 0.0
    return weights
