# SPDX-License-Identifier: Apache-2.0
"""Splats on a browser's own GPU while its camera moves, the field's picture at rest.

viser draws splats over the background, which is where the field's pictures are, in
the colours that it is given; ours are fitted over black, so it is black under them.
"""

import threading

import jax.numpy as jnp
import numpy as np
import viser

from internal.enhancements.look import Look
from internal.errors import one_line
from internal.export.splats import Splats, rotations
from internal.viewer.baking import Bakery, Walkable
from internal.viewer.canvas import NOTHING, Split
from internal.viewer.free_camera import FreeCamera
from internal.viewer.handlers import Guard, on_change
from internal.viewer.session import Delivery, Session
from internal.viewer.stage import run_on_page

# A picture is on the screen so many seconds after it was sent; splats hide it until
# then, so that nothing flashes.
ARRIVAL = 0.2
SIZE = 0.5  # standard deviation that sizes are brought to: viser keeps 16-bit variances
BLACK = np.zeros((1, 1, 3), np.uint8)
NODE = "/splats"
BAKE = "Bake splats to walk on"
WALK = "Splats while moving"
WHY = (
    "Off: small pictures of the field. Turns itself off once in a browser that draws "
    "splats slowly, as one without a graphics card does."
)
SLOW, OFTEN = 300.0, 3  # milliseconds between pictures, in so many of them on end
WATCH = """
if (!window.walkIsWatched) {{
  window.walkIsWatched = true;
  let before = null, late = 0;
  const watch = (now) => {{
    const nodes = window.__viserSceneTree?.getState();
    const isSeen = nodes?.["{node}"]?.effectiveVisibility && !document.hidden;
    late = isSeen && before !== null && now - before > {slow} ? late + 1 : 0;
    before = isSeen ? now : null;
    const labels = late < {often} ? [] : [...document.querySelectorAll("label")];
    const choice = labels.find((label) => label.textContent.trim() === "{walk}");
    if (choice) choice.click();
    else requestAnimationFrame(watch);
  }};
  requestAnimationFrame(watch);
}}
"""


