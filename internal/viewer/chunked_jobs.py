# SPDX-License-Identifier: Apache-2.0
"""Pictures that are computed a chunk at a time, coarse before fine.

A job belongs to one session. Whoever runs jobs calls ``step`` until it is done and
may stop at any time; between two steps nothing is running.
"""

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, runtime_checkable

import jax

from internal.cameras import Cameras
from internal.rendering.renderer import assemble
from internal.structs import LitRendering, Rendering

Parts = Iterator[Rendering | LitRendering]
Finish = Callable[[Rendering | LitRendering], None]


class Speedometer:
    """Rays per second lately, over all jobs."""

    def __init__(self, rays_per_second: float) -> None:
        self.rays_per_second = rays_per_second

    def note(self, rays: int, seconds: float) -> None:
        """Takes a measurement into the running mean."""
        rate = rays / max(seconds, 1e-6)
        self.rays_per_second += 0.3 * (rate - self.rays_per_second)


@dataclasses.dataclass(frozen=True)
class Task:
    """A picture of one camera, computed as its parts are asked for."""

    camera: Cameras
    parts: Parts
    speed: Speedometer  # hears how long each part took


class Series:
    """Carries out each of ``tasks`` in turn and hands every whole picture over."""

    def __init__(self, tasks: Sequence[Task], finish: Finish) -> None:
        self._waiting = list(tasks)
        self._finish = finish
        self._done_parts: list[Rendering | LitRendering] = []
        self.delivered = 0  # whole pictures so far

    @property
    def done(self) -> bool:
        """Whether every picture was handed over."""
        return not self._waiting

    def step(self) -> None:
        """Computes one chunk; at the end of a picture hands it over."""
        task, started = self._waiting[0], time.perf_counter()
        part = next(task.parts, None)
        if part is not None:
            self._done_parts.append(jax.block_until_ready(part))
            task.speed.note(len(part.rgb), time.perf_counter() - started)
            return
        self._waiting.pop(0)
        parts, self._done_parts = self._done_parts, []
        self.delivered += 1
        width, height = int(task.camera.widths[0]), int(task.camera.heights[0])
        self._finish(assemble(parts, width, height))


@runtime_checkable
class Runnable(Protocol):
    """Something with work to do, a chunk at a time."""

    def urgency(self) -> int:
        """0: nothing to do; 2: somebody waits for a first picture; 1: the rest."""
        ...

    def step(self) -> None:
        """Does one chunk of its work."""
        ...

    def failed(self, error: Exception) -> None:
        """Hears of an error in its own step."""
        ...
