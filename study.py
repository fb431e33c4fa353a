# SPDX-License-Identifier: Apache-2.0
"""Asks people which pictures are better, and draws what they answered.

python study.py make OUT ours=outputs/night/eval theirs=FOLDER_OF_PICTURES
python study.py chart OUT answers_ann.csv answers_bob.csv

The first method is the one under test. ``make`` writes a page that works from disk
or any web server; participants download a CSV from it. ``chart`` turns the CSVs
into the paper's bar chart, as OUT/index.html and OUT/preferences.csv.
"""

import argparse
import csv
import dataclasses
import io
from collections.abc import Sequence
from pathlib import Path

from internal.cli import run_script
from internal.files import made_folder
from internal.pages import charts, pages, tables
from internal.study.answers import Preference, preferences, read_answers
from internal.study.page import parse_method, write_study
from internal.training import run_folder


def main(argv: Sequence[str] | None = None) -> int:
    """Makes the page, or the chart of its answers."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    make = commands.add_parser("make", help="a page that shows pairs of pictures")
    make.add_argument("out", type=Path, help="folder to make")
    make.add_argument("methods", nargs="+", metavar="NAME=FOLDER")
    make.add_argument("--views", type=int, default=10, help="at random; 0: all")
    make.add_argument("--seed", type=int, default=0, help="of the choice of views")
    make.add_argument("--overwrite", action="store_true")
    chart = commands.add_parser("chart", help="the bar chart of downloaded answers")
    chart.add_argument("out", type=Path, help="folder to write to")
    chart.add_argument("answers", nargs="+", type=Path, metavar="CSV")
    args = parser.parse_args(argv)
    return _make(args) if args.command == "make" else _chart(args)


def _make(args: argparse.Namespace) -> int:
    methods = [parse_method(text) for text in args.methods]
    facts = made_folder.make_folder(
        args.out,
        {"methods": args.methods, "views": args.views, "seed": args.seed},
        lambda folder: write_study(folder, methods, args.views, args.seed),
        overwrite=args.overwrite,
    )
    print(
        f"{args.out / 'index.html'}: {facts['pairs']:.0f} pairs of "
        f"{facts['views']:.0f} views; zip the folder or put it on any web server"
    )
    return 0


def _chart(args: argparse.Namespace) -> int:
    answers = read_answers(args.answers)
    results = preferences(answers)
    svg = charts.preferences(answers[0].a, results)
    table = _table(results)
    run_folder.make_folder(args.out)
    text = io.StringIO()
    writer = csv.DictWriter(text, [f.name for f in dataclasses.fields(Preference)])
    writer.writeheader()
    writer.writerows(dataclasses.asdict(result) for result in results)
    run_folder.write_text(args.out / "preferences.csv", text.getvalue())
    page = pages.write_index(
        args.out,
        f"User study: {answers[0].a}",
        "Which of two pictures of the same view is better (paper, Fig. 8).",
        [pages.Markup("Preferences", "", svg), table],
    )
    print(f"{tables.as_text(table)}\n{page}")
    return 0


def _table(results: Sequence[Preference]) -> pages.Table:
    text = (
        "Each participant counts once. Intervals: 95 %, Wilson, participants as trials."
    )
    rows = tuple(
        (
            result.rival,
            *(f"{100 * s:.1f} %" for s in (result.a_better, result.undecided)),
            f"{100 * result.b_better:.1f} %",
            " to ".join(f"{100 * end:.1f} %" for end in result.interval),
            str(result.participants),
            str(result.answers),
        )
        for result in results
    )
    headers = (
        *("against", "better", "cannot decide", "worse", "better, interval"),
        *("participants", "answers"),
    )
    return pages.Table("Numbers", text, headers, rows)


if __name__ == "__main__":
    run_script(main)
