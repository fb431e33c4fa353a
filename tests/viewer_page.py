# SPDX-License-Identifier: Apache-2.0
"""A page of the live viewer in a browser, used as a person uses it."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from internal.cli import load_split
from internal.configs import load_config
from internal.files import image_io
from internal.viewer import free_camera
from internal.viewer.baking import Bakery
from internal.viewer.panel import Panel
from internal.viewer.server import Server
from internal.viewer.session import Session
from internal.viewer.studio import Studio
from tests.browser import until

WIDTH, HEIGHT = 36, 32  # of photos and frames, so that they can be compared
SIZE = f"{WIDTH} x {HEIGHT}"
ZOOM = 16  # screen pixels per pixel of a frame
# Messages lie on the picture for a while.
CLICK_THROUGH = "[class*=Notification] { pointer-events: none !important }"
QUIET = 0.8  # seconds; a camera that is let go glides on for a while


class ViewerPage:
    """A running viewer, its first page, and what was sent to and fro."""

    def __init__(
        self, browser, run: Path, settings: list[str], splats: int = 0
    ) -> None:
        """``splats``: to walk on; 0 for none."""
        self.browser, self.folder = browser, run / "view"
        self.frames, self.cameras = [], []
        self._patches = pytest.MonkeyPatch()
        self._patches.setitem(free_camera.PIXELS, SIZE, WIDTH * HEIGHT)
        self._listen(Panel, "show", self.frames)
        self._listen(Session, "stand", self.cameras)
        config = load_config([], settings)
        self.studio = Studio(config, load_split(config, "train"))
        self.compiled_at_first = self.compiled()
        self.bakery = Bakery(self.studio, run, splats) if splats else None
        self.server = Server(config, self.studio, "127.0.0.1", 0, self.bakery)
        self.page = browser.new_page(viewport={"width": 900, "height": ZOOM * HEIGHT})
        self.page.goto(self.server.address)
        self.page.add_style_tag(content=CLICK_THROUGH)
        until(lambda: self.frames, "a first picture")
        beside = 900 - self._canvas().bounding_box()["width"]  # the panel
        viewport = {"width": round(ZOOM * WIDTH + beside), "height": ZOOM * HEIGHT}
        self.page.set_viewport_size(viewport)
        self.choose("Pixels", SIZE)
        until(lambda: self.frame.shape == (HEIGHT, WIDTH, 3), "the chosen size")
        self.settle()

    def close(self) -> None:
        """Ends the server, then the page."""
        self.server.close()
        self.page.close()
        self._patches.undo()

    def compiled(self) -> int:
        """How many programs the studio has for rendering and lighting."""
        renderers = self.studio._renderer, self.studio._draft_renderer
        programs: list[Any] = [
            program
            for renderer in renderers
            for program in (renderer._render_chunk, renderer._relight_chunk)
        ]
        return sum(program._cache_size() for program in programs)

    @property
    def frame(self) -> np.ndarray:
        """The newest picture that was sent, uint8."""
        return self.frames[-1].picture

    def control(self, label: str):
        """The input beside a label of the panel."""
        row = f'//label[.="{label}"]/ancestor::div[contains(@class, "Flex-root")][1]'
        return self.page.locator(row).locator("input:visible, textarea:visible").last

    def choose(self, label: str, wanted: str) -> None:
        """Picks from a dropdown."""
        self.control(label).click()
        self.page.get_by_role("option", name=wanted, exact=True).click()

    def type_in(self, label: str, value: str) -> None:
        """Types into the number beside a slider, or into a field."""
        self.control(label).fill(value)
        self.control(label).press("Enter")

    def press(self, button: str) -> None:
        """Presses a button of the panel."""
        self.page.get_by_role("button", name=button, exact=True).click()

    def open_tab(self, name: str) -> None:
        """Opens a tab of the panel."""
        self.page.get_by_role("tab", name=name).click()

    def start_over(self) -> None:
        """Neutral light and one whole picture, whatever was done before."""
        self.open_tab("Light")
        self.press("Reset the light")
        self.choose("Picture", "enhanced")
        self.choose("Beside it", "nothing")
        self.settle()

    def stand_at(self, name: str) -> None:
        """Goes to where a photo was taken."""
        self.open_tab("Photos")
        self.choose("Photo", name)
        self.press("Stand there")
        view = self.studio.scene.view_names.index(name)
        wanted = np.asarray(self.studio.scene.cameras.camtoworlds[view])

        def there():
            return np.abs(self.cameras[-1].camtoworld - wanted).max() < 1e-3

        until(there, f"the camera at {name}")
        self.settle()

    def reach(self) -> float:
        """How far from the browser's camera is what a drag turns about."""
        return self.page.evaluate("() => window.__viserMutable.cameraControl.distance")

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Drags from one place of the screen to another."""
        mouse = self.page.mouse
        mouse.move(*start)
        mouse.down()
        mouse.move(*end, steps=6)
        mouse.up()

    def settle(self) -> None:
        """Waits until the camera rests and a finished picture stays."""

        def rests():
            state = len(self.cameras), len(self.frames)
            time.sleep(QUIET)
            return state == (len(self.cameras), len(self.frames)) and (
                self.frames[-1].finished
            )

        until(rests, "a picture that stays")

    def snapshot(self) -> Path:
        """Takes a snapshot; returns its JSON."""
        before = set(self.folder.glob("snapshot_*.json"))
        self.press("Snapshot")
        until(lambda: set(self.folder.glob("snapshot_*.json")) > before, "a snapshot")
        (record,) = set(self.folder.glob("snapshot_*.json")) - before
        return record

    def drawn(self) -> np.ndarray:
        """What the browser draws, [HEIGHT, WIDTH, 3] sRGB in [0, 1]: the middles of
        the pixels, which it enlarges smoothly."""
        shot = self.folder.with_name("screen.png")
        hidden = ".mantine-Notifications-root { visibility: hidden }"
        clip = self._canvas().bounding_box()
        self.page.screenshot(path=str(shot), clip=clip, style=hidden)
        return self.middles(image_io.read_srgb(shot))

    @staticmethod
    def middles(screen: np.ndarray) -> np.ndarray:
        """The middle of what each pixel of a frame is on the screen."""
        blocks = screen.reshape(HEIGHT, ZOOM, WIDTH, ZOOM, 3)
        middle = slice(ZOOM // 2 - 1, ZOOM // 2 + 1)
        return blocks[:, middle, :, middle].mean(axis=(1, 3))

    def _canvas(self):
        return self.page.locator("canvas").first

    def _listen(self, owner: type, method: str, heard: list) -> None:
        """Notes the argument of every call of a method."""
        called = getattr(owner, method)

        def call(this, argument):
            called(this, argument)
            heard.append(argument)

        self._patches.setattr(owner, method, call)
