# SPDX-License-Identifier: Apache-2.0
"""What all users of a viewer share: the scene, the newest model, the computer."""

import dataclasses
import functools
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float, UInt8

from internal import parallel
from internal.cameras import Cameras
from internal.color import from_uint16, to_uint8
from internal.configs import Config, ModelConfig
from internal.enhancements.look import NEUTRAL, LightEdit, Look
from internal.files import image_io
from internal.models import Model
from internal.rendering.evidence import explained_outputs
from internal.rendering.pictures import display_for
from internal.rendering.renderer import Renderer
from internal.scene import colmap
from internal.scene.scene import Scene
from internal.structs import LitRendering, Params, Rendering
from internal.training.checkpoints import Checkpoints, load_trained
from internal.viewer.chunked_jobs import Speedometer, Task
from internal.viewer.free_camera import (
    COARSE_PIXELS,
    FreeCamera,
    single_camera,
    vertical_fov,
)
from internal.viewer.inquiry import Inquiry
from internal.viewer.sharing import Turns
from internal.viewer.trained import Trained

THUMBNAIL_WIDTH = 64  # pixels
NEIGHBOURS = 12  # photos that are asked whether they show what is seen
# A chunk is the time nothing else happens in, so it is short; a call's overhead sets
# the lower limit.
LARGEST_CHUNK = 4096
FIRST_GUESS_OF_SPEED = 10_000.0  # rays per second, until there is a measurement
# A draft for a moving camera takes so many times fewer samples of each ray than were
# trained with. On LOM chair half of them are 40 dB from the whole; a third 35 dB, and
# half as fast again.
FEWER_SAMPLES = 2


