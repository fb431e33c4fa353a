# SPDX-License-Identifier: Apache-2.0
"""Asks what each photo saw of a model, once somebody wants to see the evidence."""

import threading
from collections.abc import Callable
from typing import Protocol, runtime_checkable

from internal.cameras import Cameras
from internal.enhancements.look import NEUTRAL, LightEdit
from internal.rendering import evidence
from internal.scene.scene import Scene
from internal.structs import LitRendering, Rendering
from internal.viewer.chunked_jobs import Series, Task
from internal.viewer.sharing import Errand, Turns
from internal.viewer.trained import Trained


@runtime_checkable
class StudioNeeds(Protocol):
    """What is needed of a studio."""

    scene: Scene
    turns: Turns

    def final(self, trained: Trained, camera: Cameras, edit: LightEdit) -> Task:
        """A picture as render.py makes it."""
        ...


class Inquiry:
    """The witnesses of the newest model that somebody asked about."""

    def __init__(self, renderer: StudioNeeds, factor: int) -> None:
        """``factor``: how many pixels of a photo's side are one of the scene's."""
        self._renderer, self._factor = renderer, factor
        self._lock = threading.Lock()
        self._step: int | None = None  # of the model that was asked about
        self._found: evidence.Witnesses | None = None
        self._waiting: list[Callable[[], None]] = []

    def witnesses(
        self,
        trained: Trained,
        ready: Callable[[], None],
        say: Callable[[str], None],
    ) -> evidence.Witnesses | None:
        """Those of a model, or None while they are being asked.

        Args:
            ready: called when they have answered.
            say: told that they are asked, or why they cannot be.
        """
        with self._lock:
            if self._step == trained.step:
                if self._found is None and ready not in self._waiting:
                    self._waiting.append(ready)
                return self._found
            self._step, self._found = trained.step, None
            self._waiting.append(ready)
        say("evidence: asking what each photo saw; until then the dark picture is seen")
        self._ask(trained, say)
        return None

    def _ask(self, trained: Trained, say: Callable[[str], None]) -> None:
        cameras = evidence.witness_cameras(self._renderer.scene)
        answers: list[Rendering | LitRendering] = []

        def hear(rendering: Rendering | LitRendering) -> None:
            answers.append(rendering)
            if len(answers) == len(cameras):
                self._conclude(trained, answers)

        tasks = [self._renderer.final(trained, camera, NEUTRAL) for camera in cameras]
        Errand(Series(tasks, hear), self._renderer.turns, say)

    def _conclude(
        self, trained: Trained, answers: list[Rendering | LitRendering]
    ) -> None:
        found = evidence.gather(self._renderer.scene, self._factor, answers)
        with self._lock:
            if self._step == trained.step:  # else a newer model is asked about
                self._found = found
                waiting, self._waiting = self._waiting, []
            else:
                waiting = []
        for ready in waiting:
            ready()
