# SPDX-License-Identifier: Apache-2.0
"""Charts for pages, through Matplotlib.

Charts are SVG texts without a fixed background: their ink is legible on black and on
white. The same numbers give the same text.
"""

import io
import itertools
from collections.abc import Mapping, Sequence

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from internal.study.answers import Preference

INK = "#8a8a8a"
COLORS = ("#3d8bd4", "#9a9a9a", "#d9822b")  # A, undecided, B
LINE_COLORS = (COLORS[0], COLORS[2], "#4caf6e", "#b565c9", "#d9534f", "#8a7a5c")
COLUMNS = 3

Curve = Sequence[tuple[int, int | float]]  # (step, value)


def curves(series: Mapping[str, Mapping[str, Curve]]) -> str:
    """Small charts side by side, by title, over training steps; a line per label,
    whose colour is the same in every chart. The label "" is not explained."""
    labels = list(dict.fromkeys(label for lines in series.values() for label in lines))
    colors = dict(zip(labels, itertools.cycle(LINE_COLORS), strict=False))
    rows = -(-len(series) // COLUMNS)
    figure = _figure(3.6 * COLUMNS, 2.1 * rows + 0.25 * len(labels))
    for index, (name, lines) in enumerate(series.items()):
        axes = figure.add_subplot(rows, COLUMNS, index + 1)
        for label, curve in lines.items():
            axes.plot(*zip(*curve, strict=True), color=colors[label], linewidth=1.5)
        axes.set_title(name, fontsize=10, color=INK)
        axes.tick_params(labelsize=8)
        _recolor(axes)
    if any(labels):
        handles = [Line2D([], [], color=colors[label]) for label in labels]
        figure.legend(
            handles, labels, loc="outside upper left", ncols=2, frameon=False,
            labelcolor=INK,
        )  # fmt: skip
    return _svg(figure)


def preference_chart(ours: str, results: Sequence[Preference]) -> str:
    """The bar chart of a user study (LLNeRF Fig. 9): per rival, the shares of "A is
    better", undecided and "B is better", with the interval of the first."""
    figure = _figure(8.0, 1.2 + 0.55 * len(results))
    axes = figure.add_subplot()
    for row, result in enumerate(results):
        left = 0.0
        shares = (result.a_better, result.undecided, result.b_better)
        for share, color in zip(shares, COLORS, strict=True):
            axes.barh(row, 100.0 * share, left=100.0 * left, color=color, height=0.6)
            if share >= 0.06:
                middle = 100.0 * (left + share / 2.0)
                label = f"{100.0 * share:.0f} %"
                axes.text(middle, row, label, ha="center", va="center", color="white")
            left += share
        low, high = result.interval
        axes.plot([100.0 * low, 100.0 * high], [row - 0.38] * 2, color=INK, linewidth=2)
    axes.set_yticks(range(len(results)), [result.rival for result in results])
    axes.invert_yaxis()
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("share of answers, %; grey lines: 95 % interval of the blue share")
    labels = (f"{ours} is better", "cannot decide", "the other is better")
    handles = [axes.barh([0], [0], color=color) for color in COLORS]
    axes.legend(
        handles, labels, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3,
        frameon=False, labelcolor=INK,
    )  # fmt: skip
    _recolor(axes)
    return _svg(figure)


def _figure(width: float, height: float) -> Figure:
    """A figure of that size in inches, apart from Matplotlib's global state."""
    return Figure(figsize=(width, height), layout="constrained")


def _recolor(axes: Axes) -> None:
    axes.set_facecolor("none")
    axes.tick_params(colors=INK)
    axes.xaxis.label.set_color(INK)
    for side, spine in axes.spines.items():
        spine.set_color(INK)
        spine.set_visible(side in ("left", "bottom"))


def _svg(figure: Figure) -> str:
    """The figure's svg element, without the XML head that HTML cannot hold."""
    text = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "llnerf"}):
        figure.savefig(text, format="svg", transparent=True, metadata={"Date": None})
    svg = text.getvalue()
    return svg[svg.index("<svg") :]
