# SPDX-License-Identifier: Apache-2.0
"""What a user takes home from the viewer: snapshots and camera paths.

Files hold poses in the frame of the scene's pose file, as render.py reads them.
"""

import dataclasses
import re
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from internal.enhancements.look import Look
from internal.errors import UserError
from internal.files import image_io
from internal.files.atomic import ensure_folder
from internal.rendering import paths
from internal.rendering.pictures import Picture
from internal.scene.scene import Scene

SNAPSHOT = re.compile(r"snapshot_(\d+)\.json")

Poses = Float[np.ndarray, "n 3 4"]


@dataclasses.dataclass(frozen=True)
class Snapshot:
    """What decides a snapshot's pixels, beside the model."""

    camtoworld: Float[np.ndarray, "3 4"]  # model frame
    look: Look
    output: str
    step: int


def write_snapshot(
    folder: Path,
    shot: Snapshot,
    scene: Scene,
    picture: Picture,
) -> Path:
    """Writes the next ``snapshot_N.png`` and a JSON of its name; returns the PNG.

    The JSON is a camera path of one pose, so it can be given to render.py; it also
    states the output, the training step and the light's gin bindings.
    """
    ensure_folder(folder)
    names = (SNAPSHOT.fullmatch(path.name) for path in folder.iterdir())
    taken = [int(name[1]) for name in names if name]
    path = folder / f"snapshot_{max(taken, default=0) + 1:03d}.png"
    facts = {
        "output": shot.output,
        "step": shot.step,
        "gin_bindings": [
            f"Render.path = {str(path.with_suffix('.json'))!r}",
            *shot.look.bindings(),
        ],
    }
    image_io.write(path, picture)
    world = in_world(scene, shot.camtoworld[None])
    paths.write_poses(path.with_suffix(".json"), world, fps=1, facts=facts)
    return path


def write_path(
    folder: Path, name: str, scene: Scene, camtoworlds: Poses, fps: int
) -> Path:
    """Writes ``NAME.json`` for ``Render.path``.

    Raises:
        UserError: the name is no file name, or the folder cannot be written.
    """
    if not re.fullmatch(r"[\w-]+", name) or SNAPSHOT.fullmatch(f"{name}.json"):
        raise UserError(
            f"path name {name!r}: use letters, digits, - and _, and no snapshot's name"
        )
    ensure_folder(folder)
    path = folder / f"{name}.json"
    paths.write_poses(path, in_world(scene, camtoworlds), fps)
    return path


def in_world(scene: Scene, camtoworlds: Poses) -> Poses:
    """Poses of the model's frame in the frame of the scene's pose file."""
    world_from_model = scene.model_from_world.inverse()
    return world_from_model.poses(np.asarray(camtoworlds, np.float64))


def smoothed(keyframes: Poses) -> Poses:
    """Keyframes with less jitter: the inner ones move half-way to the mean of their
    neighbours. The first and the last stay."""
    if len(keyframes) < 3:
        return keyframes
    windows = np.stack([keyframes[:-2], keyframes[1:-1], keyframes[2:]])
    weights = np.array([0.25, 0.5, 0.25])
    positions = np.tensordot(weights, windows[:, :, :, 3], axes=1)
    rotations = [
        Rotation.from_matrix(window[:, :, :3]).mean(weights).as_matrix()
        for window in windows.swapaxes(0, 1)
    ]
    inner = np.concatenate([rotations, positions[..., None]], axis=-1)
    return np.concatenate([keyframes[:1], inner, keyframes[-1:]])
