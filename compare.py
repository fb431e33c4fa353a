# SPDX-License-Identifier: Apache-2.0
"""Runs a list of methods on a list of scenes and writes one table.

python compare.py LOM/buu LOM/chair --out outputs/comparison \
    --gin_bindings="Config.factor = 2"

Methods are the entries of photos.toml and models.toml in configs/methods, or of the
lists that --methods names: photos enhanced one by one, and models trained on photos.
Scenes need no truth, but have no scores without it. Writes index.html, table.md,
table.csv, table.tex and a folder of figures per scene. Run again, it does what is
missing: add a method or a scene, and the rest stays. A training that fails costs its
own rows only.
"""

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from internal import script
from internal.comparison import figures, jobs, page, tables
from internal.comparison.jobs import Job
from internal.comparison.methods import methods_for, read_methods
from internal.flags import add_bindings

LISTS = Path(__file__).parent / "configs" / "methods"


def main(argv: Sequence[str]) -> int:
    """Does the work that is missing, then writes tables, figures and the page."""
    flags = _parser().parse_args(argv)
    methods = read_methods(flags.methods)
    chosen = {scene: methods_for(methods, scene) for scene in flags.scenes}
    todo = list(map(jobs.dark_photos, chosen))
    for scene, listed in chosen.items():
        todo += [jobs.job_of(scene, method) for method in listed]
    jobs.check_settings(todo, flags.gin_bindings)
    jobs.open_comparison(flags.out, flags.scenes, flags.gin_bindings)

    # Trainings come last: the rest of the table is there within minutes.
    todo = sorted(dict.fromkeys(todo), key=lambda job: bool(job.train))
    seconds: dict[bool, list[float]] = {}  # of each work done now, by if it trained
    failed: list[str] = []
    for index, job in enumerate(todo):
        rest = [x for x in todo[index:] if not jobs.is_scored(flags.out, x)]
        left = time_left(seconds, rest)
        print(f"== {index + 1} of {len(todo)}, {left}: {job}", flush=True)
        began = time.monotonic()
        code = jobs.do(flags.out, job, flags.gin_bindings)
        if code == script.FAILURE_EXIT:
            failed.append(str(job))
        elif code:
            print(f"stopped at {job}; the same command goes on", file=sys.stderr)
            return code
        elif job in rest:
            seconds.setdefault(bool(job.train), []).append(time.monotonic() - began)
        found = jobs.read_results(flags.out, chosen)
        tables.write_tables(flags.out, found)

    results = jobs.read_results(flags.out, chosen)
    drawn = [
        path
        for scene in chosen
        for path in figures.write_figures(
            flags.out, scene, results[jobs.scene_name(scene)]
        )
    ]
    print(tables.write_tables(flags.out, results))
    print(page.write_page(flags.out, results, drawn))
    if failed:
        print(f"error: no rows of: {'; '.join(failed)}", file=sys.stderr)
    return script.FAILURE_EXIT if failed else 0


def time_left(seconds: Mapping[bool, Sequence[float]], rest: Sequence[Job]) -> str:
    """How long the rest takes if it goes like the work of its kind so far, in words."""
    if not rest:
        return "done before"
    if any(bool(job.train) not in seconds for job in rest):
        return f"{len(rest)} to do"
    mean = {kind: sum(known) / len(known) for kind, known in seconds.items()}
    minutes = sum(mean[bool(job.train)] for job in rest) / 60.0
    return f"{len(rest)} to do, about {minutes:.0f} min left"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Compare methods on scenes.")
    parser.add_argument("scenes", type=Path, nargs="+", help="folders of scenes")
    parser.add_argument("--out", type=Path, required=True, help="folder of the results")
    parser.add_argument(
        "--methods", type=Path, nargs="+", metavar="LIST",
        default=[LISTS / "photos.toml", LISTS / "models.toml"],
        help="lists of methods; photos.toml and models.toml of configs/methods if none",
    )  # fmt: skip
    add_bindings(parser)
    return parser


if __name__ == "__main__":
    script.run(main)
