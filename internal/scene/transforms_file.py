# SPDX-License-Identifier: Apache-2.0
"""``transforms*.json`` as this program writes it; ``readers/transforms`` reads it.

Poses are OpenGL camera-to-world, lenses in pixels under OpenCV's names, bounds depths
in the poses' unit. What other programs insist on is kept: OpenSplat wants each frame's
own lens, nerfstudio all three lists of names or none.
"""

import dataclasses
import json
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from internal.cameras import Lens
from internal.files import atomic

SPLIT_FILE = "transforms_{}.json"
SINGLE_FILE = "transforms.json"
LAST_ROW = (0.0, 0.0, 0.0, 1.0)
PINHOLE_TERMS = ("fl_x", "fl_y", "cx", "cy")
# What a lens's parameters are called, in their order, after those of a pinhole.
DISTORTION_TERMS = {
    "PINHOLE": (),
    "OPENCV": ("k1", "k2", "p1", "p2"),
    "FULL_OPENCV": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "OPENCV_FISHEYE": ("k1", "k2", "k3", "k4"),
}


@dataclasses.dataclass(frozen=True)
class View:
    """One entry of ``frames``."""

    file: str  # from the folder of the JSON
    lens: Lens  # of a model of ``DISTORTION_TERMS``
    camtoworld: Float[np.ndarray, "3 4"]


def write_single(
    folder: Path,
    views: Sequence[View],
    *,
    test: Collection[str] = (),
    bounds: tuple[float, float] | None = None,
    points_file: str = "",
) -> None:
    """Writes ``transforms.json`` (nerfstudio's custom).

    Args:
        views: at least one, with lenses of one model.
        test: files of the views that are held out, if the file is to say so.
        bounds: near and far depth.
        points_file: of points in the poses' frame, in ``folder``.

    Raises:
        UserError: the folder cannot be written or the disk is full.
    """
    content: dict[str, Any] = {"camera_model": views[0].lens.model}
    if points_file:
        content["ply_file_path"] = points_file
    if test:
        files = [view.file for view in views]
        held_out = [file for file in files if file in test]
        content["train_filenames"] = [file for file in files if file not in test]
        content |= {"val_filenames": held_out, "test_filenames": held_out}
    frames = [
        {"file_path": view.file, **_lens_entry(view.lens), **_pose_entry(view)}
        for view in views
    ]
    _write(folder / SINGLE_FILE, content | _bounds_entry(bounds), frames)


def write_split(
    folder: Path, split: str, views: Sequence[View], bounds: tuple[float, float]
) -> None:
    """Writes ``transforms_SPLIT.json`` (the custom of NeRF's synthetic scenes).

    Args:
        split: "train", "val" or "test".
        views: at least one, all through one lens.
        bounds: near and far depth.
    """
    lens = views[0].lens
    angle = 2.0 * np.arctan(lens.width / (2.0 * lens.params[0]))
    content = {"camera_angle_x": float(angle), **_lens_entry(lens)}
    frames = [{"file_path": view.file, **_pose_entry(view)} for view in views]
    path = folder / SPLIT_FILE.format(split)
    _write(path, content | _bounds_entry(bounds), frames)


def _write(path: Path, content: dict[str, Any], frames: list[dict[str, Any]]) -> None:
    text = json.dumps({**content, "frames": frames}, indent=2)
    atomic.write_text(path, text + "\n")


def _lens_entry(lens: Lens) -> dict[str, float | int]:
    names = (*PINHOLE_TERMS, *DISTORTION_TERMS[lens.model])
    terms = dict(zip(names, lens.params, strict=True))
    return {"w": lens.width, "h": lens.height, **terms}


def _pose_entry(view: View) -> dict[str, Any]:
    return {"transform_matrix": [*view.camtoworld.tolist(), list(LAST_ROW)]}


def _bounds_entry(bounds: tuple[float, float] | None) -> dict[str, float]:
    return dict(zip(("near", "far"), bounds, strict=True)) if bounds else {}
