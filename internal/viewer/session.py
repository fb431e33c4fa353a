# SPDX-License-Identifier: Apache-2.0
"""One user's view of the scene: what is wanted, what is computed, what is shown.

Handlers of a browser's messages call the setters from any thread; they only note
what is wanted. The thread that runs ``Turns`` calls ``step`` and does all the work.
"""

import collections
import dataclasses
import functools
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float, UInt8

from internal.cameras import Lens
from internal.color import from_uint16
from internal.coord import Space
from internal.enhancements.look import Look, same_edit
from internal.errors import UserError, one_line
from internal.rendering.evidence import EVIDENCE, false_colors
from internal.rendering.pictures import Picture, pictures
from internal.rendering.surfaces import surface_points
from internal.scene.colmap import directions_at, lens_directions
from internal.structs import LitRendering, Rendering
from internal.viewer import takes
from internal.viewer.canvas import PHOTO, Split, compose, photo_through
from internal.viewer.chunked_jobs import Series
from internal.viewer.free_camera import COARSE_PIXELS, PIXELS, FreeCamera, single_camera
from internal.viewer.sharing import Errand
from internal.viewer.studio import Studio
from internal.viewer.trained import Trained
from internal.viewer.white_point import make_gray

Point = Float[np.ndarray, " 3"]

SECONDS_TO_FIRST_PICTURE = 0.23
FRAMES_TIMED = 8
GRID = 8  # rays of a picture that are asked which photos show their ends


@dataclasses.dataclass(frozen=True)
class Delivery:
    """A picture for the browser and what is said about it."""

    picture: UInt8[np.ndarray, "height width 3"]
    number: int
    frames_per_second: float
    rays_per_second: float
    step: int
    finished: bool  # nothing finer follows
    camera: FreeCamera
    middle: Point  # on the camera's axis, as far ahead as what is seen there

    def describe(self) -> str:
        """One line for the panel."""
        height, width, _ = self.picture.shape
        state = "" if self.finished else ", refining"
        return (
            f"frame {self.number}: {width} x {height}{state}, "
            f"{self.frames_per_second:.1f} frames/s, "
            f"{self.rays_per_second:,.0f} rays/s, step {self.step}"
        )


@dataclasses.dataclass(frozen=True, eq=False)
class _Shown:
    """The last rendering, kept to be drawn again under other looks or choices."""

    rendering: Rendering | LitRendering
    camera: FreeCamera
    trained: Trained

    def pixel(self, place: tuple[float, float]) -> tuple[int, int]:
        """Row and column at shares of the width and height."""
        height, width, _ = self.rendering.rgb.shape
        row, column = int(place[1] * height), int(place[0] * width)
        return min(max(row, 0), height - 1), min(max(column, 0), width - 1)

    def middle(self, space: Space) -> Point:
        """What is in the middle; exactly there, whatever the pixels."""
        place, axis = self.camera.camtoworld[:, 3], self.camera.camtoworld[:, 2]
        (seen,) = self.points(space, [(0.5, 0.5)])
        return place - ((place - seen) @ axis) * axis

    def points(
        self, space: Space, places: Sequence[tuple[float, float]]
    ) -> Float[np.ndarray, "n 3"]:
        """Where the rays at places of the picture end."""
        height, width, _ = self.rendering.rgb.shape
        rows, columns = np.transpose([self.pixel(place) for place in places])
        pixels = np.stack([columns, rows], axis=-1) + 0.5
        seen = directions_at(self.camera.lens(width * height), pixels)
        depth = np.asarray(self.rendering.depth, np.float64)[rows, columns, 0]
        return surface_points(space, self.camera.camtoworld, seen, depth)


