# SPDX-License-Identifier: Apache-2.0
"""Two processes on loopback train what one process trains, and stop together."""

import contextlib
import signal
import socket
import subprocess
import sys
from pathlib import Path

import chex
import jax
import jax.numpy as jnp
import pytest

import make_scene
import train as train_script
from internal import parallel
from internal.configs import load_config
from internal.training import run_folder
from internal.training.checkpoints import Checkpoints, load_trained
from tests.browser import until
from tests.conftest import TINY_MODEL

ROOT = Path(__file__).parents[1]


def free_port():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


def flags(scene, run):
    own = (f"Config.data_dir = {str(scene)!r}", f"Config.checkpoint_dir = {str(run)!r}")
    return [f"--gin_bindings={binding}" for binding in (*TINY_MODEL, *own)]


def load(run):
    config = load_config([], [*TINY_MODEL, f"Config.checkpoint_dir = {str(run)!r}"])
    state = load_trained(config, parallel.data_mesh(1, jax.devices()[:1]))[1]
    return jax.tree.map(jnp.asarray, state)


@pytest.fixture
def scene(tmp_path):
    folder = tmp_path / "night"
    make_scene.main(
        ["night", str(folder), "--views", "4", "--width", "24", "--height", "18"]
    )
    return folder


@contextlib.contextmanager
def two_processes(arguments):
    """train.py with those arguments, twice, as one run; none lives on."""
    cluster = (f"--coordinator=127.0.0.1:{free_port()}", "--num_processes=2")
    both = [
        subprocess.Popen(
            [
                *(sys.executable, "train.py", *arguments),
                *(*cluster, f"--process_id={process}"),
            ],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for process in (0, 1)
    ]
    try:
        yield both
    finally:
        for process in both:
            process.kill()


def finish(both, codes):
    outputs = [process.communicate(timeout=300)[0] for process in both]
    assert [process.returncode for process in both] == codes, "\n".join(outputs)
    return outputs


def test_two_processes_equal_one(scene, tmp_path):
    with two_processes(flags(scene, tmp_path / "two")) as both:
        outputs = finish(both, [0, 0])
    assert "process 1 of 2" in outputs[1]
    assert train_script.main(flags(scene, tmp_path / "one")) == 0
    one, two = load(tmp_path / "one"), load(tmp_path / "two")
    assert one.step == two.step == 6
    chex.assert_trees_all_close(one.params, two.params, atol=2e-5)


def test_a_signal_to_one_process_saves_and_ends_both(scene, tmp_path):
    run = tmp_path / "run"
    endless = [
        f"--gin_bindings=Train.{name} = 100000"
        for name in ("max_steps", "checkpoint_every", "preview_every")
    ]
    with two_processes([*flags(scene, run), *endless]) as both:
        until(lambda: run_folder.read_log(run), "a logged step")
        both[1].send_signal(signal.SIGINT)
        finish(both, [0, 128 + signal.SIGINT])
    logged = [row["step"] for row in run_folder.read_log(run)]
    with Checkpoints(run, kept=1) as checkpoints:
        assert checkpoints.latest_step() == logged[-1]
