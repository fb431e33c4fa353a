# SPDX-License-Identifier: Apache-2.0
"""Plots of the report, through Matplotlib."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from internal.files import atomic

BACKGROUND, INK, ACCENT, FAINT = "#161616", "#e8e8e8", "#ffb347", "#8ab8ff"
SHOWN_POINTS = 4000
INNER = (3.0, 97.0)  # percentiles of the points that a plot makes room for
MARGIN = 1.15  # width of a plot over that of what it shows
ARROW = 0.15  # length of a camera's arrow over half the width
DPI = 110


def plot_layout(
    camtoworlds: Float[np.ndarray, "n 3 4"],
    points: Float[np.ndarray, "m 3"],
    path: Path,
) -> None:
    """Cameras and sparse points from two sides, in the axes of the scene."""
    figure = _figure(11.0, 5.0)
    shown = points[:: max(1, len(points) // SHOWN_POINTS)]
    for place, (title, across, up) in enumerate(
        (("along z", 0, 1), ("along x", 1, 2)), start=1
    ):
        axes = _axes(figure, place, title)
        axes.scatter(shown[:, across], shown[:, up], s=2.0, c=FAINT, linewidths=0)
        centres = camtoworlds[:, [across, up], 3]
        corners = np.concatenate([_inner(shown[:, [across, up]]), centres])
        low, high = corners.min(axis=0), corners.max(axis=0)
        middle, half = (low + high) / 2.0, MARGIN * float((high - low).max()) / 2.0
        forward = -camtoworlds[:, [across, up], 2] * ARROW * half
        axes.quiver(
            *centres.T, *forward.T,
            color=ACCENT, angles="xy", scale_units="xy", scale=1.0, width=0.003,
        )  # fmt: skip
        axes.scatter(*centres.T, s=14.0, c=ACCENT, linewidths=0)
        axes.set_xlabel("xyz"[across])
        axes.set_ylabel("xyz"[up])
        axes.set_aspect("equal")
        axes.set_xlim(middle[0] - half, middle[0] + half)
        axes.set_ylim(middle[1] - half, middle[1] + half)
    _save(figure, path)


def plot_histogram(counts: Int[np.ndarray, " levels"], path: Path) -> None:
    """Share of pixels at each 8-bit level, up to the last that matters."""
    figure = _figure(8.0, 3.6)
    axes = _axes(figure, 0, "brightness of all photos")
    shares = counts / max(1, counts.sum())
    bright = int(np.searchsorted(np.cumsum(shares), 0.999))
    last = min(bright + 2, len(shares))
    axes.bar(np.arange(last), 100.0 * shares[:last], width=1.0, color=ACCENT)
    axes.set_xlabel(f"level of 255 (0.1 % of pixels are brighter than {bright})")
    axes.set_ylabel("% of pixels")
    _save(figure, path)


def plot_exposures(stops: Float[np.ndarray, " n"], path: Path) -> None:
    """Exposure of each photo against the others."""
    figure = _figure(8.0, 3.6)
    axes = _axes(figure, 0, "exposure of each photo")
    axes.bar(np.arange(len(stops)), stops, color=FAINT)
    axes.axhline(0.0, color=INK, linewidth=0.8)
    largest = max(0.5, float(np.abs(stops).max(initial=0.0)) * 1.1)
    axes.set_ylim(-largest, largest)
    axes.set_xlabel("photo, in order of names")
    axes.set_ylabel("stops")
    _save(figure, path)


def _figure(width: float, height: float) -> Figure:
    return Figure(
        figsize=(width, height), dpi=DPI, facecolor=BACKGROUND, layout="constrained"
    )


def _axes(figure: Figure, place: int, title: str) -> Axes:
    """The only axes of a figure, or (from 1) the place-th of two side by side."""
    axes = figure.add_subplot(1, 2, place) if place else figure.add_subplot()
    axes.set_facecolor(BACKGROUND)
    axes.set_title(title, color=INK)
    axes.tick_params(colors=INK)
    axes.xaxis.label.set_color(INK)
    axes.yaxis.label.set_color(INK)
    for spine in axes.spines.values():
        spine.set_color("#3a3a3a")
    return axes


def _inner(points: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "2 2"]:
    """Corners of the box that leaves far outliers out."""
    return np.percentile(points, INNER, axis=0) if len(points) else np.zeros((2, 2))


def _save(figure: Figure, path: Path) -> None:
    with atomic.writing(path) as partial:
        figure.savefig(partial)
