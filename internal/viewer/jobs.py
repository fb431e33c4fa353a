# SPDX-License-Identifier: Apache-2.0
"""Pictures that are computed a chunk at a time, coarse before fine.

A job belongs to one session. Whoever runs jobs calls ``step`` until it is done and
may stop at any time; between two steps nothing is running.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, runtime_checkable

import jax

from internal.cameras import Cameras
from internal.models import LitRendering, Rendering
from internal.renderer import assemble

Parts = Iterator[Rendering | LitRendering]
StartParts = Callable[[Cameras], Parts]
Finish = Callable[[Rendering | LitRendering], None]


class Speedometer:
    """Rays per second lately, over all jobs."""

    def __init__(self, rays_per_second: float) -> None:
        self.rays_per_second = rays_per_second

    def note(self, rays: int, seconds: float) -> None:
        """Takes a measurement into the running mean."""
        rate = rays / max(seconds, 1e-6)
        self.rays_per_second += 0.3 * (rate - self.rays_per_second)


class Job:
    """Renders each of ``cameras`` in turn and hands every whole picture over."""

    def __init__(
        self,
        cameras: Sequence[Cameras],
        start_parts: StartParts,
        finish: Finish,
        speed: Speedometer,
    ) -> None:
        self._waiting = list(cameras)
        self._start_parts = start_parts
        self._finish = finish
        self._speed = speed
        self._done_parts: list[Rendering | LitRendering] = []
        self._parts: Parts = iter(())
        self.delivered = 0  # whole pictures so far
        self._begin()

    @property
    def done(self) -> bool:
        """Whether every picture was handed over."""
        return not self._waiting

    def step(self) -> None:
        """Computes one chunk; at the end of a picture hands it over."""
        started = time.perf_counter()
        part = next(self._parts, None)
        if part is not None:
            self._done_parts.append(jax.block_until_ready(part))
            self._speed.note(len(part.rgb), time.perf_counter() - started)
            return
        camera = self._waiting.pop(0)
        self.delivered += 1
        self._finish(assemble(self._done_parts, camera))
        self._begin()

    def _begin(self) -> None:
        self._done_parts = []
        if self._waiting:
            self._parts = self._start_parts(self._waiting[0])


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
