# SPDX-License-Identifier: Apache-2.0
"""Runs side by side on this machine, each with its share of the cores and GPUs."""

import collections
import contextlib
import dataclasses
import itertools
import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from typing import TypeVar

from internal.launching.run import Run

T = TypeVar("T")
GPU_MEMORY = 0.9  # of a GPU, shared by the runs on it


@dataclasses.dataclass(frozen=True)
class Share:
    """What one run has of the machine."""

    cores: tuple[int, ...]  # empty: not known here
    environment: Mapping[str, str]  # names the GPUs, where there are any


@dataclasses.dataclass
class _Started:
    run: Run
    share: Share
    command: int
    process: subprocess.Popen


class Machine:
    """At most so many runs at a time; the others wait."""

    def __init__(self, jobs: int) -> None:
        self._free = collections.deque(shares(jobs, cores(), gpus(os.environ)))
        self._waiting: collections.deque[Run] = collections.deque()
        self._started: list[_Started] = []

    def submit(self, run: Run) -> None:
        """Lets a run wait for its turn."""
        self._waiting.append(run)

    def ended(self) -> list[Run]:
        """Starts what there is room for; the runs that ended since the last call."""
        over = []
        for started in list(self._started):
            code = started.process.poll()
            if code is None:
                continue
            self._started.remove(started)
            failed = started.run.end(started.command, code)
            following = started.command + 1
            if failed or following == len(started.run.commands):
                self._free.append(started.share)
                over.append(started.run)
            else:
                self._start(started.run, started.share, following)
        while self._waiting and self._free:
            self._start(self._waiting.popleft(), self._free.popleft(), 0)
        return over

    def leave(self) -> str:
        """Lets what runs save its checkpoint and end."""
        for started in self._started:
            started.process.terminate()
        for started in self._started:
            started.process.wait()
        return f"stopped {len(self._started)} runs"

    def _start(self, run: Run, share: Share, command: int) -> None:
        # A group of its own: Ctrl-C reaches this process alone, which then asks once.
        process = run.start(
            command, process_group=0, env={**os.environ, **share.environment}
        )
        if share.cores:
            with contextlib.suppress(ProcessLookupError):  # it has ended already
                os.sched_setaffinity(process.pid, share.cores)
        self._started.append(_Started(run, share, command, process))


def shares(jobs: int, cores: Sequence[int], gpus: Sequence[str]) -> list[Share]:
    """The machine in ``jobs`` parts. Jobs share a core or GPU only if there are more
    of them than of those; of a GPU's memory each then has a part."""
    memory = GPU_MEMORY / -(-jobs // len(gpus)) if gpus else 0.0
    found = []
    for own, cards in zip(divide(cores, jobs), divide(gpus, jobs), strict=True):
        visible = {"CUDA_VISIBLE_DEVICES": ",".join(cards)}
        if 0 < len(gpus) < jobs:
            visible["XLA_PYTHON_CLIENT_MEM_FRACTION"] = f"{memory:.2f}"
        found.append(Share(own, visible if gpus else {}))
    return found


def divide(items: Sequence[T], count: int) -> list[tuple[T, ...]]:
    """``count`` parts of neighbours, as even as can be; parts of one item, in turn,
    where there are fewer items."""
    if len(items) < count:
        return [
            tuple(items[i % len(items)] for _ in "1" if items) for i in range(count)
        ]
    edges = [i * len(items) // count for i in range(count + 1)]
    return [tuple(items[a:b]) for a, b in itertools.pairwise(edges)]


def cores() -> list[int]:
    """The cores this process may use; none where the system does not say."""
    if not hasattr(os, "sched_getaffinity"):
        return []
    return sorted(os.sched_getaffinity(0))


def gpus(environment: Mapping[str, str]) -> list[str]:
    """The NVIDIA GPUs that this process may use, as CUDA_VISIBLE_DEVICES names them."""
    visible = environment.get("CUDA_VISIBLE_DEVICES")
    if visible is not None:
        return [name for name in visible.split(",") if name]
    if not shutil.which("nvidia-smi"):
        return []
    listed = subprocess.run(
        ["nvidia-smi", "--query-gpu=index", "--format=csv,noheader"],
        capture_output=True, text=True,
    )  # fmt: skip
    return listed.stdout.split() if listed.returncode == 0 else []
