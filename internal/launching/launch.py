# SPDX-License-Identifier: Apache-2.0
"""Carries out runs wherever there is place for them, with one view of their progress.

What is done is not run again; what fails does not stop the others.
"""

import argparse
import re
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

from internal import extras, progress, script
from internal.errors import UserError
from internal.launching.machine import Machine
from internal.launching.run import Run

TICK = 0.2  # seconds between two looks at the runs


@runtime_checkable
class Place(Protocol):
    """Where runs are carried out."""

    def submit(self, run: Run) -> None:
        """Takes a run, to start as soon as there is room."""
        ...

    def ended(self) -> Sequence[Run]:
        """Starts what there is room for; the runs that ended since the last call."""
        ...

    def leave(self) -> str:
        """Called when the user stops the script; what became of the runs, in words."""
        ...


def place_for(args: argparse.Namespace, folder: Path) -> Place:
    """The place that ``--jobs`` or ``--cluster`` asks for.

    Args:
        folder: for what a cluster keeps of its jobs.

    Raises:
        UserError: there is no such place here.
    """
    if args.cluster:
        extras.need("cluster", "submitit", to="--cluster")
        from internal.launching.cluster import Slurm

        return Slurm(folder / "slurm", args.cluster_options)
    if args.cluster_options:
        raise UserError("--cluster_options go with --cluster slurm")
    return Machine(args.jobs)


def carry_out(runs: Sequence[Run], place: Place) -> Iterator[Run]:
    """Yields each run that is not done before, once it has ended, well or not.

    Raises:
        SystemExit: Ctrl-C or SIGTERM; what had begun goes on at the next call.
        UserError: a run cannot be started.
    """
    left = [run for run in runs if not run.is_done()]
    before = len(runs) - len(left)
    with (
        script.Interruption() as interruption,
        progress.bar(len(runs), "runs", "run", initial=before) as bar,
    ):
        try:
            for run in left:
                place.submit(run)
            while left and not interruption:
                for run in place.ended():
                    left.remove(run)
                    outcome = "done" if run.is_done() else f"failed: {end_of(run)}"
                    bar.write(f"{run.name}: {outcome}", file=sys.stderr)
                    bar.update()
                    yield run
                progress.show(bar, ", ".join(filter(None, map(stage, left))))
                time.sleep(TICK)
        finally:
            if left:
                bar.write(f"{place.leave()}; the same command goes on", sys.stderr)
    if interruption:
        raise SystemExit(interruption.exit_code)


def stage(run: Run) -> str:
    """What a run is at, such as "full training 43%"; empty before it says so."""
    found = re.match(r"(\w[\w ]*): +(\d+%)\|", run.last_line())
    return f"{run.name} {found[1]} {found[2]}" if found else ""


def end_of(run: Run) -> str:
    """The last line of a log."""
    return run.last_line() or "its log is empty"


def report_failures(runs: Sequence[Run]) -> int:
    """Names the runs that are not done with the end of their logs; an exit code."""
    failed = [run for run in runs if not run.is_done()]
    for run in failed:
        print(f"error: {run.name} failed: {end_of(run)} ({run.log})", file=sys.stderr)
    return script.FAILURE_EXIT if failed else 0
