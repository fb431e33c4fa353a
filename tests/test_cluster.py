# SPDX-License-Identifier: Apache-2.0
"""Runs as jobs of a real Slurm on this machine; skips where there is none."""

from pathlib import Path

import pytest

from internal.errors import UserError
from internal.launching import cluster, launch
from internal.launching.cluster import Slurm
from tests import slurm
from tests.test_launching import WRITES, shell

TELLS = "squeue --noheader --jobs=$SLURM_JOB_ID --format='%P %l'"
PREEMPT = "sbatch -p dear --exclusive -o /dev/null --wrap true; sleep 30"


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    pytest.importorskip("submitit", reason="the extra cluster is not installed")
    with slurm.running(tmp_path_factory.mktemp("slurm")) as variables:
        yield variables


@pytest.fixture
def place(environment, monkeypatch, tmp_path):
    """Makes a place with options."""
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(cluster, "POLL", 0.3)
    states = cluster.states
    monkeypatch.setattr(cluster, "states", lambda: (slurm.hurry(), states())[1])
    return lambda *options: Slurm(tmp_path / "jobs", ["time=5", *options])


def twice(folder: Path, first: str):
    """A run that leaves a checkpoint at the first try, and ends at the second."""
    return shell(folder, f"test -e half && {WRITES} && exit; touch half; {first}")


def test_jobs_end_fail_and_die_apart_and_only_what_is_missing_runs_again(
    place, tmp_path, capsys
):
    once = "echo now >> tries; "
    works = shell(tmp_path / "works", once + TELLS, WRITES)
    fails = shell(tmp_path / "fails", "echo error: no light; exit 2", WRITES)
    killed = twice(tmp_path / "killed", "scancel $SLURM_JOB_ID; sleep 30")
    late = twice(tmp_path / "late", "scancel -s TERM $SLURM_JOB_ID; sleep 30")
    runs = [works, fails, killed, late]
    assert len(list(launch.carry_out(runs, place("partition=cancel")))) == 4
    capsys.readouterr()
    assert launch.report_failures(runs) == 1
    named = capsys.readouterr().err.splitlines()
    job = (killed.folder / cluster.JOB).read_text()
    assert [line.split(" (")[0] for line in named] == [
        "error: fails failed: error: no light",
        f"error: killed failed: Slurm job {job}: CANCELLED",
    ]
    assert works.log.read_text() == "cancel 5:00\n"
    again = [run.name for run in launch.carry_out(runs, place())]
    assert sorted(again) == ["fails", "killed"]
    assert killed.is_done() and (works.folder / "tries").read_text() == "now\n"


@pytest.mark.parametrize("mode", ["requeue", "cancel"])
def test_a_preempted_run_goes_on(place, tmp_path, mode):
    run = twice(tmp_path / "cheap", PREEMPT)
    list(launch.carry_out([run], place(f"partition={mode}")))
    assert run.is_done()


def test_a_second_call_waits_for_the_job_of_the_first(place, tmp_path):
    run = shell(tmp_path / "slow", f"echo now >> tries; sleep 1; {WRITES}")
    first = launch.carry_out([run], place())
    place().submit(run)
    job = (run.folder / cluster.JOB).read_text()
    assert len(list(first)) == 1
    assert (run.folder / cluster.JOB).read_text() == job
    assert (run.folder / "tries").read_text() == "now\n"


@pytest.mark.parametrize(
    ("option", "complaint"),
    [
        ("partition", "not KEY=VALUE"),
        ("colour=3", "colour"),
        ("partition=none", "invalid partition"),
        ("gpus_per_node=1", "gres"),  # there is none here
    ],
)
def test_what_the_cluster_refuses_is_one_line(place, tmp_path, option, complaint):
    run = shell(tmp_path / "a", WRITES)
    with pytest.raises(UserError, match=f"(?i){complaint}") as raised:
        list(launch.carry_out([run], place(option)))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("state", "again"), [("RUNNING", ["requeue 7"]), ("PREEMPTED", [])]
)
def test_a_cluster_that_does_not_answer_is_asked_again(
    tmp_path, monkeypatch, state, again
):
    answers = {
        "squeue": f"test -e asked && echo 7 {state} && exit; touch asked; exit 1",
        "scontrol": 'echo "$@" >> told',
    }
    for name, answer in answers.items():
        (tmp_path / name).write_text(f"#!/bin/sh\ncd {tmp_path}\n{answer}\n")
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    monkeypatch.setattr(cluster, "PAUSE", 0.0)
    (tmp_path / "told").touch()
    cluster.queue_again("7")
    assert (tmp_path / "told").read_text().splitlines() == again
