# SPDX-License-Identifier: Apache-2.0
"""Bakes splats of the model that is shown, between the pictures that people wait for.

One bake serves all pages. Its views are small and its splats few: it is there to walk
on, and the field's picture follows at rest; ``export.py`` bakes larger ones, which are
taken instead where a run has them.
"""

import contextlib
import dataclasses
import threading
from collections.abc import Callable, Generator
from pathlib import Path

import jax
import numpy as np

from internal.enhancements.look import NEUTRAL, Look
from internal.errors import UserError, one_line
from internal.export import bake
from internal.export.density import make_density
from internal.export.sightings import (
    Sighting,
    between_views,
    sighting_of,
    undistorted,
)
from internal.rendering.evidence import shrink
from internal.rendering.renderer import assemble
from internal.scene.masks import resize_mask
from internal.scene.scene import Scene, posed_cameras
from internal.viewer.lit_splats import Baked, Recolor, exported, recolorer
from internal.viewer.studio import Studio
from internal.viewer.trained import Trained

LOOK = "enhanced"
VIEW_PIXELS = 160 * 120  # of the pictures that splats are fitted to
CELLS = 160.0  # of the scene's side: details that normals may have

Steps = Generator[float, None, "Walkable"]  # yields the share that is done


@dataclasses.dataclass(frozen=True, eq=False)
class Walkable:
    """Splats that can be shown."""

    baked: Baked
    recolor: Recolor


class Bakery:
    """The splats of the newest model. Takes part in ``Turns``."""

    def __init__(self, studio: Studio, run: Path, count: int) -> None:
        """
        Args:
            run: the folder that export.py may have exported to.
            count: splats at most that are baked here.
        """
        self._studio, self._run, self._count = studio, run, count
        self._lock = threading.Lock()
        self._steps: Steps | None = None
        self._listeners: list[Callable[[], None]] = []
        self.share: float | None = None  # that is done of the bake in progress
        self.failure = ""  # why there are none
        self.walkable: Walkable | None = None

    def listen(self, hear: Callable[[], None]) -> None:
        """Calls ``hear`` from now on whenever anything is new."""
        with self._lock:
            self._listeners.append(hear)

    def forget(self, hear: Callable[[], None]) -> None:
        """The opposite of ``listen``."""
        with self._lock:
            self._listeners.remove(hear)

    def start(self) -> None:
        """Begins to bake the model that is shown, unless that is in progress."""
        with self._lock:
            if self._steps:
                return
            self._steps = self._prepare(self._studio.trained)
        self._now(0.0)
        self._studio.turns.join(self)

    def outdated(self) -> None:
        """Drops everything: another model is shown now."""
        self._end(None)

    def urgency(self) -> int:
        """See ``chunked_jobs.Runnable``."""
        return 1

    def step(self) -> None:
        """Bakes a little."""
        steps = self._steps
        if steps is None:
            return
        try:
            self._now(next(steps))
        except StopIteration as end:
            self._end(end.value)

    def failed(self, error: Exception) -> None:
        """Gives up and says why."""
        self._end(None, one_line(error))

    def _now(self, share: float | None) -> None:
        with self._lock:
            self.share = share
            listeners = list(self._listeners)
        for hear in listeners:
            with contextlib.suppress(Exception):  # its page has gone meanwhile
                hear()

    def _end(self, walkable: Walkable | None, failure: str = "") -> None:
        self._studio.turns.leave(self)
        self._steps, self.walkable, self.failure = None, walkable, failure
        self._now(None)

    def _prepare(self, trained: Trained) -> Steps:
        scene = self._studio.scene
        baked = exported(self._run, scene)
        if baked is None or baked.step != trained.step:
            baked = yield from self._bake(trained)
        recolor = recolorer(
            self._studio.model,
            trained.params,
            scene.space,
            np.asarray(scene.cameras.camtoworlds, np.float64)[:, :, 3],
            baked,
        )
        recolor(baked.look)  # compiles it before somebody waits
        return Walkable(baked, recolor)

    def _bake(self, trained: Trained) -> Generator[float, None, Baked]:
        scene = small(self._studio.scene)
        middle = between_views(scene)
        views = len(scene.lenses), len(middle.lenses)
        total = sum(views) + bake.STEPS
        seen: list[Sighting] = []
        for part in (scene, middle):
            for view in range(len(part.lenses)):
                camera = part.cameras.take(np.array([view]))
                task = self._studio.final(trained, camera, NEUTRAL)
                chunks = []
                for chunk in task.parts:
                    chunks.append(jax.block_until_ready(chunk))
                    yield len(seen) / total
                lens = part.lenses[view]
                rendering = assemble(chunks, lens.width, lens.height)
                seen.append(sighting_of(part, view, rendering))
        if not any(sighting.is_surface.any() for sighting in seen):
            raise UserError(
                "no splats to walk on: the model knows no surface yet; train it for "
                "longer"
            )
        density = make_density(self._studio.model, trained.params, 1.0 / CELLS)
        splats = bake.place(scene, seen[: views[0]], density, self._count, LOOK)
        targets = bake.targets_of(scene, seen, LOOK)
        fitted = bake.fit_splats(splats, targets, bake.STEPS, bake.RATES)
        for number, fit in enumerate(fitted):
            splats = fit
            yield (len(seen) + number) / total
        return Baked(bake.without_faint(splats), Look(), trained.step)


def small(scene: Scene) -> Scene:
    """The scene through pinholes of at most ``VIEW_PIXELS`` pixels."""
    whole = undistorted(scene)
    lenses = tuple(shrink(lens, VIEW_PIXELS) for lens in whole.lenses)
    masks = tuple(
        resize_mask(mask, lens.width, lens.height)
        for mask, lens in zip(scene.masks, lenses, strict=False)
    )
    cameras = posed_cameras(lenses, np.asarray(scene.cameras.camtoworlds))
    return dataclasses.replace(whole, lenses=lenses, cameras=cameras, masks=masks)