class Studio:
    """Loads the newest checkpoint; ``update`` looks for a newer one."""

    def __init__(self, config: Config, scene: Scene) -> None:
        self._config = config
        self._mesh = parallel.data_mesh(jax.device_count())
        self.scene = scene
        self.turns = Turns()
        self.draft_speed = Speedometer(FIRST_GUESS_OF_SPEED)
        self.final_speed = Speedometer(FIRST_GUESS_OF_SPEED)
        self.model, state = load_trained(config, self._mesh)
        chunk = min(config.render.chunk, LARGEST_CHUNK)
        self.outputs = explained_outputs(config.model)
        self.inquiry = Inquiry(self, config.factor)
        view = scene.cameras, scene.space, self._mesh, chunk
        self._renderer = Renderer(self.model, *view)
        self._draft_renderer = Renderer(with_fewer_samples(config.model), *view)
        self.trained = self._trained(state.params, int(state.step))
        self._warm_up()

    def final(self, trained: Trained, camera: Cameras, edit: LightEdit) -> Task:
        """A picture as render.py makes it."""
        parts = self._renderer.parts(trained.params, camera, edit)
        return Task(camera, parts, self.final_speed)

    def draft(self, trained: Trained, camera: Cameras, edit: LightEdit) -> Task:
        """A quicker one, for a camera that moves."""
        parts = self._draft_renderer.parts(trained.params, camera, edit)
        return Task(camera, parts, self.draft_speed)

    def along_rays(self, look: Look) -> LightEdit:
        """The part of a look that rays must know while they are followed."""
        enhancement = self._config.model.enhancement
        return NEUTRAL if enhancement is None else enhancement.along_rays(look.edit())

    def relit(
        self, trained: Trained, rendering: Rendering | LitRendering, look: Look
    ) -> Rendering | LitRendering:
        """A rendering under ``along_rays(look)``, with the rest of the look."""
        if not isinstance(rendering, LitRendering):
            return rendering
        return self._renderer.relit(trained.params, rendering, look.edit())

    def view_camera(self, view: int) -> FreeCamera:
        """The user's camera at a photo's place."""
        lens = self.scene.lenses[view]
        pose = np.asarray(self.scene.cameras.camtoworlds[view], np.float64)
        return FreeCamera(pose, vertical_fov(lens), lens.width / lens.height)

    def nearest_view(self, camtoworld: Float[np.ndarray, "3 4"]) -> int:
        """The photo taken from the nearest place in the most similar direction."""
        poses = np.asarray(self.scene.cameras.camtoworlds)
        apart = np.linalg.norm(poses[:, :, 3] - camtoworld[:, 3], axis=-1)
        cosines = poses[:, :, 2] @ camtoworld[:, 2]
        return int(
            np.argmin(apart / self.spread() + np.arccos(np.clip(cosines, -1, 1)))
        )

    def photographed(
        self, points: Float[np.ndarray, "n 3"], camtoworld: Float[np.ndarray, "3 4"]
    ) -> float:
        """The share of points that one of the ``NEIGHBOURS`` photos taken nearest to a
        camera may show; what stands before them is not asked."""
        poses = np.asarray(self.scene.cameras.camtoworlds, np.float64)
        apart = np.linalg.norm(poses[:, :, 3] - camtoworld[:, 3], axis=-1)
        in_front = (camtoworld[:, 3] - points) @ camtoworld[:, 2] > 0.0
        seen = np.zeros(len(points), bool)
        for view in apart.argsort()[:NEIGHBOURS]:
            lens, pose = self.scene.lenses[view], poses[view]
            local = (points - pose[:, 3]) @ pose[:, :3]
            ahead = local[:, 2] < 0.0
            pixels = colmap.project(lens, np.where(ahead[:, None], local, [0, 0, -1]))
            inside = (pixels >= 0.0) & (pixels <= [lens.width, lens.height])
            seen |= ahead & inside.all(axis=-1)
        return float((seen & in_front).mean())

    def spread(self) -> float:
        """How far apart the photos were taken, model units."""
        centres = np.asarray(self.scene.cameras.camtoworlds)[:, :, 3]
        return float(np.sqrt(np.mean(np.var(centres, axis=0)))) or 1.0

    def focus_depth(self) -> float:
        """How far ahead of the first photo the scene's middle is, model units."""
        return float(np.median(self._first_draft().depth))

    @functools.cached_property
    def thumbnails(self) -> list[UInt8[np.ndarray, "height width 3"]]:
        """The photos, ``THUMBNAIL_WIDTH`` pixels wide."""
        sizes = [
            (THUMBNAIL_WIDTH, max(round(THUMBNAIL_WIDTH * x.height / x.width), 1))
            for x in self.scene.lenses
        ]
        return [
            to_uint8(image_io.resize_area(from_uint16(photo), *size))
            for photo, size in zip(self.scene.images, sizes, strict=True)
        ]

    def update(self) -> bool:
        """Loads a newer checkpoint, if there is one; whether there was.

        A checkpoint that disappears while it is read is left for the next time.
        """
        folder, kept = Path(self._config.checkpoint_dir), self._config.train
        with Checkpoints(folder, kept.checkpoints_kept) as checkpoints:
            newest = checkpoints.latest_step()
        if newest is None or newest <= self.trained.step:
            return False
        _, state = load_trained(self._config, self._mesh)
        self.trained = self._trained(state.params, int(state.step))
        return True

    def _warm_up(self) -> None:
        """Compiles what the first page would wait for."""
        self.relit(self.trained, self._first_draft(), Look())

    def _first_draft(self) -> Rendering | LitRendering:
        view = self.view_camera(0)
        camera = single_camera(view.camtoworld, view.lens(COARSE_PIXELS[0]))
        return self._draft_renderer.picture(self.trained.params, camera)

    def _trained(self, params: Params, step: int) -> Trained:
        lens = self.scene.lenses[0]
        camera = single_camera(np.asarray(self.scene.cameras.camtoworlds[0]), lens)
        rendering = self._renderer.picture(params, camera)
        return Trained(params, step, display_for(self._config.model, rendering))


def with_fewer_samples(config: ModelConfig) -> Model:
    """The same field, looked at ``FEWER_SAMPLES`` times less often along a ray."""
    fewer = tuple(max(n // FEWER_SAMPLES, 1) for n in config.num_samples)
    return Model(dataclasses.replace(config, num_samples=fewer))
