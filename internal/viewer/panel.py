# SPDX-License-Identifier: Apache-2.0
"""The panel beside the picture: what a user can set, and where each setting goes."""

import asyncio
import math
import threading
import time
from pathlib import Path
from typing import Any

import viser

from internal.configs import RenderConfig
from internal.enhancements.look import Look
from internal.viewer.baking import Bakery
from internal.viewer.border import Border
from internal.viewer.canvas import Split
from internal.viewer.free_camera import PIXELS
from internal.viewer.handlers import Guard, guard, on_change
from internal.viewer.light_controls import LightControls
from internal.viewer.output_chooser import OutputChooser
from internal.viewer.path_editor import PathEditor
from internal.viewer.session import Delivery, Session
from internal.viewer.stage import (
    Frustums,
    camera_of,
    look_at,
    make_gentle,
    move,
    turn_about,
)
from internal.viewer.studio import Studio
from internal.viewer.walk import Walk

MOSTLY = 0.5  # of a picture
STILL = 0.15  # seconds without a step after which one who walks on splats stands
FIRST = 2.0  # seconds at most that all else waits for the first picture
Click = tuple[float, tuple[float, float]]  # seconds, and where in the picture
HOW_TO_MOVE = (
    "**drag** to turn about the middle, **right-drag** or two fingers to move, "
    "**scroll** or pinch to come nearer, **W A S D** to walk, Q and E down and up, "
    "**double-click** to look at something. Click a photo's frame to stand where it "
    "was taken."
)
DOUBLE = 0.5, 0.02  # seconds and shares of the picture that two clicks are apart


def is_double(first: Click, second: Click) -> bool:
    """Whether two clicks are one double click."""
    moved = max(abs(a - b) for a, b in zip(first[1], second[1], strict=True))
    return second[0] - first[0] < DOUBLE[0] and moved < DOUBLE[1]


