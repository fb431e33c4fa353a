# SPDX-License-Identifier: Apache-2.0
"""Tables of numbers as text: Markdown, CSV and LaTeX; and the table of scores."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path

from internal.files import atomic
from internal.pages.pages import Table
from internal.scoring.evaluation import BASELINES, DEFINITIONS, Scores

# Of text mode, with what prints the character itself.
LATEX_SPECIALS = str.maketrans(
    {c: f"\\{c}" for c in "&%$#_{}"}
    | {"~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "\\": r"\textbackslash{}"}
)


def write_csv(path: Path, rows: Sequence[Sequence[str]]) -> None:
    """Writes rows, the headers being the first, whole or not at all.

    Raises:
        UserError: the folder cannot be written or the disk is full.
    """
    with atomic.writing(path) as partial, partial.open("w", newline="") as file:
        csv.writer(file).writerows(rows)


def as_latex(table: Table) -> str:
    """A ``table`` with a ``tabular`` for the package booktabs, its heading the caption.

    Text between ** and ** is bold; all other characters print as they are.
    """
    columns = "l" + "r" * (len(table.headers) - 1)
    return "\n".join(
        [
            r"\begin{table}",
            rf"\caption{{{_latex_text(table.heading)}}}",
            rf"\begin{{tabular}}{{{columns}}}",
            r"\toprule",
            _latex_row(table.headers),
            r"\midrule",
            *map(_latex_row, table.rows),
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table}",
        ]
    )


def _latex_row(texts: Sequence[str]) -> str:
    return " & ".join(map(_latex_text, texts)) + r" \\"


def _latex_text(text: str) -> str:
    bold = len(text) > 4 and text.startswith("**") and text.endswith("**")
    escaped = (text[2:-2] if bold else text).translate(LATEX_SPECIALS)
    return rf"\textbf{{{escaped}}}" if bold else escaped


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


def read_table(metrics_json: Path) -> str:
    """The mean scores of a ``metrics.json`` in Markdown."""
    mean = json.loads(metrics_json.read_text())["mean"]
    return as_text(score_table(mean, ""))


def as_text(table: Table) -> str:
    """A table in Markdown."""
    lines = [table.headers, tuple("---" for _ in table.headers), *table.rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _enhanced_first(item: tuple[str, dict[str, float]]) -> int:
    order = ("enhanced", *BASELINES, "dark")
    return order.index(item[0])
