# SPDX-License-Identifier: Apache-2.0
"""The border between two outputs, as a bar in the picture that can be dragged."""

import numpy as np
import viser

from internal.viewer.free_camera import FreeCamera
from internal.viewer.stage import orientation

WIDTH = 0.012  # of the picture's; wide enough to be hit
OPACITY = 0.4


class Border:
    """A bar that stands before one browser's camera, wherever that goes."""

    def __init__(self, client: viser.ClientHandle, distance: float) -> None:
        """``distance`` from the camera, model units; what is nearer hides the bar."""
        self._distance = max(distance, 2.0 * client.camera.near)
        self.handle = client.scene.add_box(
            "/border", (255, 255, 255), (1.0, 1.0, 1.0), opacity=OPACITY,
            cast_shadow=False, receive_shadow=False, visible=False,
        )  # fmt: skip

    def place(self, camera: FreeCamera, split: float) -> None:
        """Puts a visible bar ``split`` of the picture's width from its left edge."""
        if not self.handle.visible:
            return
        half_height = self._distance * np.tan(camera.fov / 2.0)
        half_width = half_height * camera.aspect
        width = 2.0 * WIDTH * half_width
        ahead = [(2.0 * split - 1.0) * half_width, 0.0, -self._distance]
        self.handle.scale = (width, 2.0 * half_height, 0.01 * width)
        self.handle.wxyz = orientation(camera.camtoworld)
        self.handle.position = camera.camtoworld @ [*ahead, 1.0]


def split_at(screen_position: tuple[float, float]) -> float:
    """The share of the picture's width left of a place that was dragged to."""
    return min(max(float(screen_position[0]), 0.0), 1.0)
