# SPDX-License-Identifier: Apache-2.0
"""How much more light one photo took than another, from points that both see: as
phones do that expose each photo by itself.

A photo's gain g is per channel and in linear light: photo = g * scene. With the light
s of point p, log photo[v, p] = log g[v] + log s[p]; both are found by least squares in
which outliers (shine, wrong matches) count little. Gains have geometric mean 1.
"""

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse

from internal import color, progress
from internal.files import atomic
from internal.scene import colmap, colmap_files
from internal.scene.pairing import match_by_name

WINDOW = 5  # pixels whose light is averaged about a point
# Beyond these 8-bit levels, clipping and rounding say more than light.
LEVELS = (2.0, 250.0)
FEWEST_SIGHTINGS = 20  # per view: with fewer its gain stays 1
# Cameras step by thirds of a stop. Less than half a step is shading, not exposure.
EQUAL_STOPS = 1 / 6
ROUNDS = 8  # of reweighting
OUTLIER = 0.1  # natural log: differences beyond it lose weight
# Median of what gains leave unexplained, natural log: 0.05 on phone photos. With more,
# what is said to be one point is not.
UNTRUSTED = 0.25
RIDGE = 1e-6  # sightings: views that share no points are each brought to a mean of 0
DECIMALS = 4  # of measured gains: libraries differ in the last digits


@dataclasses.dataclass(frozen=True)
class Exposures:
    """Gains of all views; exactly 1 where the photos are equally exposed."""

    gains: Float[np.ndarray, "views 3"]
    measured_stops: Float[np.ndarray, " views"]  # log2, mean of channels, as measured

    @property
    def equal(self) -> bool:
        """Whether all photos have one exposure."""
        return bool((self.gains == 1.0).all())


@dataclasses.dataclass(frozen=True)
class Sighted:
    """The points that one view sees."""

    points: Int[np.ndarray, " k"]  # numbers
    places: Float[np.ndarray, "k 2"]  # (x, y) in shares of width and height


def find_sighted(data_dir: Path, names: Sequence[str]) -> dict[int, Sighted]:
    """What views of these names see of points, by view, as the scene's COLMAP model
    says; nothing without one. Places are those of stored pixels.

    Raises:
        UserError: the model is broken.
    """
    folder = colmap.find_model(data_dir)
    if folder is None:
        return {}
    cameras, stored_images = colmap_files.read_views(folder)
    images = {image.name: image for image in stored_images}
    found: dict[int, Sighted] = {}
    for name, stored in match_by_name(names, tuple(images)).items():
        image = images[stored]
        lens = cameras[image.camera]
        places = image.pixels / (lens.width, lens.height)
        inside = ((places >= 0.0) & (places < 1.0)).all(axis=-1)
        if inside.any():
            found[names.index(name)] = Sighted(image.points[inside], places[inside])
    return found


def measure_gains(
    sighted: Mapping[int, Sighted],
    read: Callable[[int], Float[np.ndarray, "_height _width 3"]],
    count: int,
) -> Exposures:
    """Gains of ``count`` views from the points that they see, rounded; 1 where these do
    not agree with each other. Shows progress.

    Args:
        read: the picture of a view, sRGB, in which its places are.
    """
    if not sighted:
        return Exposures(np.ones((count, 3)), np.zeros(count))
    lights = []
    for view in progress.track(sighted, len(sighted), "comparing light", "photo"):
        srgb = read(view)
        lights.append(sample_light(srgb, sighted[view].places * srgb.shape[1::-1]))
    views = np.repeat([*sighted], [len(seen.points) for seen in sighted.values()])
    points = np.concatenate([seen.points for seen in sighted.values()])
    _, points = np.unique(points, return_inverse=True)
    light = np.concatenate(lights)
    found = estimate(views, points, light, count)
    if _unexplained(views, points, light, found.gains) > UNTRUSTED:
        return Exposures(np.ones((count, 3)), found.measured_stops)
    return dataclasses.replace(found, gains=np.round(found.gains, DECIMALS))


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


def _unexplained(
    views: Int[np.ndarray, " k"],
    points: Int[np.ndarray, " k"],
    log_light: Float[np.ndarray, "k 3"],
    gains: Float[np.ndarray, "views 3"],
) -> float:
    """Median difference of what views say of a point's light, natural log."""
    told = np.asarray(np.isfinite(log_light).all(axis=-1))
    told &= _seen_twice(points, told)
    if not told.any():
        return 0.0
    points = points[told]
    scene = (log_light - np.log(gains)[views])[told].mean(axis=-1)
    means = np.bincount(points, scene) / np.maximum(np.bincount(points), 1)
    return float(np.median(np.abs(scene - means[points])))


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
    """Log gains of one channel by reweighted least squares (Huber).

    The points' light is eliminated: what is solved is as small as there are views.
    """
    _, numbers = np.unique(points, return_inverse=True)
    shape = (count, int(numbers.max()) + 1)
    weights, log_gains = np.ones(len(views)), np.zeros(count)
    for _ in range(ROUNDS):
        sums = sparse.csr_matrix((weights, (views, numbers)), shape)
        heard = sparse.csr_matrix((weights * log_light, (views, numbers)), shape)
        of_points = np.asarray(sums.sum(axis=0)).ravel()
        shares = sums.multiply(1.0 / of_points).tocsr()
        normal = np.diag(np.asarray(sums.sum(axis=1)).ravel())
        normal = normal - (shares @ sums.T).toarray() + RIDGE * np.eye(count)
        light_heard = np.asarray(heard.sum(axis=0)).ravel()
        right = np.asarray(heard.sum(axis=1)).ravel() - shares @ light_heard
        log_gains = np.linalg.solve(normal, right)
        scene = (light_heard - sums.T @ log_gains) / of_points
        residuals = np.abs(log_light - log_gains[views] - scene[numbers])
        weights = OUTLIER / np.maximum(residuals, OUTLIER)
    return log_gains
