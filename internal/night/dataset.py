# SPDX-License-Identifier: Apache-2.0
"""The synthetic night scene as a dataset: views, pictures, poses, depth range.

World frame: OpenGL (x right, y up, z towards the viewer), unit one decimetre; poses
are exact OpenGL camera-to-world matrices of pinhole cameras. Pictures are 8-bit
sRGB: ``high`` the normal-light truth, ``low`` the same light through
``capture.capture``.
"""

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float

from internal import progress
from internal.cameras import Lens
from internal.errors import UserError
from internal.files import image_io
from internal.files.made_folder import Facts, make_folder
from internal.night import pinhole, still_life
from internal.night.capture import NORMAL_LIGHT, CaptureModel, capture, view_key
from internal.scene.transforms_file import View, write_split

CONTENT = 1  # counts changes of what the scene shows; older folders are made anew
HORIZONTAL_FOV = np.pi / 4
TARGET = np.array([0.0, 0.95, -0.4])  # what all cameras look at
DISTANCE = 9.3  # decimetres, from the target to the cameras
ELEVATION = 18.0  # degrees, of the middle of the arc
ARC = np.array([16.0, 6.5])  # degrees from its middle to its ends, sideways and up
HOLDOUT = 8  # every eighth view, from the first, is a test view
DEPTH_MARGIN = 0.02  # near and far lie outside of all depths by this fraction
SUBPIXELS = 3
RENDER_THREADS = 2  # one view does not keep more than one core busy

README = """A synthetic still life on a desk at night, with exact cameras.

high/  normal-light truth, 8-bit sRGB
low/   the same light at exposure {exposure:.4g}, through a camera model: photon
       noise (full well {full_well:g} electrons), read noise ({read_noise:g}
       electrons), channel gains {channel_gains}, clipping, sRGB curve, 8 bits;
       seed {seed}
transforms_train.json, transforms_test.json
       OpenGL camera-to-world poses, intrinsics in pixels, near and far depth in the
       poses' unit (decimetres); every {holdout}th view is a test view

Made by: python make_scene.py night {name}
The exact settings are in made_with.json. Nobody's photos: free to use.
"""


def focal_length(width: int) -> float:
    """Focal length in pixels."""
    return width / 2 / np.tan(HORIZONTAL_FOV / 2)


def make_cameras(views: int) -> Float[np.ndarray, "views 3 4"]:
    """OpenGL camera-to-world poses on a shell in front of the desk.

    Directions from the target fill an ellipse like the seeds of a sunflower (Vogel
    1979), and distances differ by a few percent; all look at the target.
    """
    number = np.arange(views)
    spread = np.sqrt((number + 0.5) / views)
    turn = number * np.pi * (3.0 - np.sqrt(5.0))
    azimuth = np.radians(ARC[0] * spread * np.cos(turn))
    elevation = np.radians(ELEVATION + ARC[1] * spread * np.sin(turn))
    distance = DISTANCE * (1.0 + 0.04 * np.sin(2.4 * number))
    backward = np.stack(
        [
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
            np.cos(azimuth) * np.cos(elevation),
        ],
        axis=-1,
    )
    right = np.cross([0.0, 1.0, 0.0], backward)
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    up = np.cross(backward, right)
    center = TARGET + distance[:, None] * backward
    return np.stack([right, up, backward, center], axis=-1)


def render_views(
    camtoworlds: Float[np.ndarray, "views 3 4"], width: int, height: int
) -> Float[np.ndarray, "views {height} {width} 3"]:
    """Linear RGB of every view; 1 is the white of the normal-light picture."""
    world = still_life.build_world()
    camtoworlds = camtoworlds.astype(np.float32)
    focal = focal_length(width)
    render = partial(pinhole.render, width=width, height=height, subpixels=SUBPIXELS)

    def render_view(view: int) -> np.ndarray:
        key = jax.random.fold_in(jax.random.key(0), view)
        return np.asarray(render(world, camtoworlds[view], focal, key))

    views = len(camtoworlds)
    first = render_view(0)  # compiles: threads that start together would each do so
    with ThreadPoolExecutor(RENDER_THREADS) as pool:
        others = pool.map(render_view, range(1, views))
        shown = progress.track(others, views - 1, "rendering", "view")
        return np.stack([first, *shown])


