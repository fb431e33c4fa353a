# SPDX-License-Identifier: Apache-2.0
"""The lens of an entry of ``transforms*.json``, in whichever words it is stated."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from internal.cameras import Lens
from internal.errors import UserError
from internal.files import image_io
from internal.files.listing import say_once
from internal.scene import colmap
from internal.scene.readers.transforms_entries import Entry, number
from internal.scene.readers.transforms_pictures import find_picture
from internal.scene.transforms_file import DISTORTION_TERMS

ALIKE = 0.05  # of a focal length: between what is stated in several ways
FRACTION = 1.0  # pixels: a principal point below is stated as a part of the picture
# instant-ngp's
NOT_READ = (
    *("ftheta_p0", "from_mitsuba", "latlong", "equirectangular"),
    *("transform_matrix_start", "transform_matrix_end"),  # a shutter that rolls
)
ROLLING = "rolling_shutter"  # likewise, of zeros where there is none
CIRCLE = "fisheye_crop_radius"  # nerfstudio's
ALL_TERMS = (*"k1 k2 k3 k4 k5 k6 p1 p2 s1 s2 s3 s4 tau_x tau_y".split(),)
LISTED_TERMS = ("k1", "k2", "k3", "k4", "p1", "p2")  # of distortion_params
FISHEYE_MODELS = ("OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE")
PERSPECTIVE_MODELS = (
    *("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL"),
    *("OPENCV", "FULL_OPENCV", "PERSPECTIVE"),
)


def read_lens(frame: Entry) -> Lens:
    """The lens that a frame states, for the size that it states.

    Raises:
        UserError: it contradicts itself, or no lens here is like it.
    """
    width, height = _stated_size(frame)
    foreign = [key for key in NOT_READ if frame.values.get(key, False) is not False]
    foreign += [ROLLING] * bool(np.any(frame.values.get(ROLLING, 0.0)))
    if foreign:
        raise UserError(
            f"{frame.json_path}: has {foreign[0]}, which this program does not read; "
            "expected a camera_model of nerfstudio, and its OpenGL poses"
        )
    if CIRCLE in frame.values:
        say_once(
            f"WARNING: {frame.json_path}: its {CIRCLE} is not read: what lies outside "
            "of that circle is trained on; mask it with a folder masks"
        )
    model = str(frame.values.get("camera_model") or "OPENCV").upper()
    if _is_fisheye(frame):
        model = "OPENCV_FISHEYE"
    if model == "EQUIRECTANGULAR":
        return Lens(model, width, height, (float(width), float(height)))
    if model not in PERSPECTIVE_MODELS + FISHEYE_MODELS:
        raise UserError(
            f"{frame.json_path}: unknown camera_model {model!r}; expected one of "
            f"{', '.join(PERSPECTIVE_MODELS + FISHEYE_MODELS)}, EQUIRECTANGULAR"
        )
    pinhole = (
        *_focal_lengths(frame, width, height),
        _middle(frame, "cx", width),
        _middle(frame, "cy", height),
    )
    frame = _with_listed_distortion(frame)

    def lens(model: str) -> Lens:
        terms = (number(frame, key, 0.0) for key in DISTORTION_TERMS[model])
        return Lens(model, width, height, (*pinhole, *terms))

    _check_terms(frame, model)
    if model in FISHEYE_MODELS:
        return lens("OPENCV_FISHEYE")
    # The simplest lens that has all of the terms.
    simple, full = lens("OPENCV"), lens("FULL_OPENCV")
    if any(full.params[len(simple.params) :]):
        return full
    return simple if any(simple.params[len(pinhole) :]) else lens("PINHOLE")


def _is_fisheye(frame: Entry) -> bool:
    stated = frame.values.get("is_fisheye", False)
    if stated not in (False, True):
        raise UserError(
            f"{frame.json_path}: is_fisheye of {frame.image_path.name} is "
            f"{repr(stated)[:60]}; expected true or false"
        )
    return bool(stated)


def _check_terms(frame: Entry, model: str) -> None:
    """Refuses distortion that no lens here of that model has.

    k4 to k6 are a denominator in OpenCV's full model alone; nerfstudio's k4 of other
    lenses that are no fisheye belongs to r^8.
    """
    own = DISTORTION_TERMS["OPENCV_FISHEYE"]
    if model not in FISHEYE_MODELS:
        own = DISTORTION_TERMS["FULL_OPENCV"]
        own = own if model == "FULL_OPENCV" else (*DISTORTION_TERMS["OPENCV"], "k3")
    for key in ALL_TERMS:
        if key not in own and number(frame, key, 0.0) != 0.0:
            raise UserError(
                f"{frame.json_path}: {key} of {frame.image_path.name} is "
                f"{number(frame, key, 0.0):g}; this program has no such term in a "
                f"{model} lens: calibrate with {', '.join(own)} alone, or undistort "
                "the photos"
            )


def _stated_size(frame: Entry) -> tuple[int, int]:
    """(width, height) in pixels as stated, else of the picture itself."""
    if not {"w", "h"} <= frame.values.keys():
        return image_io.read_size(find_picture(frame, {}))
    width, height = round(number(frame, "w", 0.0)), round(number(frame, "h", 0.0))
    if min(width, height) < 1:
        raise UserError(f"{frame.json_path}: picture size {width}x{height} is empty")
    return width, height


def _focal_lengths(frame: Entry, width: int, height: int) -> tuple[float, float]:
    """(fx, fy) in pixels, from focal lengths or fields of view; square pixels if
    only one is stated."""
    stated = [
        _focal_length(frame, axis, pixels)
        for axis, pixels in (("x", width), ("y", height))
    ]
    fx, fy = stated[0] or stated[1], stated[1] or stated[0]
    if fx <= 0.0 or fy <= 0.0:
        raise UserError(
            f"{frame.json_path}: no focal length for {frame.image_path.name}; expected "
            "fl_x and fl_y in pixels or camera_angle_x in radians"
        )
    if fx < colmap.SHORTEST * width or fy < colmap.SHORTEST * height:
        raise UserError(
            f"{frame.json_path}: the focal length of {frame.image_path.name} is "
            f"{fx:g} x {fy:g} for {width}x{height} pixels; expected pixels"
        )
    return fx, fy


def _focal_length(frame: Entry, axis: str, pixels: int) -> float:
    """In pixels, as stated for one axis in any of three ways; 0 if in none."""
    if number(frame, f"fl_{axis}", 1.0) <= 0.0:
        raise UserError(
            f"{frame.json_path}: fl_{axis} of {frame.image_path.name} is "
            f"{frame.values[f'fl_{axis}']:g}; expected pixels, above 0"
        )
    fov = number(frame, f"camera_angle_{axis}", 0.0)
    if not 0.0 <= fov < math.pi:
        raise UserError(
            f"{frame.json_path}: camera_angle_{axis} is {fov:g}; expected radians, "
            "less than pi: divide degrees by 57.29578"
        )
    degrees = number(frame, f"{axis}_fov", 0.0)
    if not 0.0 <= degrees < 180.0:
        raise UserError(
            f"{frame.json_path}: {axis}_fov is {degrees:g}; expected degrees, below 180"
        )
    ways = {
        f"fl_{axis}": number(frame, f"fl_{axis}", 0.0),
        f"camera_angle_{axis}": _across(pixels, fov),
        f"{axis}_fov": _across(pixels, math.radians(degrees)),
    }
    stated = {key: length for key, length in ways.items() if length}
    if stated and max(stated.values()) > (1.0 + ALIKE) * min(stated.values()):
        said = " but ".join(f"{key} says {f:.4g}" for key, f in stated.items())
        raise UserError(
            f"{frame.json_path}: two focal lengths for {frame.image_path.name}: {said} "
            f"pixels over {pixels}; remove the wrong one"
        )
    return next(iter(stated.values()), 0.0)


def _across(pixels: int, angle: float) -> float:
    """The focal length under which so many pixels fill an angle; 0 for 0."""
    return pixels / (2.0 * math.tan(angle / 2.0)) if angle else 0.0


def _middle(frame: Entry, key: str, side: int) -> float:
    """A coordinate of the principal point, in pixels; half the side if not stated."""
    place = number(frame, key, side / 2.0)
    if not min(FRACTION, 0.1 * side) < place < side:
        raise UserError(
            f"{frame.json_path}: {key} of {frame.image_path.name} is {place:g}, of "
            f"{side} pixels; expected pixels, inside the picture"
        )
    return place


def _with_listed_distortion(frame: Entry) -> Entry:
    """With nerfstudio's list of distortion terms under their names."""
    listed = frame.values.get("distortion_params")
    if listed is None:
        return frame
    if not isinstance(listed, list) or len(listed) != len(LISTED_TERMS):
        raise UserError(
            f"{frame.json_path}: distortion_params of {frame.image_path.name} is "
            f"{repr(listed)[:60]}; expected {', '.join(LISTED_TERMS)}"
        )
    named = dict(zip(LISTED_TERMS, listed, strict=True))
    return dataclasses.replace(frame, values={**frame.values, **named})


