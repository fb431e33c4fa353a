# SPDX-License-Identifier: Apache-2.0
"""Tables of numbers as text: Markdown, CSV and LaTeX."""

import csv
from collections.abc import Sequence
from pathlib import Path

from internal.files import atomic
from internal.pages.pages import Table

# Of text mode, with what prints the character itself.
LATEX_SPECIALS = str.maketrans(
    {c: f"\\{c}" for c in "&%$#_{}"}
    | {"~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "\\": r"\textbackslash{}"}
)


def as_markdown(table: Table) -> str:
    """A table in Markdown."""
    lines = [table.headers, tuple("---" for _ in table.headers), *table.rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


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
