# SPDX-License-Identifier: Apache-2.0
"""Kills trainings with SIGKILL at random moments: does each go on to what an
uninterrupted one becomes, bit for bit?

python -m benchmarks.kills [--kills 20] [--seed 0]

A training of a few steps on the night scene is started and killed, again and again in
one folder, at a moment between its start and the time a whole one takes; then it is
let finish. Prints a row per killed training and exits with 1 if any differs.
"""

import argparse
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np

from benchmarks import workload
from internal import cli, flags, parallel
from internal.training import run_folder
from internal.training.checkpoints import load_trained

KILLS_OF_A_RUN = 4
SETTINGS = (
    *("Train.max_steps = 60", "Train.enhance_start = 40", "Train.log_every = 2"),
    *("Train.checkpoint_every = 6", "Train.preview_every = 20"),
    *("Train.batch_size = 64", "Model.num_samples = (8, 8)", "MLP.depth = 2"),
    *("MLP.width = 16", "Model.head_width = 8"),
)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    args = parser.parse_args()
    moments = random.Random(args.seed)
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        size = ["--views", "4", "--width", "24", "--height", "18"]
        made = [sys.executable, "make_scene.py", "night", str(folder / "night"), *size]
        subprocess.run(made, check=True, stdout=subprocess.DEVNULL)
        started = time.monotonic()
        train(folder, "whole").wait()
        seconds = time.monotonic() - started
        whole = result(folder / "whole")
        for number in range(-(-args.kills // KILLS_OF_A_RUN)):
            run = f"run{number}"
            steps = []
            for _ in range(KILLS_OF_A_RUN):
                process = train(folder, run)
                time.sleep(moments.uniform(0.0, seconds))
                process.kill()
                process.wait()
                log = run_folder.read_log(folder / run)
                steps.append(int(log[-1]["step"]) if log else 0)
            code = train(folder, run).wait()
            same = code == 0 and equal(result(folder / run), whole)
            rows.append((run, steps, "equal" if same else f"DIFFERS, exit {code}"))
    print(workload.markdown(("run", "killed at step", "result"), rows))
    return int(any(row[-1] != "equal" for row in rows))


def train(folder: Path, run: str) -> subprocess.Popen:
    """A training that has been started."""
    own = [f"--gin_bindings={x}" for x in SETTINGS]
    where = ["--scene", str(folder / "night"), "--run", str(folder / run)]
    return subprocess.Popen(
        [sys.executable, "train.py", *own, *where],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def result(run: Path) -> tuple[list[np.ndarray], list[dict]]:
    """All that a run ended with: its state, and its log without the seconds."""
    config = cli.start_trained(flags.trained("").parse_args(["--run", str(run)]))
    state = load_trained(config, parallel.data_mesh(jax.device_count()))[1]
    log = run_folder.read_log(run)
    rows = [{k: v for k, v in row.items() if k != "seconds"} for row in log]
    return [np.asarray(leaf) for leaf in jax.tree.leaves(state)], rows


def equal(a: tuple[list, list], b: tuple[list, list]) -> bool:
    """Whether two results agree in every bit."""
    return a[1] == b[1] and all(map(np.array_equal, a[0], b[0]))


if __name__ == "__main__":
    sys.exit(main())
