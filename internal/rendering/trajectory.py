# SPDX-License-Identifier: Apache-2.0
"""The cameras of a video: a path in the model's frame, seen through a scene's lens."""

import dataclasses
from pathlib import Path

import numpy as np

from internal.cameras import Cameras
from internal.configs import RenderConfig
from internal.rendering import paths
from internal.scene.scene import Scene


def path_cameras(scene: Scene, render: RenderConfig) -> Cameras:
    """Cameras along ``render.path`` with the lens and size of the first view.

    ``auto`` is a spiral for views that face one way, else ``around``.

    Raises:
        UserError: the path is no known name and no readable JSON file.
    """
    camtoworlds = np.asarray(scene.cameras.camtoworlds, np.float64)
    scale = scene.model_from_world.scale
    path = render.path
    if path == "auto":
        path = "spiral" if scene.space.faces_one_way else "around"
    if path == "spiral":
        near, far = scale * scene.near, scale * scene.far
        poses = paths.spiral(camtoworlds, near, far, render.frames)
    elif path == "ellipse":
        poses = paths.ellipse(camtoworlds, render.frames)
    elif path == "around":
        poses = paths.around(camtoworlds, render.frames)
    elif path == "views":
        poses = paths.along_views(camtoworlds, render.frames)
    else:
        poses = scene.model_from_world.poses(paths.read_poses(Path(path)))
    first = scene.cameras.take(np.zeros(len(poses), np.int32))
    return dataclasses.replace(first, camtoworlds=poses.astype(np.float32))
