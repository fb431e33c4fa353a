# SPDX-License-Identifier: Apache-2.0
"""Runs as jobs of a Slurm cluster, through submitit (imported only here).

submitit writes the batch script and starts Python on the node. The state of jobs comes
from ``squeue``, which, unlike submitit's ``sacct``, needs no accounting database. A job
asked to stop saves its checkpoint: one that Slurm preempts is queued again by Slurm,
one at the end of its time limit by itself.
"""

import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import submitit
from submitit.core.utils import FailedJobError

from internal.errors import UserError
from internal.files import atomic
from internal.launching.run import Run

POLL = 10.0  # seconds between two questions to the cluster
PAUSE = 1.0  # seconds before a cluster that did not answer is asked again
WARNING = 90  # seconds before the time limit at which a job is asked to stop
JOB = "slurm_job.txt"  # in the folder of a run: the number of its job
OVER = frozenset(
    "BOOT_FAIL CANCELLED COMPLETED DEADLINE FAILED NODE_FAIL OUT_OF_MEMORY PREEMPTED "
    "REVOKED TIMEOUT".split()
)
ROOT = shlex.quote(str(Path(__file__).parents[2]))


class Slurm:
    """Every run a job; the cluster decides how many run at a time."""

    def __init__(self, folder: Path, options: Sequence[str]) -> None:
        """Args:
            folder: for submitit's files, seen by all nodes.
            options: KEY=VALUE as ``submitit.SlurmExecutor`` knows them.

        Raises:
            UserError: submitit or Slurm is not there, or an option is wrong.
        """
        if not shutil.which("sbatch") or not shutil.which("srun"):
            raise UserError("--cluster slurm: no sbatch here; log in to the cluster")
        self._executor = submitit.SlurmExecutor(folder.absolute())
        chosen = parse_options(options)
        cores = chosen.get("cpus_per_task")  # srun does not take them from its job
        try:
            self._executor.update_parameters(
                **{"job_name": "llnerf", "time": 240, **chosen},
                setup=[f"export PYTHONPATH={ROOT}:$PYTHONPATH"],
                srun_args=[f"--cpus-per-task={cores}"] if cores else [],
                additional_parameters={"signal": f"TERM@{WARNING}", "requeue": True},
            )
        except (TypeError, ValueError) as error:
            raise UserError(
                f"--cluster_options: {' '.join(str(error).split())}"
            ) from error
        self._jobs: dict[Run, str] = {}
        self._asked = 0.0

    def submit(self, run: Run) -> None:
        """Queues a run, unless its job of an earlier call is still there.

        Raises:
            UserError: the cluster refuses it.
        """
        record = run.folder / JOB
        job = record.read_text() if record.is_file() else ""
        known = states()
        if known is None:
            raise UserError("--cluster slurm: squeue does not answer; try again later")
        if known.get(job, "COMPLETED") in OVER:
            job = self._queue(run)
            atomic.ensure_folder(run.folder)
            atomic.write_text(record, job)
        self._jobs[run] = job

    def ended(self) -> list[Run]:
        """The runs whose jobs ended since the last call."""
        if time.monotonic() < self._asked + POLL:
            return []
        self._asked = time.monotonic()
        known = states()
        over: list[Run] = []
        if known is None:  # not now; later
            return over
        for run, job in list(self._jobs.items()):
            state = known.get(job, "")
            if state == "PREEMPTED":
                del self._jobs[run]
                self.submit(run)
            elif run.is_done() or state in OVER - {"COMPLETED"} or not state:
                # COMPLETED and not done: its files have yet to reach this machine.
                del self._jobs[run]
                over.append(run)
                if state in OVER - {"FAILED"} and not run.is_done():
                    run.note(f"Slurm job {job}: {state}")
        return over

    def leave(self) -> str:
        """Leaves the jobs where they are."""
        jobs = " ".join(self._jobs.values())
        return f"the jobs go on (to end them: scancel {jobs})"

    def _queue(self, run: Run) -> str:
        try:
            return self._executor.submit(perform_in_job, run).job_id
        except (FailedJobError, OSError) as error:
            words = str(error).strip().splitlines()[-1]
            raise UserError(f"--cluster slurm: {run.name}: {words}") from error


def perform_in_job(run: Run) -> None:
    """What a job does: the run, and a place in the queue where time was too short.

    Raises:
        SystemExit: the run is not done.
    """
    code = run.perform()
    if code == 128 + signal.SIGTERM and queue_again(os.environ["SLURM_JOB_ID"]):
        time.sleep(WARNING)  # Slurm ends this try; an end of its own may fail the job
    if code:
        sys.exit(code)


def queue_again(job: str) -> bool:
    """Has Slurm start a running job anew; asks as often as there is time for. Whether
    it will: a job that is preempted, or that the user cancels, no longer runs.
    """
    end = time.monotonic() + WARNING
    while time.monotonic() < end:
        known = states()
        if known and known.get(job) != "RUNNING":
            return False
        if known and not subprocess.run(["scontrol", "requeue", job]).returncode:
            return True
        time.sleep(PAUSE)
    return False


def states() -> dict[str, str] | None:
    """Slurm's word for the state of each of the user's jobs of late; None if it does
    not answer."""
    command = ["squeue", "--me", "--noheader", "--states=all", "--format=%A %T"]
    asked = subprocess.run(command, capture_output=True, text=True)
    if asked.returncode:
        return None
    return dict(line.split() for line in asked.stdout.splitlines())


def parse_options(options: Sequence[str]) -> dict[str, int | str]:
    """The values of KEY=VALUE, whole numbers as such.

    Raises:
        UserError: one is not of this form.
    """
    chosen: dict[str, int | str] = {}
    for option in options:
        key, equals, value = option.partition("=")
        if not key or not equals:
            raise UserError(f"--cluster_options: {option!r} is not KEY=VALUE")
        chosen[key] = int(value) if value.isdecimal() else value
    return chosen
