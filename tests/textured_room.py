# SPDX-License-Identifier: Apache-2.0
"""A corner of a room with painted walls: pictures in which features are found.

Rendered in milliseconds with exact cameras: three planes under a texture of random
blots. Frame: OpenGL cameras; floor y = 0, walls x = 0 and z = 0.
"""

import types
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy import ndimage

from internal import color
from internal.files import image_io
from tests.scene_writers import look_at

WIDTH, HEIGHT, FOCAL = 240, 180, 260.0
TEXELS = 512  # per repeat of 4 units


def room_cameras(views: int) -> np.ndarray:
    """OpenGL cameras [n, 3, 4] on an arc that look into the corner."""
    turn = np.linspace(0.15, 0.85, views) * np.pi / 2
    high = 1.4 + 0.3 * np.sin(3.0 * np.arange(views))
    centres = np.stack([4.0 * np.cos(turn), high, 4.0 * np.sin(turn)], axis=-1)
    return look_at(centres, np.array([0.6, 0.8, 0.6]))


def render_room(camtoworld: np.ndarray, seed: int = 0, zoom: float = 1.0) -> np.ndarray:
    """Linear light [height, width, 3] in [0, 1] of the room painted by ``seed``."""
    x = (np.arange(WIDTH) + 0.5 - WIDTH / 2) / (FOCAL * zoom)
    y = -(np.arange(HEIGHT) + 0.5 - HEIGHT / 2) / (FOCAL * zoom)
    grid = np.stack([*np.meshgrid(x, y), -np.ones((HEIGHT, WIDTH))], axis=-1)
    directions = grid @ camtoworld[:, :3].T
    distances = -camtoworld[:, 3] / directions
    distances[distances <= 0.0] = np.inf
    wall = distances.argmin(axis=-1)
    points = camtoworld[:, 3] + directions * distances.min(axis=-1)[..., None]
    picture = np.zeros((HEIGHT, WIDTH, 3))
    for axis, paint in enumerate(_paints(seed)):
        across = np.delete(points, axis, axis=-1) * TEXELS / 4.0
        light = ndimage.map_coordinates(
            paint, np.moveaxis(across, -1, 0), order=1, mode="grid-wrap"
        )
        tint = np.array([1.0, 0.8, 0.6]) * (0.7 + 0.1 * axis)
        picture = np.where((wall == axis)[..., None], light[..., None] * tint, picture)
    return picture


def write_room(
    folder: Path,
    views: int = 8,
    exposure: float | np.ndarray = 0.05,
    seed: int = 0,
    first: int = 0,
    zooms: Mapping[int, float] = types.MappingProxyType({}),
) -> np.ndarray:
    """Writes dark noisy 8-bit PNG photos, some zoomed; returns their cameras."""
    folder.mkdir(parents=True, exist_ok=True)
    cameras = room_cameras(views)
    rng = np.random.default_rng(seed)
    exposures = np.broadcast_to(exposure, views)
    for view, camera in enumerate(cameras):
        light = render_room(camera, seed, zooms.get(view, 1.0)) * exposures[view]
        noisy = np.clip(light + rng.normal(0.0, 2e-4, light.shape), 0.0, 1.0)
        srgb = np.asarray(color.linear_to_srgb(noisy), np.float32)
        image_io.write(folder / f"{first + view:02}.png", srgb)
    return cameras


def _paints(seed: int) -> list[np.ndarray]:
    rng = np.random.default_rng(100 + seed)
    paints = []
    for _ in range(3):
        blots = sum(
            ndimage.gaussian_filter(rng.normal(size=(TEXELS, TEXELS)), s, mode="wrap")
            * s
            for s in (2.0, 4.0, 8.0)
        )
        paints.append(np.clip(0.5 + 0.5 * blots, 0.02, 1.0))
    return paints