class Session:
    """Takes part in ``Turns``; calls ``show`` with pictures and ``say`` with errors."""

    def __init__(
        self,
        studio: Studio,
        show: Callable[[Delivery], None],
        say: Callable[[str], None],
    ) -> None:
        self._studio, self._show, self._say = studio, show, say
        self._lock = threading.Lock()
        self._wanted: FreeCamera | None = None
        self._job: Series | None = None
        self._redraw = False
        self._is_passing = False
        self._shown: _Shown | None = None
        self._relit = functools.lru_cache(maxsize=1)(
            lambda shown, look: studio.relit(shown.trained, shown.rendering, look)
        )
        self._times: collections.deque[float] = collections.deque(maxlen=FRAMES_TIMED)
        self._frames = 0
        self.camera: FreeCamera | None = None
        self.look = Look()
        self.choice = Split()
        self.size = "500 x 375"
        self.may_walk = False  # on something that is seen while there is no picture

    def stand(self, camera: FreeCamera) -> None:
        """Wants the scene from there."""
        with self._lock:
            if self.camera and camera.is_at(self.camera) and not self._is_passing:
                return
            self._is_passing = False
            self.camera = self._wanted = camera
        self._studio.turns.wake()

    @property
    def is_walking(self) -> bool:
        """Whether something is seen until a whole picture is there; a first picture,
        a coarse one, is there before."""
        return self.may_walk and self._shown is not None

    def walk_past(self, camera: FreeCamera) -> None:
        """Is there, and wants no picture yet."""
        with self._lock:
            self.camera, self._is_passing = camera, True
            self._wanted = self._job = None

    def light(self, look: Look) -> bool:
        """Wants that light; whether rays are followed anew, as they must know it."""
        look.edit()
        along_rays = self._studio.along_rays
        with self._lock:
            before, self.look = self.look, look
            is_anew = not same_edit(along_rays(before), along_rays(look))
            if not is_anew:
                self._redraw = True
            elif not self._is_passing:
                self._wanted = self.camera
        self._studio.turns.wake()
        return is_anew

    def choose(self, choice: Split) -> None:
        """Wants other outputs on the screen."""
        with self._lock:
            self.choice, self._redraw = choice, True
        self._studio.turns.wake()

    def white_point(self, place: tuple[float, float]) -> Look:
        """The light in which the lit scene is gray at a place of the picture.

        Args:
            place: shares of its width and height, from its upper left corner.

        Raises:
            UserError: no light does that, or the model has no light to turn.
        """
        shown, look = self._shown, self.look
        if shown is None or not isinstance(shown.rendering, LitRendering):
            raise UserError("there is no lit picture to pick from")
        row, column = shown.pixel(place)
        pixel = jax.tree.map(
            lambda x: x[row : row + 1, column : column + 1], shown.rendering
        )

        def lit(look: Look) -> Float[np.ndarray, " 3"]:
            relit = self._studio.relit(shown.trained, pixel, look)
            assert isinstance(relit, LitRendering)
            return np.asarray(relit.enhanced)[0, 0]

        return make_gray(lit, look)

    def point_at(self, place: tuple[float, float]) -> Point:
        """What is seen at a place of the picture, model frame.

        Raises:
            UserError: there is no picture yet.
        """
        if self._shown is None:
            raise UserError("there is no picture yet")
        return self._shown.points(self._studio.scene.space, [place])[0]

    def photographed(self) -> float:
        """The share of the picture that lies before the lens of a photo near by."""
        if self._shown is None:
            return 1.0
        across = (np.arange(GRID) + 0.5) / GRID
        places = [(x, y) for y in across for x in across]
        points = self._shown.points(self._studio.scene.space, places)
        return self._studio.photographed(points, self._shown.camera.camtoworld)

    def redraw(self) -> None:
        """Wants the same picture again, with what is known now."""
        with self._lock:
            self._redraw = True
        self._studio.turns.wake()

    def refresh(self, size: str = "") -> None:
        """Wants the same again: at another of ``PIXELS``, or by a newer model."""
        with self._lock:
            self.size = size or self.size
            self._wanted = self.camera
        self._studio.turns.wake()

    def snapshot(self, folder: Path) -> None:
        """Wants a PNG of the left output, as render.py makes it, and its settings."""
        trained, look, output = self._studio.trained, self.look, self.choice.left
        if self.camera is None or output == PHOTO:
            self._say("a snapshot shows a rendering: choose another picture first")
            return
        lens = self._studio.scene.lenses[0]
        pose, edit = self.camera.camtoworld, look.edit()

        def write(rendering: Rendering | LitRendering) -> None:
            shot = takes.Snapshot(pose, look, output, trained.step)
            shown = pictures(rendering, trained.display)
            if output == EVIDENCE:
                shown |= self._evidence(lens, pose, rendering, trained)
            picture = shown.get(output, shown["dark"])
            path = takes.write_snapshot(folder, shot, self._studio.scene, picture)
            self._say(f"saved {path} and, beside it, {path.stem}.json for render.py")

        task = self._studio.final(trained, single_camera(pose, lens), edit)
        job = Series([task], write)
        Errand(job, self._studio.turns, self._say)

    def urgency(self) -> int:
        """See ``chunked_jobs.Runnable``."""
        with self._lock:
            job = self._job
            if self._redraw or self._wanted or (job and not job.delivered):
                return 2
            return int(bool(job and not job.done))

    def step(self) -> None:
        """Draws again, or computes a chunk of the newest picture.

        A first, coarse picture is always finished, so that a moving camera sees
        something; what refines it is dropped as soon as the camera moves. Who walks
        on something else sees enough without.
        """
        with self._lock:
            redraw, self._redraw = self._redraw, False
            job = self._job
            may_start = job is None or job.delivered or self.is_walking
            if not redraw and self._wanted and may_start:
                job = self._job = self._start(self._wanted, self.look)
                self._wanted = None
        if redraw:
            self._draw(finished=job is None or job.done)
        elif job and not job.done:
            job.step()

    def failed(self, error: Exception) -> None:
        """Drops what could not be computed and says why."""
        with self._lock:
            self._job, self._wanted, self._redraw = None, None, False
        self._say(one_line(error))

    def _start(self, camera: FreeCamera, look: Look) -> Series:
        """Renders from there: as fine as is quick, then finer up to the wanted size."""
        studio, full = self._studio, PIXELS[self.size]
        trained, edit = studio.trained, studio.along_rays(look)
        quick = studio.draft_speed.rays_per_second * SECONDS_TO_FIRST_PICTURE
        drafts = [pixels for pixels in COARSE_PIXELS if pixels < full]
        drafts = drafts[max(sum(pixels <= quick for pixels in drafts) - 1, 0) :]
        is_fast = full <= studio.final_speed.rays_per_second * SECONDS_TO_FIRST_PICTURE
        if is_fast or self.is_walking:
            drafts = []
        *lenses, last = dict.fromkeys(camera.lens(n) for n in (*drafts, full))
        *coarse, fine = (single_camera(camera.camtoworld, x) for x in (*lenses, last))
        tasks = [studio.draft(trained, seen, edit) for seen in coarse]
        tasks.append(studio.final(trained, fine, edit))

        def finish(rendering: Rendering | LitRendering) -> None:
            self._shown = _Shown(rendering, camera, trained)
            self._times.append(time.perf_counter())
            self._frames += 1
            self._draw(finished=rendering.rgb.shape[:2] == (last.height, last.width))

        return Series(tasks, finish)

    def _draw(self, finished: bool) -> None:
        shown = self._shown
        if shown is None:
            return
        lit = self._relit(shown, self.look)
        others = self._others(shown, self.choice)
        picture = compose(lit, shown.trained.display, self.choice, others)
        times = self._times
        elapsed = times[-1] - times[0]
        frames_per_second = (len(times) - 1) / elapsed if elapsed > 0.0 else 0.0
        rays_per_second = self._studio.draft_speed.rays_per_second
        step = shown.trained.step
        frame = Delivery(
            picture, self._frames, frames_per_second, rays_per_second, step, finished,
            shown.camera, shown.middle(self._studio.scene.space),
        )  # fmt: skip
        self._show(frame)

    def _others(self, shown: _Shown, choice: Split) -> dict[str, Picture]:
        """What is chosen and no part of a rendering."""
        height, width, _ = shown.rendering.rgb.shape
        lens, pose = shown.camera.lens(width * height), shown.camera.camtoworld
        others: dict[str, Picture] = {}
        if PHOTO in (choice.left, choice.right):
            others[PHOTO] = self._photo(lens, pose)
        if EVIDENCE in (choice.left, choice.right):
            others |= self._evidence(lens, pose, shown.rendering, shown.trained)
        return others

    def _photo(self, lens: Lens, pose: Float[np.ndarray, "3 4"]) -> Picture:
        """The photo taken nearest to where the user stands, seen through the window."""
        scene = self._studio.scene
        view = self._studio.nearest_view(pose)
        rotation = np.asarray(scene.cameras.camtoworlds[view][:, :3], np.float64)
        return photo_through(
            from_uint16(scene.images[view]),
            scene.lenses[view],
            rotation.T @ pose[:, :3],
            lens_directions(lens),
            lens,
        )

    def _evidence(
        self,
        lens: Lens,
        pose: Float[np.ndarray, "3 4"],
        rendering: Rendering | LitRendering,
        trained: Trained,
    ) -> dict[str, Picture]:
        """The evidence by its name; nothing while the photos are being asked."""
        witnesses = self._studio.inquiry.witnesses(trained, self.redraw, self._say)
        if witnesses is None:
            return {}
        return {EVIDENCE: false_colors(witnesses.testify(lens, pose, rendering))}
