# SPDX-License-Identifier: Apache-2.0
"""What benchmarks share: a configured train step on a real scene, timed fairly."""

import contextlib
import dataclasses
import io
import json
import resource
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax

from internal import cli, configs, parallel
from internal.comparison.scored_run import scored_run
from internal.configs import Config
from internal.launching import launch
from internal.models import Model
from internal.pages import tables
from internal.pages.pages import Table
from internal.training import sampler
from internal.training.step import TrainState, initial_state, make_train_step

FAST = "configs/llnerf_fast.gin"
FAITHFUL = "configs/llnerf.gin"
SCORES = (
    ("dark", "psnr"),
    ("dark", "ssim"),
    ("enhanced", "psnr"),
    ("enhanced", "ssim"),
    ("enhanced", "psnr_exposure_matched"),
    ("gain_to_mean", "psnr"),
    ("gain_to_mean", "ssim"),
)
SCORE_HEADERS = tuple(f"{kind} {name}" for kind, name in SCORES)


@dataclasses.dataclass
class Workload:
    """A compiled train step and the state it moves on."""

    config: Config
    model: Model
    step: Any  # the jitted train step
    arguments: tuple
    state: TrainState
    compile_seconds: float

    def run(self) -> float:
        """Seconds of one step."""
        started = time.perf_counter()
        self.state, _ = jax.block_until_ready(self.step(self.state, *self.arguments))
        return time.perf_counter() - started

    @property
    def rays(self) -> int:
        """Rays of one step, each supervised by a pixel of its own."""
        return self.config.train.batch_size * (sampler.neighbors_of(self.config) + 1)


def load(
    data_dir: str,
    files: Sequence[str],
    bindings: Sequence[str] = (),
    devices: int | None = None,
) -> Workload:
    """A workload after its first step, which compiled it."""
    here = [*bindings, f"Config.data_dir = {data_dir!r}"]
    config = configs.load_config(files, here)
    with contextlib.redirect_stdout(io.StringIO()):
        scene = cli.load_split(config, "train")
    mesh = parallel.data_mesh(config.train.batch_size, jax.devices()[:devices])
    model = Model(config.model)
    chances = sampler.find_chances(scene, config)
    pixels = sampler.resident_pixels(scene.images, scene.gains, chances)
    arguments = parallel.replicate((scene.cameras, scene.space, pixels), mesh)
    state = parallel.replicate(initial_state(config, model), mesh)
    step = jax.jit(
        make_train_step(config, model, mesh, scene.brightness), donate_argnums=0
    )
    started = time.perf_counter()
    step = step.lower(state, *arguments).compile()
    seconds = time.perf_counter() - started
    workload = Workload(config, model, step, arguments, state, seconds)
    workload.run()
    return workload


def interleaved(runs: Sequence[Callable[[], float]], rounds: int) -> list[float]:
    """Median seconds of each, taken in turns so that a noisy moment hits all."""
    seconds = [[run() for run in runs] for _ in range(rounds)]
    return [statistics.median(column) for column in zip(*seconds, strict=True)]


def peak_memory() -> float:
    """The most memory this process has held, GB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def markdown(headers: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table."""
    texts = tuple(tuple(map(str, row)) for row in rows)
    return tables.as_markdown(Table("", "", tuple(headers), texts))


def score_cells(mean: Mapping[str, Mapping[str, float]]) -> list[str]:
    """What ``SCORE_HEADERS`` names, of the mean scores of test views that there are."""
    return [f"{mean[kind][name]:.3f}" for kind, name in SCORES if kind in mean]


def scores(run: Path, gin_config: str, gin_bindings: Sequence[str]) -> dict:
    """``metrics.json`` of a training, which is not run again if it was done before."""
    scored = scored_run(run.name, run, [gin_config], gin_bindings)
    if not scored.is_done() and scored.perform():
        sys.exit(launch.report_failures([scored]))
    return json.loads((run / "eval" / "metrics.json").read_text())
