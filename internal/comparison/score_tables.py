# SPDX-License-Identifier: Apache-2.0
"""The tables of a comparison in Markdown, CSV and LaTeX.

``results.json`` holds the same as the tables, with the folders of the pictures, for
figures.py.
"""

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from internal.comparison.jobs import Result, Results
from internal.files import atomic
from internal.pages.pages import Table
from internal.pages.tables import as_latex, as_markdown, write_csv
from internal.scoring.evaluation import LOWER_IS_BETTER

RESULTS = "results.json"
MEAN = "mean of all scenes"
MINUTES = "train_minutes"
HEADERS = {  # short: eight columns have to fit a paper's page
    "psnr": "PSNR",
    "psnr_exposure_matched": "PSNR exp.",
    "psnr_color_corrected": "PSNR col.",
    "ssim": "SSIM",
    "lpips": "LPIPS",
    "ciede2000": "CIEDE2000",
    MINUTES: "training, min",
}
DECIMALS = {"ssim": 3, "lpips": 3, MINUTES: 1}  # others 2
TEXT = (
    "Test views against the normal-light truth, mean over views. PSNR in dB; exp.: "
    "after the best single gain in linear light; col.: after the best affine map of "
    "each channel; LPIPS with AlexNet; CIEDE2000: mean over pixels. For the last two, "
    "lower is better. Training on the machine that ran this, one run each."
)

Rows = dict[str, dict[str, float]]  # numbers by column, by method


def write_tables(out: Path, results: Results) -> str:
    """Writes table.md, table.csv, table.tex and results.json; returns the Markdown."""
    content = {
        scene: {name: dataclasses.asdict(result) for name, result in rows.items()}
        for scene, rows in results.items()
    }
    atomic.write_text(out / RESULTS, json.dumps(content, indent=2) + "\n")
    blocks = _blocks(results)
    bold = [_table(scene, rows, bold=True) for scene, rows in blocks.items()]
    markdown = "\n\n".join(f"## {t.heading}\n\n{as_markdown(t)}" for t in bold)
    atomic.write_text(out / "table.md", f"{TEXT}\n\n{markdown}\n")
    latex = "\n\n".join(map(as_latex, bold))
    atomic.write_text(out / "table.tex", latex + "\n")
    write_csv(
        out / "table.csv",
        [
            ("scene", "method", *HEADERS),
            *(
                (scene, name, *(str(row.get(column, "")) for column in HEADERS))
                for scene, rows in blocks.items()
                for name, row in rows.items()
            ),
        ],
    )
    return markdown


def read_tables(out: Path) -> Results:
    """The results that ``write_tables`` wrote.

    Raises:
        UserError: the folder holds none, or they are cut short.
    """
    read = atomic.read_json(out / RESULTS, "compare.py")
    return {
        scene: {name: Result(**result) for name, result in rows.items()}
        for scene, rows in read.items()
    }


def tables(results: Results) -> list[Table]:
    """A table per scene, after their mean where there are several scenes."""
    return [_table(scene, rows, bold=False) for scene, rows in _blocks(results).items()]


def _blocks(results: Results) -> dict[str, Rows]:
    """The numbers of each scene, after their mean where there are several scenes."""
    scenes = {
        scene: {name: _numbers(result) for name, result in rows.items()}
        for scene, rows in results.items()
    }
    return (
        {MEAN: mean_rows(list(scenes.values())), **scenes}
        if len(scenes) > 1
        else scenes
    )


def _numbers(result: Result) -> dict[str, float]:
    minutes = {MINUTES: result.train_minutes} if result.trained else {}
    return result.scores | minutes


def mean_rows(scenes: Sequence[Rows]) -> Rows:
    """Means over scenes of the methods that every scene has: others would be means of
    other scenes."""
    shared = [name for name in scenes[0] if all(name in rows for rows in scenes)]
    return {
        name: {
            column: float(np.mean([rows[name][column] for rows in scenes]))
            for column in HEADERS
            if all(column in rows[name] for rows in scenes)
        }
        for name in shared
    }


def _table(heading: str, rows: Rows, *, bold: bool) -> Table:
    """Rows as text; the best score of each column is bold."""
    columns = [c for c in HEADERS if any(c in row for row in rows.values())]
    shown = {
        (name, column): f"{row[column]:.{DECIMALS.get(column, 2)}f}"
        for name, row in rows.items()
        for column in columns
        if column in row
    }
    best = {column: _best(column, rows) for column in columns if column != MINUTES}
    texts = tuple(
        (
            name,
            *(
                f"**{shown[name, column]}**"
                if bold and name in best.get(column, ())
                else shown.get((name, column), "")
                for column in columns
            ),
        )
        for name in rows
    )
    return Table(heading, "", ("method", *(HEADERS[c] for c in columns)), texts)


def _best(column: str, rows: Rows) -> list[str]:
    """The methods whose score, as shown, is the best of its column."""
    sign = -1.0 if column in LOWER_IS_BETTER else 1.0
    decimals = DECIMALS.get(column, 2)
    scores = {
        name: sign * round(row[column], decimals)
        for name, row in rows.items()
        if column in row
    }
    return [name for name, score in scores.items() if score == max(scores.values())]
