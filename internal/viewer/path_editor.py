# SPDX-License-Identifier: Apache-2.0
"""The controls that make a camera path of places where the user stood."""

import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import viser

from internal.configs import RenderConfig
from internal.errors import UserError
from internal.rendering import paths
from internal.scene.scene import Scene
from internal.viewer import takes
from internal.viewer.handlers import Guard
from internal.viewer.stage import camera_of, move

MOST_FRAMES = 10_000


class PathEditor:
    """Keyframes of one browser: added, smoothed, previewed, saved."""

    def __init__(
        self,
        client: viser.ClientHandle,
        scene: Scene,
        render: RenderConfig,
        folder: Path,
        say: Callable[[str], None],
        guarded: Guard,
    ) -> None:
        """``folder`` takes the saved paths; ``say`` tells the user something."""
        self._client, self._scene, self._say = client, scene, say
        self._render, self._folder = render, folder
        self._keyframes: list[np.ndarray] = []
        self._stopped = threading.Event()  # of the last preview
        self._stopped.set()
        gui = client.gui
        self._count = gui.add_markdown(self._describe())
        buttons = {
            "Add keyframe here": self._add,
            "Remove the last": self._remove,
            "Smooth": self._smooth,
        }
        for label, handler in buttons.items():
            gui.add_button(label).on_click(guarded(handler))
        self._frames = gui.add_number("Frames", render.frames, min=2, max=MOST_FRAMES)
        gui.add_button("Preview / stop").on_click(guarded(self._play_or_stop))
        self._name = gui.add_text("Name", "path")
        gui.add_button("Save for render.py").on_click(guarded(self._save))

    def stop(self) -> None:
        """Ends a preview."""
        self._stopped.set()

    def _describe(self) -> str:
        return f"{len(self._keyframes)} keyframes; a path needs 2"

    async def _add(self, _: object) -> None:
        self._keyframes.append(camera_of(self._client.camera).camtoworld)
        self._count.content = self._describe()

    async def _remove(self, _: object) -> None:
        self._keyframes = self._keyframes[:-1]
        self._count.content = self._describe()

    async def _smooth(self, _: object) -> None:
        if len(self._keyframes) < 3:
            raise UserError("smoothing moves inner keyframes: add at least 3 first")
        self._keyframes = list(takes.smoothed(np.stack(self._keyframes)))
        self._say("smoothed: preview the path, or smooth it more")

    async def _play_or_stop(self, _: object) -> None:
        if not self._stopped.is_set():
            self.stop()
            return
        poses = self._path()
        self._stopped = threading.Event()
        play = threading.Thread(
            target=self._play, args=(poses, self._stopped), daemon=True
        )
        play.start()

    async def _save(self, _: object) -> None:
        path = takes.write_path(
            self._folder, self._name.value, self._scene, self._path(), self._render.fps
        )
        self._say(f"saved; render it with Render.path = {str(path)!r}")

    def _path(self) -> np.ndarray:
        if len(self._keyframes) < 2:
            raise UserError("add at least 2 keyframes first")
        return paths.through(np.stack(self._keyframes), int(self._frames.value))

    def _play(self, poses: np.ndarray, stopped: threading.Event) -> None:
        """Carries the browser's camera along a path, at the video's pace."""
        fov = self._client.camera.fov
        for pose in poses:
            move(self._client, pose, fov)
            if stopped.wait(1.0 / self._render.fps):
                return
        stopped.set()