class Panel:
    """One browser's controls; everything they change belongs to that browser."""

    def __init__(
        self,
        client: viser.ClientHandle,
        studio: Studio,
        session: Session,
        render: RenderConfig,
        folder: Path,
        bakery: Bakery | None,
    ) -> None:
        """
        Args:
            folder: takes snapshots and paths.
            bakery: bakes splats to walk on; None where nobody does.
        """
        self._client, self._studio, self._session = client, studio, session
        self._frustums = Frustums(client, studio)
        self._click: Click = (-math.inf, (0.0, 0.0))
        self._border = Border(client, distance=self._frustums.size)
        gui, guarded = client.gui, guard(self.say)
        self._guarded, self._has_shown = guarded, threading.Event()
        gui.add_markdown(f"**{studio.scene.name}**: {HOW_TO_MOVE}")
        self._status = gui.add_markdown("waiting for the first picture ...")
        self._place = gui.add_markdown("")
        self._back = gui.add_button("Back to the nearest photo", visible=False)
        self._back.on_click(guarded(self._go_back))
        self.walk = Walk(client, bakery, session, guarded)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Light"):
            self._outputs = OutputChooser(
                client, studio.outputs, self._border, self._choose, guarded
            )
            self._light = LightControls(gui, self._relight, guarded)
            self._add_takes(guarded, folder)
        with tabs.add_tab("Photos"):
            self._add_photos(guarded)
        with tabs.add_tab("Path"):
            self._path = PathEditor(
                client, studio.scene, render, folder, self.say, guarded
            )
        self._choose(self._outputs.choice)
        on_scene_click: Any = client.scene.on_click()  # its type knows no coroutines
        on_scene_click(guarded(self._clicked))
        client.camera.on_update(guarded(self._camera_moved))
        make_gentle(client)
        first = camera_of(client.camera)
        client.camera.fov = studio.view_camera(0).seen_in(first.aspect).fov
        self._camera = camera_of(client.camera)
        session.stand(self._camera)

    def fill(self) -> None:
        """Sends what a first picture must not wait for: the photos' cameras, splats."""
        self._has_shown.wait(FIRST)
        self._frustums.add()
        for view, handle in enumerate(self._frustums.handles):

            async def clicked(_: object, view: int = view) -> None:
                self._photo.value = self._studio.scene.view_names[view]
                self._stand_at(view)

            handle.on_click(self._guarded(clicked))
        self._frustums.update(camera_of(self._client.camera))
        self.walk.open()

    def show(self, frame: Delivery) -> None:
        """Puts a frame on the screen, unless splats show more."""
        if self.walk.is_better_than(frame, self._camera):
            return
        self._client.scene.set_background_image(
            frame.picture, format="jpeg", jpeg_quality=90 if frame.finished else 75
        )
        self._has_shown.set()
        self._status.content = frame.describe()
        if frame.finished:
            self.walk.rest(frame)
            self._arrive(frame)

    def _arrive(self, frame: Delivery) -> None:
        """Turns about what is in the middle from now on, and says where this is."""
        now = camera_of(self._client.camera)
        if now.is_at(frame.camera):
            turn_about(self._client, frame.middle)
        view = self._studio.nearest_view(frame.camera.camtoworld)
        name = self._studio.scene.view_names[view]
        guessed = self._session.photographed() < MOSTLY
        self._back.visible = guessed
        self._place.content = f"nearest photo: {name}" + guessed * (
            "  \n**Most of this was not photographed: it is guessed.**"
        )

    def say(self, message: str) -> None:
        """Tells the user something."""
        self._client.add_notification("LLNeRF", message, auto_close_seconds=20.0)

    def close(self) -> None:
        """The browser has gone."""
        self._path.stop()
        self.walk.close()

    def _add_takes(self, guarded: Guard, folder: Path) -> None:
        gui, session = self._client.gui, self._session
        size = gui.add_dropdown("Pixels", list(PIXELS), initial_value=session.size)
        snapshot = gui.add_button("Snapshot")

        async def resize(_: object) -> None:
            session.refresh(size.value)

        async def take(_: object) -> None:
            session.snapshot(folder)

        on_change(guarded(resize), size)
        snapshot.on_click(guarded(take))

    def _add_photos(self, guarded: Guard) -> None:
        gui, names = self._client.gui, self._studio.scene.view_names
        shown = gui.add_checkbox("Show photos", initial_value=True)
        place = self._photo = gui.add_dropdown("Photo", list(names))
        go = gui.add_button("Stand there")
        gui.add_markdown("*The photo is then shown beside the picture, to compare.*")

        async def toggle(_: object) -> None:
            self._frustums.shown = shown.value
            self._frustums.update(camera_of(self._client.camera))

        async def stand(_: object) -> None:
            self._stand_at(names.index(place.value))

        on_change(guarded(toggle), shown)
        go.on_click(guarded(stand))

    def _stand_at(self, view: int) -> None:
        self._move_to(view)
        self._outputs.compare_with_photo()

    def _move_to(self, view: int) -> None:
        camera = self._studio.view_camera(view).seen_in(self._client.camera.aspect)
        move(self._client, camera.camtoworld, camera.fov)

    async def _go_back(self, _: object) -> None:
        here = camera_of(self._client.camera).camtoworld
        self._move_to(self._studio.nearest_view(here))

    async def _clicked(self, event: viser.SceneClickEvent) -> None:
        before, self._click = self._click, (time.monotonic(), event.screen_pos)
        if self._light.is_picking:
            self._light.pick(lambda: self._session.white_point(event.screen_pos))
        elif is_double(before, self._click):
            look_at(self._client, self._session.point_at(event.screen_pos))

    def _choose(self, choice: Split) -> None:
        self._session.choose(choice)
        self.walk.choose()

    def _relight(self, look: Look) -> None:
        if self._session.light(look):
            self.walk.light_anew()

    async def _camera_moved(self, handle: viser.CameraHandle) -> None:
        camera = self._camera = camera_of(handle)
        self._frustums.update(camera)
        self._border.place(camera, self._outputs.choice.split)
        if self.walk.go(camera):
            self._session.walk_past(camera)
            await asyncio.sleep(STILL)
            if camera is not self._camera:
                return
        self._session.stand(camera)
