# SPDX-License-Identifier: Apache-2.0
"""Tiny scenes for tests, written to disk in every format that readers know.

A ``World`` is cameras (OpenGL), points and a lens; each ``write_*`` puts it into a
folder with a dark picture per view. Picture i is a flat grey of level 4 + i of 255.
"""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pycolmap
from scipy.spatial.transform import Rotation

from internal.cameras import Lens
from internal.files import image_io
from internal.scene.colmap import project

LENS = Lens("PINHOLE", 24, 18, (20.0, 20.0, 12.0, 9.0))
OPENCV_AXES = np.diag([1.0, -1.0, -1.0])


@dataclasses.dataclass(frozen=True)
class World:
    camtoworlds: np.ndarray  # [n, 3, 4]
    points: np.ndarray  # [m, 3]
    lens: Lens = LENS

    @property
    def names(self) -> list[str]:
        return [f"{i:02}.png" for i in range(len(self.camtoworlds))]

    def moved(self, scale: float, rotation: np.ndarray, shift: np.ndarray) -> "World":
        """The same world in other coordinates, x -> scale * rotation x + shift."""
        turned = rotation @ self.camtoworlds
        turned[:, :, 3] = scale * turned[:, :, 3] + shift
        points = scale * self.points @ rotation.T + shift
        return dataclasses.replace(self, camtoworlds=turned, points=points)


def look_at(centres: np.ndarray, target: np.ndarray) -> np.ndarray:
    """OpenGL cameras at ``centres`` [n, 3] that look at ``target``, y up."""
    backward = centres - target
    backward /= np.linalg.norm(backward, axis=-1, keepdims=True)
    right = np.cross([0.0, 1.0, 0.0], backward)
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    return np.stack([right, np.cross(backward, right), backward, centres], axis=-1)


def facing_world(views: int = 6) -> World:
    """Cameras near the plane z = 0 that look at points at depths of 3 to 6."""
    rng = np.random.default_rng(0)
    centres = rng.uniform([-0.6, -0.3, -0.1], [0.6, 0.3, 0.1], (views, 3))
    points = rng.uniform([-1.0, -1.0, -6.0], [1.0, 1.0, -3.0], (400, 3))
    return World(look_at(centres, np.array([0.0, 0.0, -5.0])), points)


def surrounding_world(views: int = 8) -> World:
    """Cameras on a circle of radius 4 about points near (1, 2, 3)."""
    angles = np.arange(views) * 2.0 * np.pi / views
    ring = [np.cos(angles), 0.2 * np.cos(2 * angles), np.sin(angles)]
    target = np.array([1.0, 2.0, 3.0])
    points = target + np.random.default_rng(0).uniform(-0.5, 0.5, (400, 3))
    return World(look_at(target + 4.0 * np.stack(ring, axis=-1), target), points)


def random_rotation(seed: int = 1) -> np.ndarray:
    return Rotation.random(rng=np.random.default_rng(seed)).as_matrix()


def flat_picture(level: float, width: int = 24, height: int = 18) -> np.ndarray:
    return np.full((height, width, 3), level / 255.0, np.float32)


def write_pictures(folder: Path, names: list[str], first_level: float = 4.0) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for i, name in enumerate(names):
        image_io.write(folder / name, flat_picture(first_level + i))


def frame_entries(world: World, folder: str) -> list[dict]:
    bottom = [[0.0, 0.0, 0.0, 1.0]]
    return [
        {"file_path": f"{folder}/{name}", "transform_matrix": [*pose.tolist(), *bottom]}
        for name, pose in zip(world.names, world.camtoworlds, strict=True)
    ]


def intrinsics(lens: Lens) -> dict:
    fx, fy, cx, cy = lens.params[:4]
    size = {"w": float(lens.width), "h": float(lens.height)}
    return {"fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy, **size}


def write_blender(folder: Path, world: World, test: tuple[int, ...] = (0,)) -> Path:
    """The layout of LOM: train lists ``low``, test lists ``high``, both exist."""
    write_pictures(folder / "low", world.names)
    write_pictures(folder / "high", world.names, first_level=150.0)
    entries = {name: frame_entries(world, name) for name in ("low", "high")}
    train = [e for i, e in enumerate(entries["low"]) if i not in test]
    held_out = [entries["high"][i] for i in test]
    for split, frames in (("train", train), ("val", held_out[:1]), ("test", held_out)):
        write_json(
            folder / f"transforms_{split}.json",
            {**intrinsics(world.lens), "frames": frames},
        )
    return folder


def write_nerfstudio(folder: Path, world: World, **extra) -> Path:
    write_pictures(folder / "images", world.names)
    frames = frame_entries(world, "images")[::-1]  # the order of frames is arbitrary
    content = {**intrinsics(world.lens), **extra, "frames": frames}
    write_json(folder / "transforms.json", content)
    return folder


def write_llff(
    folder: Path, world: World, bounds: tuple[float, float] = (2.5, 7.0)
) -> Path:
    write_pictures(folder / "images", world.names)
    np.save(folder / "poses_bounds.npy", llff_rows(world, bounds))
    return folder


def llff_rows(world: World, bounds: tuple[float, float]) -> np.ndarray:
    lens, views = world.lens, len(world.camtoworlds)
    right, up, backward, centre = np.moveaxis(world.camtoworlds, -1, 0)
    hwf = np.tile([lens.height, lens.width, lens.params[0]], (views, 1))
    matrices = np.stack([-up, right, backward, centre, hwf], axis=-1)
    return np.hstack([matrices.reshape(views, 15), np.tile(bounds, (views, 1))])


def write_colmap(
    folder: Path,
    world: World,
    model: str = "sparse/0",
    binary: bool = True,
    tracked: bool = False,
) -> Path:
    write_pictures(folder / "images", world.names)
    return write_model(folder / model, world, binary, tracked)


def write_model(
    folder: Path, world: World, binary: bool = True, tracked: bool = False
) -> Path:
    """A COLMAP model alone; its images are registered in reverse order, and observe the
    points that they see if these are ``tracked``."""
    lens = world.lens
    reconstruction = pycolmap.Reconstruction()
    reconstruction.add_camera_with_trivial_rig(
        pycolmap.Camera(
            camera_id=1,
            model=lens.model,
            width=lens.width,
            height=lens.height,
            params=list(lens.params),
        )
    )
    views = list(zip(world.names, world.camtoworlds, strict=True))
    for image_id, (name, pose) in enumerate(reversed(views), start=1):
        opencv = np.hstack([pose[:, :3] @ OPENCV_AXES, pose[:, 3:]])
        cam_from_world = pycolmap.Rigid3d(opencv).inverse()
        pixels = np.empty((0, 2))
        if tracked:
            pixels = project(lens, (world.points - pose[:, 3]) @ pose[:, :3])
        image = pycolmap.Image(name, pixels, 1, image_id)
        reconstruction.add_image_with_trivial_frame(image, cam_from_world)
    size = np.array([lens.width, lens.height])
    for number, point in enumerate(world.points):
        track = pycolmap.Track()
        for image_id, image in reconstruction.images.items() if tracked else ():
            pixel = image.points2D[number].xy
            if ((pixel >= 0.0) & (pixel < size)).all():
                track.add_element(image_id, number)
        reconstruction.add_point3D(point, track, np.zeros(3, np.uint8))
    folder.mkdir(parents=True, exist_ok=True)
    (reconstruction.write_binary if binary else reconstruction.write_text)(str(folder))
    return folder.parent


def write_json(path: Path, content: dict) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


def edit_json(path: Path, change) -> None:
    """Applies ``change`` to a JSON file's content in place."""
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
