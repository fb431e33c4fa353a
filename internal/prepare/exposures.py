# SPDX-License-Identifier: Apache-2.0
"""How much more light one photo took than another, from points that both see.

A photo's gain g is per channel and in linear light: photo = g * scene. With the light
s of point p, log photo[v, p] = log g[v] + log s[p]; both are found by least squares in
which outliers (shine, wrong matches) count little. Gains have geometric mean 1.
"""

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse

from internal import color
from internal.files import atomic

WINDOW = 5  # pixels whose light is averaged about a point
# Beyond these 8-bit levels, clipping and rounding say more than light.
LEVELS = (2.0, 250.0)
FEWEST_SIGHTINGS = 20  # per view: with fewer its gain stays 1
# Cameras step by thirds of a stop. Less than half a step is shading, not exposure.
EQUAL_STOPS = 1 / 6
ROUNDS = 8  # of reweighting
OUTLIER = 0.1  # natural log: differences beyond it lose weight


@dataclasses.dataclass(frozen=True)
class Exposures:
    """Gains of all views; exactly 1 where the photos are equally exposed."""

    gains: Float[np.ndarray, "views 3"]
    measured_stops: Float[np.ndarray, " views"]  # log2, mean of channels, as measured

    @property
    def equal(self) -> bool:
        """Whether all photos have one exposure."""
        return bool((self.gains == 1.0).all())


def sample_light(
    srgb: Float[np.ndarray, "height width 3"], pixels: Float[np.ndarray, "k 2"]
) -> Float[np.ndarray, "k 3"]:
    """Natural log of the linear light around pixel coordinates (x, y).

    NaN where the photo is too dark or too bright to tell.
    """
    height, width = srgb.shape[:2]
    x, y = np.floor(pixels).astype(np.int64).T[..., None, None]
    across = np.arange(WINDOW) - WINDOW // 2
    rows = (y + across[:, None]).clip(0, height - 1)
    columns = (x + across).clip(0, width - 1)
    windows = color.photo_to_linear(srgb[rows, columns])
    found = windows.mean(axis=(1, 2))
    low, high = np.asarray(color.srgb_to_linear(np.array(LEVELS) / 255.0))
    told = (found > low) & (found < high)
    return np.log(np.where(told, found, np.nan))


def estimate(
    views: Int[np.ndarray, " k"],
    points: Int[np.ndarray, " k"],
    log_light: Float[np.ndarray, "k 3"],
    count: int,
) -> Exposures:
    """Gains of ``count`` views from sightings of points.

    Args:
        views: view of each sighting.
        points: point of each sighting, numbered from 0.
        log_light: natural log of its linear light; rows with NaN are left out.
    """
    told = np.asarray(np.isfinite(log_light).all(axis=-1))
    told = told & _seen_twice(points, told)
    sightings = np.bincount(views[told], minlength=count)
    log_gains = np.zeros((count, 3))
    if told.any():
        for channel in range(3):
            log_gains[:, channel] = _solve(
                views[told], points[told], log_light[told, channel], count
            )
    known = sightings >= FEWEST_SIGHTINGS
    if known.any():
        log_gains -= log_gains[known].mean(axis=0)
    log_gains[~known] = 0.0
    stops = log_gains / np.log(2.0)
    if np.abs(stops).max() < EQUAL_STOPS:
        log_gains[:] = 0.0
    return Exposures(np.exp(log_gains), stops.mean(axis=-1))


def write(exposures: Exposures, names: Sequence[str], path: Path) -> None:
    """Writes the gains by picture name, with what they mean.

    Raises:
        UserError: the folder cannot be written or the disk is full.
    """
    rounded = np.round(exposures.gains, 6).tolist()
    content = {
        "meaning": "linear light of the photo (r, g, b) = gain * light of the scene; "
        "geometric mean 1; all exactly 1 if the photos are equally exposed",
        "gains": dict(zip(names, rounded, strict=True)),
    }
    atomic.write_text(path, json.dumps(content, indent=2) + "\n")


def _seen_twice(
    points: Int[np.ndarray, " k"], told: Bool[np.ndarray, " k"]
) -> Bool[np.ndarray, " k"]:
    """Sightings of points that more than one view tells something about."""
    counts = np.bincount(points[told], minlength=int(points.max(initial=0)) + 1)
    return counts[points] >= 2


def _solve(
    views: Int[np.ndarray, " k"],
    points: Int[np.ndarray, " k"],
    log_light: Float[np.ndarray, " k"],
    count: int,
) -> Float[np.ndarray, " {count}"]:
    """Log gains of one channel by reweighted least squares (Huber)."""
    rows = np.arange(len(views))
    _, numbers = np.unique(points, return_inverse=True)
    shape = (len(views), count + int(numbers.max()) + 1)
    columns = np.concatenate([views, count + numbers])
    ones = np.ones(2 * len(rows))
    design = sparse.csr_matrix((ones, (np.tile(rows, 2), columns)), shape)
    weights = np.ones(len(rows))
    solution = np.zeros(shape[1])
    for _ in range(ROUNDS):
        scaled = sparse.diags(weights) @ design
        solution = sparse.linalg.lsmr(scaled, weights * log_light, x0=solution)[0]
        residuals = np.abs(log_light - design @ solution)
        weights = np.sqrt(OUTLIER / np.maximum(residuals, OUTLIER))
    return solution[:count]
