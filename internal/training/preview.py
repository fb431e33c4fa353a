# SPDX-License-Identifier: Apache-2.0
"""Pictures of the first training view while training goes on, for TensorBoard."""

import jax
import numpy as np

from internal.models import Model
from internal.rendering.pictures import display_for, pictures
from internal.rendering.renderer import Renderer
from internal.scene.scene import Scene
from internal.structs import Params
from internal.training.run_folder import RunLog


class Preview:
    """Renders the first view. With several processes it does nothing: a picture
    would keep all of them waiting for one."""

    def __init__(
        self, model: Model, scene: Scene, mesh: jax.sharding.Mesh, chunk: int
    ) -> None:
        self._active = jax.process_count() == 1
        self._config = model.config
        if self._active:
            first = scene.cameras.take(np.array([0]))
            self._renderer = Renderer(model, first, scene.space, mesh, chunk)

    def write(self, log: RunLog, step: int, params: Params) -> None:
        """Adds every output of the view to the log."""
        if not self._active:
            return
        rendering = self._renderer.view(params, 0)
        display = display_for(self._config, rendering)
        for name, picture in pictures(rendering, display).items():
            log.picture(step, name, picture)
