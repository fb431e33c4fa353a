# SPDX-License-Identifier: Apache-2.0
"""Tables of a comparison as Markdown, CSV, LaTeX and a page."""

import csv

import pytest

from internal.comparison import score_tables
from internal.comparison.jobs import Result
from internal.comparison.score_tables import MEAN
from internal.errors import UserError
from internal.pages import tables as formats
from internal.pages.pages import Table


def _result(folder, minutes=0.0, **scores):
    return Result(folder, "unchanged", minutes > 0.0, scores, minutes)


RESULTS = {
    "buu": {
        "A & B": _result("buu/a", psnr=20.004, lpips=0.3),
        "C_1": _result("buu/c", 2.0, psnr=10.0, lpips=0.1),
        "only here": _result("buu/o", psnr=15.0, lpips=0.2),
    },
    "chair": {
        "A & B": _result("chair/a", psnr=10.0, lpips=0.3),
        "C_1": _result("chair/c", 4.0, psnr=10.0, lpips=0.2),
    },
}


def test_latex_prints_every_character_and_keeps_bold():
    table = Table("50 % of a_b", "", ("m", "x"), (("A & B^2 {~\\#$}", "**1.0**"),))
    lines = formats.as_latex(table).splitlines()
    assert r"\caption{50 \% of a\_b}" in lines
    escaped = r"A \& B\textasciicircum{}2 \{\textasciitilde{}\textbackslash{}\#\$\}"
    assert rf"{escaped} & \textbf{{1.0}} \\" in lines
    assert lines[2] == r"\begin{tabular}{lr}"


def test_markdown_has_the_best_of_each_column_bold(tmp_path):
    markdown = score_tables.write_tables(tmp_path, RESULTS)
    blocks = markdown.split("## ")
    assert [block.split("\n")[0] for block in blocks[1:]] == [MEAN, "buu", "chair"]
    # Of buu PSNR is best high, LPIPS low; training time is never bold.
    assert "| A & B | **20.00** | 0.300 |  |" in blocks[2]
    assert "| C_1 | 10.00 | **0.100** | 2.0 |" in blocks[2]
    # Equal as shown: both are bold.
    assert "| A & B | **10.00** |" in blocks[3]
    assert "| C_1 | **10.00** | **0.200** | 4.0 |" in blocks[3]
    assert markdown in (tmp_path / "table.md").read_text()


def test_means_are_of_methods_that_every_scene_has(tmp_path):
    score_tables.write_tables(tmp_path, RESULTS)
    with (tmp_path / "table.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["scene"] == MEAN]
    assert [row["method"] for row in rows] == ["A & B", "C_1"]
    assert [float(row["psnr"]) for row in rows] == pytest.approx([15.002, 10.0])
    assert [row["train_minutes"] for row in rows] == ["", "3.0"]


def test_latex_table_of_each_block(tmp_path):
    score_tables.write_tables(tmp_path, RESULTS)
    text = (tmp_path / "table.tex").read_text()
    assert text.count(r"\begin{table}") == text.count(r"\end{table}") == 3
    assert r"C\_1 & 10.00 & \textbf{0.100} & 2.0 \\" in text


def test_one_scene_has_no_mean(tmp_path):
    markdown = score_tables.write_tables(tmp_path, {"buu": RESULTS["buu"]})
    assert MEAN not in markdown


def test_a_scene_without_truth_has_rows_without_scores(tmp_path):
    results = {"mine": {"A": _result("mine/a"), "B": _result("mine/b", 1.0)}}
    markdown = score_tables.write_tables(tmp_path, results)
    assert "| method | training, min |" in markdown
    assert "| A |  |" in markdown


def test_results_are_read_back_as_written(tmp_path):
    score_tables.write_tables(tmp_path, RESULTS)
    assert score_tables.read_tables(tmp_path) == RESULTS


def test_a_folder_without_results_is_named(tmp_path):
    with pytest.raises(UserError, match=r"results\.json: not found"):
        score_tables.read_tables(tmp_path)
