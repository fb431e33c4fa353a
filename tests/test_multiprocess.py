# SPDX-License-Identifier: Apache-2.0
"""Two processes on loopback train what one process trains."""

import socket
import subprocess
import sys
from pathlib import Path

import chex
import jax
import jax.numpy as jnp

import make_scene
import train as train_script
from internal import parallel
from internal.checkpoints import load_trained
from internal.configs import load_config
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


def test_two_processes_equal_one(tmp_path):
    scene = tmp_path / "night"
    make_scene.main(
        ["night", str(scene), "--views", "4", "--width", "24", "--height", "18"]
    )
    cluster = (f"--coordinator=127.0.0.1:{free_port()}", "--num_processes=2")
    both = [
        subprocess.Popen(
            [
                *(sys.executable, "train.py", *flags(scene, tmp_path / "two")),
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
        outputs = [process.communicate(timeout=300)[0] for process in both]
    finally:
        for process in both:
            process.kill()
    assert [process.returncode for process in both] == [0, 0], "\n".join(outputs)
    assert "process 1 of 2" in outputs[1]
    assert train_script.main(flags(scene, tmp_path / "one")) == 0
    one, two = load(tmp_path / "one"), load(tmp_path / "two")
    assert one.step == two.step == 6
    chex.assert_trees_all_close(one.params, two.params, atol=2e-5)
