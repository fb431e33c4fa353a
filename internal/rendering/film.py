# SPDX-License-Identifier: Apache-2.0
"""A trained scene in one light, along the path of a video."""

import dataclasses
import functools

import numpy as np

from internal.cameras import Cameras
from internal.configs import Config
from internal.rendering import evidence
from internal.rendering.pictures import Display, Picture, display_for, pictures
from internal.rendering.renderer import Renderer
from internal.scene.scene import Scene
from internal.structs import LitRendering, Params, Rendering

# The result comes first; the others explain it.
OUTPUTS = ("enhanced", "dark", "v", "r", "depth", evidence.EVIDENCE)


@dataclasses.dataclass(frozen=True)
class Film:
    """A trained scene in one light, seen by the cameras of a path."""

    config: Config
    scene: Scene  # the training split
    cameras: Cameras
    renderer: Renderer  # of these cameras
    params: Params

    @functools.cached_property
    def outputs(self) -> dict[str, str]:
        """What each output is, in the order of ``OUTPUTS``."""
        explained = evidence.explained_outputs(self.config.model)
        return {name: explained[name] for name in OUTPUTS if name in explained}

    @functools.cached_property
    def display(self) -> Display:
        """Scales that suit the first photo's view, so all paths share them."""
        first = self.scene.cameras.take(np.array([0]))
        return display_for(self.config.model, self.look(first))

    @functools.cached_property
    def witnesses(self) -> evidence.Witnesses:
        """What the training cameras saw."""
        return evidence.call_witnesses(self.scene, self.config.factor, self.look)

    def look(self, camera: Cameras) -> Rendering | LitRendering:
        """What a single camera sees in the light as learned."""
        return self.renderer.picture(self.params, camera)

    def frame(self, number: int) -> dict[str, Picture]:
        """Every output of a frame, by name."""
        edit = self.config.render.edit()
        rendering = self.renderer.view(self.params, number, edit)
        pose = np.asarray(self.cameras.camtoworlds[number], np.float64)
        found = self.witnesses.testify(self.scene.lenses[0], pose, rendering)
        shown = pictures(rendering, self.display)
        return {**shown, evidence.EVIDENCE: evidence.false_colors(found)}
