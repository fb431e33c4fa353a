# SPDX-License-Identifier: Apache-2.0
"""The panel beside the picture: what a user can set, and where each setting goes."""

import functools
import threading
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import numpy as np
import viser

from internal import paths
from internal.configs import RenderConfig
from internal.editing import CONTRAST_RANGE, KELVIN_RANGE, TINT_RANGE
from internal.errors import UserError
from internal.looks import Look
from internal.pictures import EXPLANATIONS
from internal.viewer import takes
from internal.viewer.canvas import NOTHING, PHOTO, Choice
from internal.viewer.free_camera import PIXELS
from internal.viewer.session import Frame, Session
from internal.viewer.stage import Frustums, camera_of, move
from internal.viewer.studio import Studio

# Lowest, highest, step, label, hint.
SLIDERS = {
    "strength": (0.0, 1.0, 0.05, "Strength", "0: as photographed, 1: as learned"),
    "exposure": (-4.0, 4.0, 0.1, "Exposure", "stops"),
    "temperature": (
        KELVIN_RANGE[0], 15000.0, 100.0, "Kelvin",
        "colour of the light: 6500 leaves it, lower is warmer",
    ),
    "tint": (*TINT_RANGE, 0.05, "Tint", "green to magenta, stops"),
    "contrast": (*CONTRAST_RANGE, 0.05, "Contrast", "of the lighting"),
}  # fmt: skip
MOST_FRAMES = 10_000
EXPLANATION_OF_PHOTO = "the dark photo taken nearest to here, exact at its place"

Handler = Callable[[Any], Coroutine[Any, Any, None]]


