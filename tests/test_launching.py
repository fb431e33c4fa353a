# SPDX-License-Identifier: Apache-2.0
"""Many runs at once: quick commands stand in for trainings, but in one test."""

import dataclasses
import json
import os
import signal
import threading
import time
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

import sweep as sweep_script
from internal import flags as flags_of
from internal import script
from internal.errors import UserError
from internal.files import atomic, image_io
from internal.launching import launch, machine
from internal.launching.machine import Machine
from internal.launching.run import Run
from tests.conftest import TINY_PLAIN, flags

WRITES = "touch result"


def shell(folder: Path, *lines: str) -> Run:
    """A run of shell commands in its folder."""
    folder.mkdir(parents=True, exist_ok=True)
    commands = tuple(("sh", "-c", f"cd {folder}; {line}") for line in lines)
    return Run(folder.name, folder, commands, "made of this", folder / "result")


def carry_out(runs, jobs=2):
    return [run.name for run in launch.carry_out(runs, Machine(jobs))]


@pytest.mark.parametrize("jobs", [1, 2])
def test_so_many_runs_at_a_time_and_each_in_the_order_of_its_commands(tmp_path, jobs):
    lines = "echo + >> ../order; sleep 0.1", f"echo - >> ../order; {WRITES}"
    runs = [shell(tmp_path / name, *lines) for name in "abc"]
    assert sorted(carry_out(runs, jobs)) == ["a", "b", "c"]
    steps = [{"+": 1, "-": -1}[x] for x in (tmp_path / "order").read_text().split()]
    at_a_time = [sum(steps[: n + 1]) for n in range(len(steps))]
    assert max(at_a_time) == jobs and at_a_time[-1] == 0


def test_what_fails_or_is_killed_is_named_and_costs_nobody_else(tmp_path, capsys):
    once = "echo now >> tries; "
    runs = [
        shell(tmp_path / "fails", once + "echo error: no light; exit 2", WRITES),
        shell(tmp_path / "killed", once + "echo half done; kill -KILL $$", WRITES),
        shell(tmp_path / "idle", "true"),
        shell(tmp_path / "works", once + WRITES),
    ]
    carry_out(runs)
    capsys.readouterr()
    assert launch.report_failures(runs) == script.FAILURE_EXIT
    named = capsys.readouterr().err.splitlines()
    assert [line.split(" (")[0] for line in named] == [
        "error: fails failed: error: no light",
        "error: killed failed: killed by SIGKILL",
        "error: idle failed: its log is empty",
    ]
    assert "half done" in runs[1].log.read_text()
    assert sorted(carry_out(runs)) == ["fails", "idle", "killed"]
    tries = [(run.folder / "tries").read_text().count("now") for run in runs[::3]]
    assert tries == [2, 1]
    assert launch.report_failures(runs[3:]) == 0


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_sweep_stops_its_runs_once_and_goes_on_later(tmp_path, sent):
    saves = "trap 'echo saved >> state; exit 143' TERM"
    goes_on = f"test -e state && {WRITES} && exit"
    wait = "touch begun; while true; do sleep 0.05; done"
    runs = [shell(tmp_path / name, f"{goes_on}; {saves}; {wait}") for name in "abc"]

    def stop():
        while not all((run.folder / "begun").exists() for run in runs[:2]):
            time.sleep(0.02)
        os.kill(os.getpid(), sent)

    thread = threading.Thread(target=stop)
    thread.start()
    with pytest.raises(SystemExit) as stopped:
        carry_out(runs)
    thread.join()
    assert stopped.value.code == 128 + sent
    states = [run.folder / "state" for run in runs]
    assert [x.read_text() for x in states[:2]] == ["saved\n"] * 2
    assert not states[2].exists()
    states[2].touch()
    assert len(carry_out(runs)) == 3
    assert launch.report_failures(runs) == 0


def test_a_run_is_made_anew_of_something_else(tmp_path):
    run = shell(tmp_path / "a", WRITES)
    assert carry_out([run]) == ["a"]
    assert carry_out([run]) == []
    assert carry_out([shell_of_other_record(run)]) == ["a"]


def shell_of_other_record(run):
    return Run(run.name, run.folder, run.commands, "made of that", run.result)


@given(st.lists(st.integers(), max_size=9, unique=True), st.integers(1, 9))
def test_parts_are_even_and_leave_nothing_out(items, count):
    parts = machine.divide(items, count)
    sizes = [len(part) for part in parts]
    assert len(parts) == count
    assert max(sizes) - min(sizes) <= 1
    assert {x for part in parts for x in part} == set(items)
    if len(items) >= count:
        assert [x for part in parts for x in part] == items


