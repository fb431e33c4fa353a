# SPDX-License-Identifier: Apache-2.0
"""Asks people which pictures are better, and draws what they answered.

python study.py make OUT ours=outputs/night/eval theirs=FOLDER_OF_PICTURES
python study.py chart OUT answers_ann.csv answers_bob.csv

The first method is the one under test. ``make`` writes a page that works from disk
or any web server; participants download a CSV from it. ``chart`` turns the CSVs
into the paper's bar chart, as OUT/index.html and OUT/preferences.csv.
"""

from internal import flags, script

if __name__ == "__main__":  # before the imports below, which take seconds
    script.begin(flags.study(__doc__), computes=False)

import argparse
import dataclasses
from collections.abc import Sequence

from internal.errors import UserError
from internal.files import atomic, made_folder
from internal.pages import charts, pages, tables
from internal.study.answers import Preference, preferences, read_answers
from internal.study.page import parse_method, write_study


def main(argv: Sequence[str] | None = None) -> int:
    """Makes the page, or the chart of its answers."""
    args = flags.study(__doc__).parse_args(argv)
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
    page, numbers = args.out / "index.html", args.out / "preferences.csv"
    if page.exists() and not numbers.exists():
        raise UserError(
            f"{page}: not a chart of answers, so it is not written over; choose "
            "another folder"
        )
    answers = read_answers(args.answers)
    results = preferences(answers)
    svg = charts.preference_chart(answers[0].a, results)
    table = _table(results)
    atomic.ensure_folder(args.out)
    names = [field.name for field in dataclasses.fields(Preference)]
    rows = [list(map(str, dataclasses.astuple(result))) for result in results]
    tables.write_csv(numbers, [names, *rows])
    pages.write_index(
        args.out,
        f"User study: {answers[0].a}",
        "Which of two pictures of the same view is better (LLNeRF Fig. 9).",
        [pages.Markup("Preferences", "", svg), table],
    )
    print(f"{tables.as_markdown(table)}\n{page}")
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
    script.run(main)
