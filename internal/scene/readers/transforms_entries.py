# SPDX-License-Identifier: Apache-2.0
"""The entries of ``transforms*.json``: their values, their numbers, their paths."""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote

import numpy as np
from jaxtyping import Float

from internal.errors import UserError
from internal.files.listing import find_file, is_file, say_once
from internal.scene.pairing import dark_twin, some
from internal.scene.transforms_file import LAST_ROW

LARGEST_NUMBER = 1e9  # of pixels or depths; also finite
FOCAL_KEYS = (
    ("fl_x", "fl_y"),
    ("camera_angle_x", "camera_angle_y"),
    ("x_fov", "y_fov"),
)


# What readers use, and what other programs write that changes no pose and no lens here.
# Names with "mask" in them, rolling shutters and the like have words of their own.
KNOWN = frozenset(
    """
    frames file_path transform_matrix w h fl_x fl_y cx cy camera_angle_x camera_angle_y
    x_fov y_fov camera_model is_fisheye distortion_params near far ply_file_path
    k1 k2 k3 k4 k5 k6 p1 p2 s1 s2 s3 s4 tau_x tau_y fisheye_crop_radius rolling_shutter
    train_filenames val_filenames test_filenames
    aabb_scale scale offset render_aabb up n_frames n_extra_learnable_dims from_na
    applied_transform applied_scale orientation_override auto_scale_poses_override
    scene_scale white_transparent black_transparent linear_colors sharpness blur_score
    rotation time timestamp colmap_im_id depth_file_path depth_path integer_depth_scale
    enable_depth_loading enable_ray_loading depth_unit_scale_factor normal_file_path
    """.split()
)


@dataclasses.dataclass(frozen=True)
class Entry:
    """One entry of ``frames`` with the file-wide values it inherits."""

    json_path: Path
    image_path: Path  # as listed, or its dark twin
    values: Mapping[str, Any]
    is_test: bool


def read_entries(path: Path, is_test: bool) -> list[Entry]:
    """The entries of a file.

    Raises:
        UserError: it is no JSON, or no such file.
    """
    try:
        content = json.loads(_decoded(path.read_bytes()), object_pairs_hook=_unique)
    except (ValueError, OSError, RecursionError) as error:
        raise UserError(f"{path}: not a JSON file ({error}); write it again") from error
    frames = content.get("frames") if isinstance(content, dict) else None
    if not isinstance(frames, list) or not frames:
        raise UserError(f'{path}: no "frames"; expected a NeRF transforms file')
    shared = _stated(content)
    del shared["frames"]
    for index, frame in enumerate(frames):
        listed = frame.get("file_path") if isinstance(frame, dict) else None
        if not isinstance(listed, str) or not listed:
            raise UserError(f'{path}: frame {index} has no "file_path"')
    frames = list(map(_stated, frames))
    for frame in frames:
        _check_own_size(path, shared, frame)
    _name_unread(path, [shared, *frames])
    return [
        Entry(
            path,
            dark_twin(locate(path.parent, f["file_path"])),
            _inherited(shared, f),
            is_test,
        )
        for f in frames
    ]


def _name_unread(path: Path, stated: Sequence[Mapping[str, Any]]) -> None:
    """Names the keys that nobody reads: some tools state there what poses or lenses
    mean, such as a matrix of intrinsics for each frame."""
    keys = {key for values in stated for key in values} - KNOWN
    unread = sorted(key for key in keys if "mask" not in key.lower())
    if unread:
        say_once(
            f"WARNING: {path}: not read: {some(unread)}; if they say what its poses or "
            "lenses mean, write that as transform_matrix, fl_x, fl_y, cx, cy"
        )


def _check_own_size(
    path: Path, shared: Mapping[str, Any], own: Mapping[str, Any]
) -> None:
    """Refuses a frame of another size than the file's, with the file's lens."""
    for side, focal in (("w", "fl_x"), ("h", "fl_y")):
        differs = side in own and shared.get(side, own[side]) != own[side]
        if differs and focal in shared and focal not in own:
            raise UserError(
                f"{path}: {side} of {own['file_path'][:60]} is {own[side]}, but its "
                f"{focal} is the file's, for {shared[side]}; expected its own {focal}"
            )


def _inherited(shared: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """A frame's values: its own before the file's. Where it states focal lengths in
    one way, those that the file states in other ways are not meant for it."""
    in_own_way = [ways for ways in FOCAL_KEYS if any(key in own for key in ways)]
    others = {key for ways in FOCAL_KEYS if ways not in in_own_way for key in ways}
    if in_own_way:
        shared = {k: value for k, value in shared.items() if k not in others}
    return {**shared, **own}


def _stated(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values without those that are null, by which a file says that it has none."""
    return {key: value for key, value in values.items() if value is not None}


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object; raises where a key has two values, of which one is not meant."""
    values = dict(pairs)
    for key, value in pairs:
        if value is not values[key] and value != values[key]:
            raise ValueError(f"{key!r} is there twice, with two values")
    return values


def _decoded(content: bytes) -> str:
    """A text in UTF-8 or UTF-16, with or without the mark that editors put first."""
    utf_16 = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    return content.decode("utf-16" if utf_16 else "utf-8-sig")


def locate(folder: Path, listed: str) -> Path:
    """Where a listed picture is: as written, with the slashes of Windows or escapes
    of URLs, else, for a path of another machine, the longest end of it that the scene
    holds. The path as written where there is none."""
    spellings = [listed, listed.replace("\\", "/"), unquote(listed.replace("\\", "/"))]
    for spelling in spellings:
        if is_file(find_file(folder / spelling)):
            return folder / spelling
    return of_another_machine(folder, spellings[-1]) or folder / listed


def of_another_machine(folder: Path, listed: str) -> Path | None:
    """What the scene holds at the longest end of a path."""
    parts = PurePosixPath(listed).parts
    for start in range(1, len(parts)):
        path = folder.joinpath(*parts[start:])
        if is_file(find_file(path)):
            return path
    return None


def number(frame: Entry, key: str, default: float) -> float:
    """A value of a frame; raises a UserError for one that is no finite number."""
    value = frame.values.get(key, default)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not abs(value) < LARGEST_NUMBER:
        raise UserError(
            f"{frame.json_path}: {key} of {frame.image_path.name} is "
            f"{repr(value)[:60]}; expected a finite number"
        )
    return float(value)


def read_camtoworld(frame: Entry) -> Float[np.ndarray, "3 4"]:
    """A frame's pose, OpenGL; raises a UserError for what is no such matrix."""
    try:
        matrix = np.array(frame.values.get("transform_matrix"), np.float64)
    except (TypeError, ValueError, OverflowError):
        matrix = np.empty(0)
    if matrix.shape not in ((3, 4), (4, 4)):
        raise UserError(
            f"{frame.json_path}: transform_matrix of {frame.image_path.name} is not a "
            "4x4 camera-to-world matrix"
        )
    if not np.allclose(matrix[3:], LAST_ROW, atol=1e-4):
        raise UserError(
            f"{frame.json_path}: the last row of transform_matrix of "
            f"{frame.image_path.name} is {matrix[3].tolist()}; expected 0, 0, 0, 1 "
            "(camera to world, the position in the last column): transpose it"
        )
    return matrix[:3]
