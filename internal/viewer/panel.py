# SPDX-License-Identifier: Apache-2.0
"""The panel beside the picture: what a user can set, and where each setting goes."""

from pathlib import Path
from typing import Any

import viser

from internal.configs import RenderConfig
from internal.viewer.border import Border
from internal.viewer.free_camera import PIXELS
from internal.viewer.handlers import Guard, guard, on_change
from internal.viewer.light_controls import LightControls
from internal.viewer.output_chooser import OutputChooser
from internal.viewer.path_editor import PathEditor
from internal.viewer.session import Frame, Session
from internal.viewer.stage import Frustums, camera_of, move
from internal.viewer.studio import Studio


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
        """``folder`` takes snapshots and paths."""
        self._client, self._studio, self._session = client, studio, session
        self._frustums = Frustums(client, studio)
        self._border = Border(client, distance=self._frustums.size)
        gui, guarded = client.gui, guard(self.say)
        gui.add_markdown(
            f"**{studio.scene.name}**: drag to turn, right-drag to move, scroll to "
            "come nearer. Click a photo's frame to stand where it was taken."
        )
        self._status = gui.add_markdown("waiting for the first picture ...")
        tabs = gui.add_tab_group()
        with tabs.add_tab("Light"):
            self._outputs = OutputChooser(
                client, studio.outputs, self._border, session.choose, guarded
            )
            self._light = LightControls(gui, session.light, guarded)
            self._add_takes(guarded, folder)
        with tabs.add_tab("Photos"):
            self._add_photos(guarded)
        with tabs.add_tab("Path"):
            self._path = PathEditor(
                client, studio.scene, render, folder, self.say, guarded
            )
        session.choose(self._outputs.choice)
        on_scene_click: Any = client.scene.on_click()  # its type knows no coroutines
        on_scene_click(guarded(self._clicked))
        client.camera.on_update(guarded(self._camera_moved))
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
        self._path.stop()

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
        place = gui.add_dropdown("Photo", list(names))
        go = gui.add_button("Stand there")
        gui.add_markdown("*The photo is then shown beside the picture, to compare.*")

        async def toggle(_: object) -> None:
            self._frustums.shown = shown.value
            self._frustums.update(camera_of(self._client.camera))

        async def stand(_: object) -> None:
            self._stand_at(names.index(place.value))

        on_change(guarded(toggle), shown)
        go.on_click(guarded(stand))
        for view, handle in enumerate(self._frustums.handles):

            async def clicked(_: object, view: int = view) -> None:
                place.value = names[view]
                self._stand_at(view)

            handle.on_click(guarded(clicked))

    def _stand_at(self, view: int) -> None:
        camera = self._studio.view_camera(view)
        move(self._client, camera.camtoworld, camera.fov)
        self._outputs.compare_with_photo()

    async def _clicked(self, event: viser.SceneClickEvent) -> None:
        if self._light.is_picking:
            self._light.pick(lambda: self._session.white_point(event.screen_pos))

    async def _camera_moved(self, handle: viser.CameraHandle) -> None:
        camera = camera_of(handle)
        self._frustums.update(camera)
        self._border.place(camera, self._outputs.choice.split)
        self._session.stand(camera)