def test_gpus_are_divided_and_one_that_is_shared_has_a_part_of_its_memory():
    visible = {"CUDA_VISIBLE_DEVICES": "4,5,7"}
    assert machine.gpus(visible) == ["4", "5", "7"]
    assert machine.gpus({"CUDA_VISIBLE_DEVICES": ""}) == []
    two = machine.shares(2, [0, 1], ["4", "5", "7"])
    assert [share.cores for share in two] == [(0,), (1,)]
    assert [dict(share.environment) for share in two] == [
        {"CUDA_VISIBLE_DEVICES": "4"},
        {"CUDA_VISIBLE_DEVICES": "5,7"},
    ]
    three = machine.shares(3, [], ["0", "1"])
    memory = {"XLA_PYTHON_CLIENT_MEM_FRACTION": "0.45"}  # 0.9 of the GPU for two
    assert [dict(share.environment) for share in three] == [
        {"CUDA_VISIBLE_DEVICES": name} | memory for name in ("0", "1", "0")
    ]


def test_a_run_has_the_cores_of_its_share(tmp_path):
    if not machine.cores():
        pytest.skip("the cores of a process are not known on this system")
    runs = [shell(tmp_path / name, f"sleep 0.1; nproc; {WRITES}") for name in "ab"]
    carry_out(runs)
    expected = [len(share.cores) for share in machine.shares(2, machine.cores(), [])]
    assert sorted(int(run.last_line()) for run in runs) == sorted(expected)


def test_the_view_says_what_each_run_is_at(tmp_path):
    bar = "training:  43%|####3     | 43/100 [00:10<00:13,  4.30step/s]"
    run = shell(tmp_path / "full", f"echo step; echo '{bar}'")
    assert launch.stage(run) == ""
    carry_out([run])
    assert launch.stage(run) == "full training 43%"


def test_the_cluster_and_its_options_are_checked_at_once(monkeypatch, tmp_path):
    def place(*arguments):
        args = flags_of.sweep("").parse_args(arguments)
        return launch.place_for(args, tmp_path)

    with pytest.raises(UserError, match="go with --cluster slurm"):
        place("--cluster_options", "partition=gpu")
    with pytest.raises(SystemExit):
        place("--jobs=2", "--cluster=slurm")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UserError, match="no sbatch here"):
        place("--cluster=slurm")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(UserError, match="cluster]"):
        place("--cluster=slurm")


def test_a_sweep_trains_and_scores_by_the_scripts_a_user_calls(night, tmp_path):
    arguments = flags(night, tmp_path, "Train.max_steps = 2", model=TINY_PLAIN)
    assert sweep_script.main(arguments) == 0
    assert (tmp_path / "full/metrics.jsonl").is_file()
    dark = atomic.read_json(tmp_path / "full/eval/metrics.json", "eval.py")["mean"]
    assert (
        f"| full | {dark['dark']['psnr']:.3f} |" in (tmp_path / "table.md").read_text()
    )


def test_a_sweep_has_the_same_table_and_sheet_whichever_way_it_ran(
    tmp_path, monkeypatch
):
    """The first run takes longest: two at a time end in another order."""
    kept = tmp_path / "kept"
    for name, level in (("full", 0.2), ("slow", 0.7)):
        (kept / name / "enhanced").mkdir(parents=True)
        (kept / name / "input").mkdir()
        for output in ("enhanced", "input"):
            picture = np.full((18, 24, 3), level, np.float32)
            image_io.write(kept / name / output / "00.png", picture)
        scores = {"dark": {"psnr": 10.0 * level}}
        mean = json.dumps({"mean": scores, "views": {"00": scores}})
        (kept / name / "metrics.json").write_text(mean)

    def stands_in(name, folder, files, bindings):
        wait = {"full": 0.5, "slow": 0.0}[name]
        line = f"sleep {wait}; cp -r {kept / name} eval"
        run = shell(folder, line)
        return dataclasses.replace(run, result=folder / "eval" / "metrics.json")

    monkeypatch.setattr(sweep_script, "scored_run", stands_in)
    tables = set()
    for jobs in ("1", "2"):
        out = tmp_path / jobs
        arguments = [f"--run={out}", "--gin_bindings=Config.data_dir = 'scene'"]
        variants = ["--variants", "slow: Optimizer.lr_init = 1e-4"]
        assert sweep_script.main([*arguments, "--jobs", jobs, *variants]) == 0
        tables.add(tuple((out / x).read_bytes() for x in ("table.csv", "sheet.png")))
    assert len(tables) == 1
