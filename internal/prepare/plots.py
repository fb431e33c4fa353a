# SPDX-License-Identifier: Apache-2.0
"""Plots of the report, through matplotlib (the only module that imports it)."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from internal import atomic

BACKGROUND, INK, ACCENT, FAINT = "#161616", "#e8e8e8", "#ffb347", "#8ab8ff"
SHOWN_POINTS = 4000
SHOWN_SPREAD = 2.5  # half-width of a plot, in spreads of cameras and points
DPI = 110


def plot_layout(
    camtoworlds: Float[np.ndarray, "n 3 4"],
    points: Float[np.ndarray, "m 3"],
    path: Path,
) -> None:
    """Cameras and sparse points from above and from the side; z is up."""
    figure = _figure(11.0, 5.0)
    shown = points[:: max(1, len(points) // SHOWN_POINTS)]
    for place, (title, across, up) in enumerate(
        (("from above", 0, 1), ("from the side", 1, 2)), start=1
    ):
        axes = _axes(figure, place, title)
        axes.scatter(shown[:, across], shown[:, up], s=2.0, c=FAINT, linewidths=0)
        centres = camtoworlds[:, :, 3]
        forward = -camtoworlds[:, :, 2]
        axes.quiver(
            *(centres[:, across], centres[:, up], forward[:, across], forward[:, up]),
            color=ACCENT, scale=16.0, width=0.003,
        )  # fmt: skip
        axes.scatter(centres[:, across], centres[:, up], s=14.0, c=ACCENT)
        axes.set_xlabel("xyz"[across])
        axes.set_ylabel("xyz"[up])
        axes.set_aspect("equal")
        _limit(axes, np.concatenate([shown, centres])[:, [across, up]])
    _save(figure, path)


def plot_histogram(counts: Int[np.ndarray, " levels"], path: Path) -> None:
    """Share of pixels at each 8-bit level, up to the last that matters."""
    figure = _figure(8.0, 3.6)
    axes = _axes(figure, 0, "brightness of all photos")
    shares = counts / max(1, counts.sum())
    last = int(np.searchsorted(np.cumsum(shares), 0.999)) + 2
    axes.bar(np.arange(last), 100.0 * shares[:last], width=1.0, color=ACCENT)
    axes.set_xlabel(f"level of 255 (0.1 % of pixels are brighter than {last - 2})")
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


def _limit(axes: Axes, shown: Float[np.ndarray, "k 2"]) -> None:
    """Leaves far outliers out of view."""
    middle = np.median(shown, axis=0)
    spread = np.percentile(np.abs(shown - middle), 90.0, axis=0).max()
    half = SHOWN_SPREAD / 2.0 * max(float(spread), 1e-6)
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half, middle[1] + half)


def _save(figure: Figure, path: Path) -> None:
    with atomic.writing(path) as partial:
        figure.savefig(partial)
