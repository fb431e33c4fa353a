# SPDX-License-Identifier: Apache-2.0
"""The table of scores."""

from pathlib import Path

from internal.files import atomic
from internal.pages.pages import Table
from internal.pages.tables import as_markdown
from internal.scoring.evaluation import BASELINES, DEFINITIONS, Scores


def score_table(scores: Scores, heading: str) -> Table:
    """Scores as a table: a row per kind of picture, a column per metric."""
    names = [n for n in DEFINITIONS if any(n in row for row in scores.values())]
    text = (
        "dark is scored against the dark photo, all others against the normal-light "
        "truth. "
        + "; ".join(f"{name}: {BASELINES[name][1]}" for name in BASELINES)
        + "."
    )
    rows = tuple(
        (picture, *(f"{row[n]:.3f}" if n in row else "" for n in names))
        for picture, row in sorted(scores.items(), key=_enhanced_first)
    )
    headers = ("picture", *(DEFINITIONS[name] for name in names))
    return Table(heading, text, headers, rows)


def heading(views: int, with_truth: int) -> str:
    """What a table of mean scores says it is the mean of."""
    some = f"; {with_truth} of {views} have truth" if 0 < with_truth < views else ""
    return f"Scores, mean over test views{some}"


def read_table(metrics_json: Path) -> str:
    """The mean scores of a ``metrics.json`` in Markdown."""
    mean = atomic.read_json(metrics_json, "eval.py")["mean"]
    return as_markdown(score_table(mean, ""))


def _enhanced_first(item: tuple[str, dict[str, float]]) -> int:
    order = ("enhanced", *BASELINES, "dark")
    return order.index(item[0])