def _say_how_wide(frames: Sequence[Entry], lenses: Sequence[Lens]) -> None:
    free = [
        (frame, lens)
        for frame, lens in zip(frames, lenses, strict=True)
        if "camera_angle_x" in frame.values
        and not {"fl_x", "w"} & frame.values.keys()
        and not {"camera_angle_y", "fl_y"} & frame.values.keys()
    ]
    for frame, lens in free:
        first = free[0][1]
        shape = lens.width * first.height / (lens.height * first.width)
        if lens.width != first.width and abs(shape - 1.0) > ALIKE:
            say_once(
                f"WARNING: {frame.json_path}: one camera_angle_x for pictures of "
                f"several shapes ({first.width}x{first.height}, and "
                f"{frame.image_path.name} {lens.width}x{lens.height}): taken across "
                "the width of each; if one camera took them turned, give each frame "
                "its fl_x, fl_y, w and h"
            )
            return


def check_one_size(frames: Sequence[Entry], lenses: Sequence[Lens]) -> None:
    """Refuses one focal length in pixels for pictures of several sizes where no w and
    h says for which. Pictures may lie on their sides. Says how one angle is taken for
    pictures of several shapes."""
    _say_how_wide(frames, lenses)
    sizes: dict[Any, set[tuple[int, ...]]] = {}
    for frame, lens in zip(frames, lenses, strict=True):
        if "fl_x" in frame.values and not {"w", "h"} <= frame.values.keys():
            size = tuple(sorted((lens.width, lens.height)))
            sizes.setdefault(frame.values["fl_x"], set()).add(size)
            if len(sizes[frame.values["fl_x"]]) > 1:
                raise UserError(
                    f"{frame.json_path}: one fl_x for pictures of several sizes, such "
                    f"as {frame.image_path.name}; expected w and h, of the size that "
                    "it is for"
                )