class Walk:
    """The splats of one browser. Takes part in ``Turns``, where they are coloured."""

    def __init__(
        self,
        client: viser.ClientHandle,
        bakery: Bakery | None,
        session: Session,
        guarded: Guard,
    ) -> None:
        """``bakery``: None where nobody walks on splats."""
        self._client, self._bakery, self._session = client, bakery, session
        self._lock = threading.RLock()
        self._walkable: Walkable | None = None
        self._handle: viser.GaussianSplatHandle | None = None
        self._look: Look | None = None  # that the splats have
        self._hiding: threading.Timer | None = None
        self._frame: Delivery | None = None  # the last one behind which they hid
        self._button = client.gui.add_button(BAKE, visible=False)
        self._walks = client.gui.add_checkbox(WALK, True, visible=False, hint=WHY)
        self._text = client.gui.add_markdown("", visible=False)
        self._button.on_click(guarded(self._bake))
        on_change(guarded(self._decide), self._walks)
        if bakery:
            bakery.listen(self._hear)

    def open(self) -> None:
        """Sends what the bakery has already."""
        if self._bakery:
            self._hear()

    def go(self, camera: FreeCamera) -> bool:
        """Shows the splats unless the picture is of that place; whether they are
        seen."""
        with self._lock:
            if self._handle is None or not self._session.is_walking:
                return False
            if not self._handle.visible:
                if self._frame and self._frame.camera.looks_like(camera):
                    return False
                with self._client.atomic():
                    self._handle.visible = True
                    self._client.scene.set_background_image(BLACK)
            self._stop_hiding()
            return True

    def light_anew(self) -> None:
        """Shows the splats in the newest light: the picture that has it takes long."""
        self._frame = None
        if self._session.camera:
            self.go(self._session.camera)

    def is_better_than(self, frame: Delivery, camera: FreeCamera) -> bool:
        """Whether the splats, seen now, show more of what is there than a frame."""
        with self._lock:
            is_seen = self._handle is not None and self._handle.visible
            return is_seen and not (frame.finished and frame.camera.looks_like(camera))

    def rest(self, frame: Delivery) -> None:
        """Hides the splats behind a finished frame that was just sent."""
        with self._lock:
            self._frame = frame
            if self._handle and self._handle.visible:
                self._stop_hiding()
                self._hiding = threading.Timer(ARRIVAL, self._hide)
                self._hiding.start()

    def choose(self) -> None:
        """Knows of the session's choice; what splats cannot show hides them."""
        with self._lock:
            shown = look_shown(self._session.choice, self._session.look)
            can_walk = self._handle is not None and shown is not None
            self._session.may_walk = can_walk and self._walks.value
            if not self._session.may_walk:
                self._hide()

    def urgency(self) -> int:
        """See ``chunked_jobs.Runnable``."""
        wanted = look_shown(self._session.choice, self._session.look)
        return 2 * (self._handle is not None and wanted not in (None, self._look))

    def step(self) -> None:
        """Colours the splats in the newest look."""
        with self._lock:
            walkable, handle = self._walkable, self._handle
            look = look_shown(self._session.choice, self._session.look)
        if walkable and handle and look:
            self._look = look
            handle.rgbs = walkable.recolor(look)

    def failed(self, error: Exception) -> None:
        """Says why they have no colours."""
        self._say(f"splats: {one_line(error)}")

    def close(self) -> None:
        """The browser has gone."""
        if self._bakery:
            self._bakery.forget(self._hear)
        self._stop_hiding()

    async def _bake(self, _: object) -> None:
        if self._bakery:
            self._bakery.start()

    async def _decide(self, _: object) -> None:
        self.choose()

    def _hear(self) -> None:
        """What is new in the bakery."""
        assert self._bakery is not None
        walkable, share = self._bakery.walkable, self._bakery.share
        if walkable is not self._walkable:
            self._take(walkable)
        self._button.visible, self._walks.visible = walkable is None, bool(walkable)
        self._button.disabled = share is not None
        percent = f"{100.0 * share:.0f} %" if share is not None else ""
        label = f"Baking splats to walk on: {percent}" if percent else BAKE
        if self._button.label != label:
            self._button.label = label
        if walkable:
            count = len(walkable.baked.splats)
            self._say(f"*while you move: {count:,} splats, drawn by your computer*")
        else:
            self._say(self._bakery.failure)

    def _take(self, walkable: Walkable | None) -> None:
        with self._lock:
            self._stop_hiding()
            if self._handle:
                self._handle.remove()
            self._walkable, self._handle, self._look = walkable, None, None
            if walkable:
                colors = walkable.recolor(walkable.baked.look)
                self._handle = add(self._client, walkable.baked.splats, colors)
                self._look = walkable.baked.look
                watch = WATCH.format(node=NODE, walk=WALK, slow=SLOW, often=OFTEN)
                run_on_page(self._client, watch)
            self.choose()

    def _say(self, text: str) -> None:
        if self._text.content != text:
            self._text.content, self._text.visible = text, bool(text)

    def _stop_hiding(self) -> None:
        if self._hiding:
            self._hiding.cancel()

    def _hide(self) -> None:
        with self._lock:
            if self._handle:
                self._handle.visible = False


def look_shown(choice: Split, look: Look) -> Look | None:
    """The look in which splats show what is chosen; None if they cannot."""
    if choice.right != NOTHING:
        return None
    return {"enhanced": look, "dark": Look(strength=0.0)}.get(choice.left)


def add(
    client: viser.ClientHandle, splats: Splats, colors: np.ndarray
) -> viser.GaussianSplatHandle:
    """Hidden splats in a browser; colours are uint8 ``[n, 3]``."""
    scales = np.exp(np.asarray(splats.log_scales, np.float64))
    zoom = SIZE / float(np.median(scales))
    axes = np.asarray(rotations(jnp.asarray(splats.quaternions)), np.float64)
    axes = axes * (zoom * scales)[:, None]
    return client.scene.add_gaussian_splats(
        NODE,
        centers=zoom * np.asarray(splats.points),
        covariances=axes @ axes.swapaxes(1, 2),
        rgbs=colors,
        opacities=np.asarray(splats.opacities)[:, None],
        scale=1.0 / zoom,
        visible=False,
    )