class Panel:
    """One browser's controls; everything they change belongs to that browser."""

    def __init__(
        self,
        client: viser.ClientHandle,
        studio: Studio,
        session: Session,
        render: RenderConfig,
        folder: Path,
    ) -> None:
        self._client, self._studio, self._session = client, studio, session
        self._render, self._folder = render, folder
        self._keyframes: list[np.ndarray] = []
        self._playing = threading.Event()
        self._frustums = Frustums(client, studio)
        gui = client.gui
        gui.add_markdown(
            f"**{studio.scene.name}**: drag to turn, right-drag to move, scroll to "
            "come nearer. Click a photo's frame to stand where it was taken."
        )
        self._status = gui.add_markdown("waiting for the first picture ...")
        tabs = gui.add_tab_group()
        with tabs.add_tab("Light"):
            self._add_light()
        with tabs.add_tab("Photos"):
            self._add_photos()
        with tabs.add_tab("Path"):
            self._add_path()
        client.camera.on_update(self._guarded(self._camera_moved))
        session.stand(camera_of(client.camera))

    def show(self, frame: Frame) -> None:
        """Puts a frame on the screen."""
        self._client.scene.set_background_image(
            frame.picture, format="jpeg", jpeg_quality=90 if frame.finished else 75
        )
        self._status.content = frame.describe()

    def say(self, message: str) -> None:
        """Tells the user something."""
        self._client.add_notification("LLNeRF", message, auto_close_seconds=20.0)

    def close(self) -> None:
        """The browser has gone."""
        self._playing.clear()

    def _add_light(self) -> None:
        gui, session = self._client.gui, self._session
        outputs = list(EXPLANATIONS)
        if not self._studio.decomposed:
            outputs = ["dark", "depth"]
        left = gui.add_dropdown("Picture", [*outputs, PHOTO])
        right = gui.add_dropdown("Beside it", [NOTHING, *outputs, PHOTO])
        split = gui.add_slider("Split", 0.0, 1.0, 0.005, 0.5, visible=False)
        explanation = gui.add_markdown("")

        async def choose(_: object) -> None:
            texts = {**EXPLANATIONS, PHOTO: EXPLANATION_OF_PHOTO}
            split.visible = right.value != NOTHING
            shown = (
                [left.value] if right.value == NOTHING else [left.value, right.value]
            )
            explanation.content = "  \n".join(f"*{n}: {texts[n]}*" for n in shown)
            session.choose(Choice(left.value, right.value, split.value))

        self._on_change(choose, left, right, split)
        explanation.content = f"*{outputs[0]}: {EXPLANATIONS[outputs[0]]}*"

        neutral = Look()
        sliders = {
            name: gui.add_slider(
                label, low, high, step, float(getattr(neutral, name)), hint=hint
            )
            for name, (low, high, step, label, hint) in SLIDERS.items()
        }
        reset = gui.add_button("Reset the light")
        bindings = gui.add_text(
            "For gin", "", multiline=True, hint="this light's bindings, for render.py"
        )

        async def light(_: object) -> None:
            look = Look(
                **{name: float(slider.value) for name, slider in sliders.items()}
            )
            bindings.value = "\n".join(look.bindings())
            session.light(look)

        async def reset_light(_: object) -> None:
            for name, slider in sliders.items():
                slider.value = getattr(neutral, name)

        bindings.value = "\n".join(neutral.bindings())
        self._on_change(light, *sliders.values())
        reset.on_click(self._guarded(reset_light))

        size = gui.add_dropdown("Pixels", list(PIXELS), initial_value=session.size)
        snapshot = gui.add_button("Snapshot")

        async def resize(_: object) -> None:
            session.refresh(size.value)

        async def take(_: object) -> None:
            session.snapshot(self._folder)

        self._on_change(resize, size)
        snapshot.on_click(self._guarded(take))

    def _add_photos(self) -> None:
        gui, names = self._client.gui, self._studio.scene.view_names
        shown = gui.add_checkbox("Show photos", initial_value=True)
        place = gui.add_dropdown("Photo", list(names))
        go = gui.add_button("Stand there")

        async def toggle(_: object) -> None:
            self._frustums.shown = shown.value
            self._frustums.update(camera_of(self._client.camera))

        async def stand(_: object) -> None:
            self._stand_at(names.index(place.value))

        self._on_change(toggle, shown)
        go.on_click(self._guarded(stand))
        for view, handle in enumerate(self._frustums.handles):

            async def clicked(_: object, view: int = view) -> None:
                place.value = names[view]
                self._stand_at(view)

            handle.on_click(self._guarded(clicked))

    def _add_path(self) -> None:
        gui = self._client.gui
        count = gui.add_markdown("")
        add = gui.add_button("Add keyframe here")
        remove = gui.add_button("Remove the last")
        smooth = gui.add_button("Smooth", hint="less jitter of keyframes")
        frames = gui.add_number("Frames", self._render.frames, min=2, max=MOST_FRAMES)
        play = gui.add_button("Preview / stop")
        name = gui.add_text("Name", "path")
        save = gui.add_button("Save for render.py")

        def describe() -> None:
            count.content = f"{len(self._keyframes)} keyframes; a path needs 2"

        async def add_one(_: object) -> None:
            self._keyframes.append(camera_of(self._client.camera).camtoworld)
            describe()

        async def remove_one(_: object) -> None:
            self._keyframes = self._keyframes[:-1]
            describe()

        async def smooth_all(_: object) -> None:
            if self._keyframes:
                self._keyframes = list(takes.smoothed(np.stack(self._keyframes)))

        async def play_or_stop(_: object) -> None:
            if self._playing.is_set():
                self._playing.clear()
                return
            poses = self._path(int(frames.value))
            self._playing.set()
            threading.Thread(target=self._play, args=(poses,), daemon=True).start()

        async def save_path(_: object) -> None:
            poses = self._path(int(frames.value))
            scene, fps = self._studio.scene, self._render.fps
            path = takes.write_path(self._folder, name.value, scene, poses, fps)
            self.say(f"saved; render it with Render.path = {str(path)!r}")

        describe()
        add.on_click(self._guarded(add_one))
        remove.on_click(self._guarded(remove_one))
        smooth.on_click(self._guarded(smooth_all))
        play.on_click(self._guarded(play_or_stop))
        save.on_click(self._guarded(save_path))

    def _path(self, frames: int) -> np.ndarray:
        if len(self._keyframes) < 2:
            raise UserError("add at least 2 keyframes first")
        return paths.through(np.stack(self._keyframes), frames)

    def _play(self, poses: np.ndarray) -> None:
        """Carries the browser's camera along a path, at the video's pace."""
        fov, pace = self._client.camera.fov, threading.Event()
        for pose in poses:
            if not self._playing.is_set():
                return
            move(self._client, pose, fov)
            pace.wait(1.0 / self._render.fps)
        self._playing.clear()

    def _stand_at(self, view: int) -> None:
        camera = self._studio.view_camera(view)
        move(self._client, camera.camtoworld, camera.fov)

    async def _camera_moved(self, handle: viser.CameraHandle) -> None:
        camera = camera_of(handle)
        self._frustums.update(camera)
        self._session.stand(camera)

    def _on_change(self, handler: Handler, *inputs: Any) -> None:
        for control in inputs:
            control.on_update(self._guarded(handler))

    def _guarded(self, handler: Handler) -> Handler:
        """A handler whose errors are told to its own user and end nothing else."""

        @functools.wraps(handler)
        async def run(event: Any) -> None:
            try:
                await handler(event)
            except Exception as error:  # whatever a browser sends
                self.say(" ".join(str(error).split())[:300] or type(error).__name__)

        return run