def find_depth_range(
    camtoworlds: Float[np.ndarray, "views 3 4"], width: int, height: int
) -> tuple[float, float]:
    """Near and far, in decimetres along the optical axis, around all views."""
    solids = still_life.build_world().solids
    depths = [
        pinhole.depth_map(solids, pose, focal_length(width), width=width, height=height)
        for pose in camtoworlds.astype(np.float32)
    ]
    near, far = float(np.min(depths)), float(np.max(depths))
    return near * (1.0 - DEPTH_MARGIN), far * (1.0 + DEPTH_MARGIN)


def write_scene(
    folder: Path,
    model: CaptureModel,
    *,
    views: int = 30,
    width: int = 160,
    height: int = 120,
    overwrite: bool = False,
) -> Facts:
    """Writes the paired scene, or reuses the one written with the same settings.

    Args:
        folder: appears whole, with ``low``, ``high``, ``transforms_train.json``,
            ``transforms_test.json`` and a README.
        model: of the dark captures. The truth does not depend on it.
        views: number of cameras.
        width: of the pictures, pixels.
        height: of the pictures, pixels.
        overwrite: writes anew over a scene with other settings.

    Returns:
        ``dark_level`` and ``truth_level`` (means in 8-bit levels), ``near``, ``far``.

    Raises:
        UserError: a size is too small, or ``folder`` is in use or not writable.
    """
    if views < 3 or min(width, height) < 8:
        raise UserError(
            f"{views} views of {width}x{height} pixels; at least 3 of 8x8 make a scene"
        )
    settings = {
        **{"scene": "night", "content": CONTENT},
        **{"views": views, "width": width, "height": height},
        **dataclasses.asdict(model),
    }

    def fill(partial: Path) -> Facts:
        camtoworlds = make_cameras(views)
        near, far = find_depth_range(camtoworlds, width, height)
        linear_rgb = render_views(camtoworlds, width, height)
        levels = _write_pictures(partial, linear_rgb, model)
        _write_transforms(partial, _lens(width, height), camtoworlds, (near, far))
        text = README.format(
            name=folder.name, holdout=HOLDOUT, **dataclasses.asdict(model)
        )
        (partial / "README.txt").write_text(text)
        return levels | {"near": near, "far": far}

    return make_folder(folder, settings, fill, overwrite=overwrite)


def _write_pictures(
    folder: Path,
    linear_rgb: Float[np.ndarray, "views height width 3"],
    model: CaptureModel,
) -> Facts:
    """Writes ``low`` and ``high``; returns their mean 8-bit levels."""
    levels = {"dark_level": 0.0, "truth_level": 0.0}
    for name, level, camera in (
        ("low", "dark_level", model),
        ("high", "truth_level", NORMAL_LIGHT),
    ):
        (folder / name).mkdir()
        for view, light in enumerate(linear_rgb):
            picture = capture(light, camera, view_key(camera, view))
            image_io.write(folder / name / _file_name(view), picture / np.float32(255))
            levels[level] += float(picture.mean()) / len(linear_rgb)
    return levels


def _write_transforms(
    folder: Path,
    lens: Lens,
    camtoworlds: Float[np.ndarray, "views 3 4"],
    bounds: tuple[float, float],
) -> None:
    """One JSON per split; test frames name the truth, as LOM's do."""
    views = range(len(camtoworlds))
    for split, pictures, chosen in (
        ("train", "low", [view for view in views if view % HOLDOUT]),
        ("test", "high", views[::HOLDOUT]),
    ):
        frames = [
            View(f"{pictures}/{_file_name(view)}", lens, camtoworlds[view])
            for view in chosen
        ]
        write_split(folder, split, frames, bounds)


def _lens(width: int, height: int) -> Lens:
    focal = focal_length(width)
    return Lens("PINHOLE", width, height, (focal, focal, width / 2, height / 2))


def _file_name(view: int) -> str:
    return f"{view:03d}.png"
