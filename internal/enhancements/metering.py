# SPDX-License-Identifier: Apache-2.0
"""Metering learned from normal photos: how bright a scene would have been taken.

The dark pixels of a scene's training photos go in, ``[n, 3]`` sRGB in [0, 1]; the
exposure of the scene-wide tone curve comes out, in stops of linear light. What is
learned is where photographers put the shape of a histogram, never its level: a first
exposure brings the mean of the developed largest channel to ``MIDDLE``, and a kernel
regression on the percentiles at that exposure says how many stops to add. Far from all
it has seen the addition goes to its mean, so that no scene is exposed wildly. Whose
photos it has seen still shows, so the result goes a third of the way to the exposure
that knows no shapes: the same mean, ``NORMAL``, for every scene.

The numbers are in ``metering.json``; ``python -m experiments.metering`` makes them.
"""

import dataclasses
import functools
import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from internal import srgb_curve
from internal.color import photo_to_linear

MIDDLE = 0.5  # sRGB mean of the developed largest channel at the first exposure
NORMAL = 0.66  # that mean where nothing else is known
NORMAL_SHARE = 1 / 3  # of the exposure that brings it about, in the result
PERCENTILES = (50.0, 75.0, 90.0, 95.0, 98.0, 99.5, 99.9)  # of the largest channel
FLOOR = 0.25 / 255 / srgb_curve.SLOPE  # a quarter of a level: the least told apart
MOST_STOPS = 16.0
BISECTIONS = 24
FITTED = Path(__file__).with_suffix(".json")

Pixels = Float[np.ndarray, "n 3"]


@dataclasses.dataclass(frozen=True)
class Prior:
    """A tone curve and a regression from shapes of histograms to stops.

    Shapes are standardised: (shape - center) / scale.
    """

    contrast: float
    shoulder: float
    offset: float  # stops to add to the first exposure, on average
    width: float  # of the Gaussian kernel, per feature
    center: Float[np.ndarray, " features"]
    scale: Float[np.ndarray, " features"]
    examples: Float[np.ndarray, "examples features"]  # standardised
    weights: Float[np.ndarray, " examples"]  # stops


@functools.cache
def load_prior(path: Path = FITTED) -> Prior:
    """The fitted numbers of a file."""
    return prior_of(json.loads(path.read_text()))


def prior_of(numbers: dict[str, Any]) -> Prior:
    """A ``Prior`` from its fields as JSON holds them."""
    fields = [field.name for field in dataclasses.fields(Prior)]
    values: dict[str, Any] = {name: numbers[name] for name in fields}
    for name in ("center", "scale", "examples", "weights"):
        values[name] = np.asarray(values[name])
    return Prior(**values)


def meter(dark_srgb: Pixels, prior: Prior) -> float:
    """Stops of linear light at which a normal photo of a scene would have been taken,
    from its dark pixels.

    Args:
        dark_srgb: sRGB in [0, 1], of all training photos or a sample of them.
        prior: of ``load_prior``.
    """
    curve = prior.contrast, prior.shoulder
    light, counts = largest_channel(photo_to_linear(dark_srgb))
    first, shape = first_exposure(light, counts, *curve)
    normal = exposure_to_mean(light, counts, NORMAL, *curve)
    stops = float(blended(first + correction(shape, prior), normal))
    return float(np.clip(stops, -MOST_STOPS, MOST_STOPS))


def blended(
    learned: float | np.floating | Float[np.ndarray, "*b"],
    normal: float | Float[np.ndarray, "*b"],
) -> float | np.floating | Float[np.ndarray, "*b"]:
    """Stops from what the regression says and what brings the mean to ``NORMAL``."""
    return learned + NORMAL_SHARE * (normal - learned)


def first_exposure(
    light: Float[np.ndarray, " levels"],
    counts: Int[np.ndarray, " levels"],
    contrast: float,
    shoulder: float,
) -> tuple[float, Float[np.ndarray, " features"]]:
    """Stops that bring the mean of the developed ``largest_channel`` to ``MIDDLE``, and
    the log2 of its percentiles at that exposure: the shape, whatever the level."""
    stops = exposure_to_mean(light, counts, MIDDLE, contrast, shoulder)
    percentiles = np.percentile(np.repeat(light, counts), PERCENTILES)
    return stops, np.log2(percentiles) + stops


def largest_channel(
    linear_rgb: Pixels,
) -> tuple[Float[np.ndarray, " levels"], Int[np.ndarray, " levels"]]:
    """The values of the largest channel, at least ``FLOOR``, and how often each comes:
    8-bit photos hold few."""
    largest = np.maximum(np.max(linear_rgb, axis=-1).astype(np.float64), FLOOR)
    return np.unique(largest, return_counts=True)


def exposure_to_mean(
    light: Float[np.ndarray, " levels"],
    counts: Int[np.ndarray, " levels"],
    mean: float,
    contrast: float,
    shoulder: float,
) -> float:
    """Stops at which linear light, each value ``counts`` times, develops to this sRGB
    mean; at most ``MOST_STOPS`` either way."""
    low, high = -MOST_STOPS, MOST_STOPS
    for _ in range(BISECTIONS):
        middle = (low + high) / 2.0
        lit = developed(light, middle, contrast, shoulder)
        too_dark = np.average(lit, weights=counts) < mean
        low, high = (middle, high) if too_dark else (low, middle)
    return high


def correction(
    shape: Float[np.ndarray, "*b features"], prior: Prior
) -> Float[np.ndarray, "*b"]:
    """Stops to add to the first exposure of histograms of these shapes, ``[*b]``."""
    standard = (shape - prior.center) / prior.scale
    near = kernel(standard, prior.examples, prior.width)
    return np.asarray(prior.offset + near @ prior.weights)


def kernel(
    a: Float[np.ndarray, "*b features"],
    b: Float[np.ndarray, "examples features"],
    width: float,
) -> Float[np.ndarray, "*b examples"]:
    """exp(-d^2 / (2 width^2)), d^2 the mean over features of squared differences."""
    distances = np.mean((a[..., None, :] - b) ** 2, axis=-1)
    return np.exp(-distances / (2.0 * width**2))


def developed(
    linear_rgb: Float[np.ndarray, "..."], stops: float, contrast: float, shoulder: float
) -> Float[np.ndarray, "..."]:
    """``tone.response`` of exposed light, sRGB-coded, in NumPy."""
    light = np.asarray(linear_rgb, np.float64) * 2.0**stops
    exposed = np.maximum(light, 1e-9) ** contrast
    light = exposed / (1.0 + exposed**shoulder) ** (1.0 / shoulder)
    return srgb_curve.encode(light, np)
