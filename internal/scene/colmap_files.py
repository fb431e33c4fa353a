# SPDX-License-Identifier: Apache-2.0
"""The files of a COLMAP model, binary or text, read without trust in what they state.

Only what a scene needs is kept: cameras, posed images and the points they observe.
What points state of images is passed over, so tracks may contradict each other (as
edited models' do).
Counts and lengths are checked against the file's size before anything is read by
them: a corrupt file ends at once. Frames are COLMAP's: OpenCV, world to camera.
"""

import dataclasses
import itertools
import math
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pycolmap
from jaxtyping import Float, Int, UInt8

from internal.cameras import Lens
from internal.errors import UserError
from internal.files.listing import say_once

PARTS = ("cameras", "images", "points3D")
ENDINGS = (".bin", ".txt")  # binary first, as COLMAP prefers it
LARGEST_SIDE = 2**17  # pixels: beyond any photo
SHORTEST = 1e-6  # a quaternion that says nothing; others are brought to unit length
POINT_2D = np.dtype([("pixel", "<f8", 2), ("point", "<i8")])  # point -1: none
TRACK_ELEMENT = struct.calcsize("<ii")

_MODELS = {
    int(kind): (name, len(pycolmap.Camera(model=name).params_info.split(",")))
    for name, kind in pycolmap.CameraModelId.__members__.items()
    if name != "INVALID"
}
_COUNTS = dict(_MODELS.values())
_T = TypeVar("_T")


@dataclasses.dataclass(frozen=True)
class Image:
    """A registered image."""

    name: str  # with any subfolder
    camera: int
    quaternion: tuple[float, ...]  # w, x, y, z: camera from world
    translation: tuple[float, ...]
    points: Int[np.ndarray, " k"]  # numbers of the points that it observes
    pixels: Float[np.ndarray, "k 2"]  # and where


@dataclasses.dataclass(frozen=True)
class StoredModel:
    """What the three files of a model state."""

    cameras: dict[int, Lens]
    images: tuple[Image, ...]
    points: Float[np.ndarray, "m 3"]
    colors: UInt8[np.ndarray, "m 3"]
    errors: Float[np.ndarray, " m"]  # mean reprojection error, pixels


class _Corrupt(Exception):
    """What is wrong with a file."""


def model_ending(folder: Path) -> str:
    """Whether the model in a folder is ".bin" or ".txt"; "" where it is not whole."""
    return next(iter(_endings(folder)), "")


def _endings(folder: Path) -> list[str]:
    """Those of ``ENDINGS`` in which a folder holds a whole model."""
    return [
        ending
        for ending in ENDINGS
        if all((folder / f"{part}{ending}").is_file() for part in PARTS)
    ]


def read_stored(folder: Path) -> StoredModel:
    """Reads a model.

    Raises:
        UserError: a file is missing, cut short or corrupt, or the files contradict
            each other.
    """
    cameras, images = read_views(folder)
    path = folder / f"points3D{model_ending(folder)}"
    points = _read(path, _point_bin, _point_txt)
    rows = np.array(points, np.float64).reshape(-1, 7)
    if not np.isfinite(rows[:, :3]).all():
        raise _unreadable(path, "a point is not finite")
    return StoredModel(
        cameras, images, rows[:, :3], rows[:, 3:6].astype(np.uint8), rows[:, 6]
    )


def read_views(folder: Path) -> tuple[dict[int, Lens], tuple[Image, ...]]:
    """Cameras by number and the registered images of a model, without its points.

    Raises:
        UserError: as ``read_stored``.
    """
    ending = model_ending(folder)
    if not ending:
        raise UserError(
            f"{folder}: not a readable COLMAP model (a file is missing); expected "
            "cameras, images and points3D, all .bin or all .txt: export it again"
        )
    if len(_endings(folder)) > 1:
        say_once(
            f"{folder}: holds a model in {ending} and one in {ENDINGS[1]}: {ending} is "
            "read; remove its files if the others are newer"
        )
    lenses = _read(folder / f"cameras{ending}", _camera_bin, _camera_txt)
    cameras = dict(lenses)
    images = read_images(folder)
    if len(cameras) < len(lenses):
        raise _unreadable(folder / f"cameras{ending}", "two cameras have one number")
    for image in images:
        if image.camera not in cameras:
            reason = f"{image.name}: there is no camera {image.camera}"
            raise _unreadable(folder / f"images{ending}", reason)
    return cameras, images


def read_images(folder: Path) -> tuple[Image, ...]:
    """The registered images of a whole model, sorted by name.

    Raises:
        UserError: the file is cut short or corrupt, or names an image twice.
    """
    path = folder / f"images{model_ending(folder)}"
    images = sorted(_read(path, _image_bin, _image_txt), key=lambda image: image.name)
    for image, following in itertools.pairwise(images):
        if image.name == following.name:
            raise _unreadable(path, f"image {image.name!r} is there twice")
    return tuple(images)


def _read(
    path: Path,
    from_bytes: Callable[["_Bytes"], _T],
    from_lines: Callable[["_Lines"], _T],
) -> list[_T]:
    """All records of a file, by its ending."""
    try:
        content = path.read_bytes()
        if path.suffix == ".bin":
            return _records(_Bytes(content), from_bytes)
        lines = _Lines(content.decode("utf-8-sig", errors="replace"))
        return list(lines.records(from_lines))
    except (_Corrupt, OSError) as error:
        raise _unreadable(path, str(error)) from error


def _unreadable(path: Path, reason: str) -> UserError:
    return UserError(
        f"{path}: not a readable COLMAP model ({reason}); copy it or export it again"
    )


class _Bytes:
    """A binary file and the place in it that is read next."""

    def __init__(self, content: bytes) -> None:
        self.content = content
        self.place = 0

    def take(self, layout: str) -> tuple[Any, ...]:
        start = self.place
        self.skip(1, struct.calcsize(layout))
        return struct.unpack_from(layout, self.content, start)

    def skip(self, count: int, size: int) -> None:
        """Passes over ``count`` things of ``size`` bytes."""
        left = len(self.content) - self.place
        if count * size > left:
            raise _Corrupt(f"{left} bytes are left where {count * size} should follow")
        self.place += count * size

    def text(self) -> str:
        """A string that ends in a zero."""
        end = self.content.find(b"\0", self.place)
        if end < 0:
            raise _Corrupt("the end of a name is missing")
        start, self.place = self.place, end + 1
        return self.content[start:end].decode(errors="replace")


def _records(file: _Bytes, read: Callable[[_Bytes], _T]) -> list[_T]:
    """As many records as the file's head states, which must be all there is.

    Every record takes bytes, so the loop ends with the file whatever the count.
    """
    (count,) = file.take("<Q")
    if count > len(file.content):
        raise _Corrupt(f"{count} entries in {len(file.content)} bytes")
    records = [read(file) for _ in range(count)]
    left = len(file.content) - file.place
    if left:
        raise _Corrupt(f"{left} bytes are left after {count} entries")
    return records


def _camera_bin(file: _Bytes) -> tuple[int, Lens]:
    number, kind, width, height = file.take("<iiQQ")
    if kind not in _MODELS:
        raise _Corrupt(f"camera {number} has the unknown model {kind}")
    model, count = _MODELS[kind]
    return number, _lens(number, model, width, height, file.take(f"<{count}d"))


def _image_bin(file: _Bytes) -> Image:
    _, *pose, camera = file.take("<i7di")
    name = file.text()
    (count,) = file.take("<Q")
    start = file.place
    file.skip(count, POINT_2D.itemsize)
    observed = np.frombuffer(file.content, POINT_2D, count, start)
    return _image(name, camera, pose, observed["point"], observed["pixel"])


def _point_bin(file: _Bytes) -> tuple[float, ...]:
    _, *values = file.take("<Q3d3Bd")
    (length,) = file.take("<Q")
    file.skip(length, TRACK_ELEMENT)
    return tuple(map(float, values))


class _Lines:
    """A text file and the line of it that is read next."""

    def __init__(self, text: str) -> None:
        self.lines = text.split("\n")
        self.place = 0

    def records(self, read: Callable[["_Lines"], _T]) -> Iterator[_T]:
        """Records that start at lines other than comments and blank ones."""
        while self.place < len(self.lines):
            line = self.lines[self.place].strip()
            if not line or line.startswith("#"):
                self.place += 1
                continue
            start = self.place + 1
            try:
                yield read(self)
            except (ValueError, IndexError, OverflowError) as error:
                raise _Corrupt(f"line {start}: {error}") from error

    def take(self) -> str:
        """The next line; an empty one behind the last."""
        line = self.lines[self.place] if self.place < len(self.lines) else ""
        self.place += 1
        return line.strip()


def _camera_txt(lines: _Lines) -> tuple[int, Lens]:
    number, model, width, height, *params = lines.take().split()
    if len(params) != _COUNTS.get(model):
        raise ValueError(f"no camera model {model} of {len(params)} parameters")
    values = tuple(map(float, params))
    return int(number), _lens(int(number), model, int(width), int(height), values)


def _image_txt(lines: _Lines) -> Image:
    _, *pose, camera, name = lines.take().split(maxsplit=9)
    if len(pose) != 7:
        raise ValueError("expected a number, a pose of seven numbers, a camera, a name")
    observed = lines.take().split()
    if len(observed) % 3 or (observed and not _is_number(observed[-1])):
        raise ValueError("no line of x, y and point of what it observes follows")
    table = np.array(observed, np.float64).reshape(-1, 3)
    values = [float(value) for value in pose]
    return _image(name, int(camera), values, table[:, 2].astype(np.int64), table[:, :2])


def _is_number(text: str) -> bool:
    return text.removeprefix("-").isdecimal()


def _point_txt(lines: _Lines) -> tuple[float, ...]:
    _, x, y, z, *rgb, error = lines.take().split()[:8]
    colors = [int(value) for value in rgb]
    if len(colors) != 3 or not all(0 <= value < 256 for value in colors):
        raise ValueError("expected a number, x, y, z, red, green, blue, an error")
    return tuple(map(float, (x, y, z, *colors, error)))


def _lens(
    number: int, model: str, width: int, height: int, params: tuple[float, ...]
) -> Lens:
    if not (0 < width <= LARGEST_SIDE and 0 < height <= LARGEST_SIDE):
        raise _Corrupt(f"camera {number} is of {width}x{height} pixels")
    if not all(map(math.isfinite, params)):
        raise _Corrupt(f"camera {number} has parameters that are not finite")
    return Lens(model, width, height, params)


def _image(
    name: str,
    camera: int,
    pose: list[float],
    points: Int[np.ndarray, " k"],
    pixels: Float[np.ndarray, "k 2"],
) -> Image:
    length = math.hypot(*pose[:4])
    if not name:
        raise _Corrupt("an image has no name")
    if not (length > SHORTEST and all(map(math.isfinite, pose))):
        raise _Corrupt(f"image {name!r} has a pose that is none")
    quaternion = tuple(value / length for value in pose[:4])
    real = points >= 0
    return Image(name, camera, quaternion, tuple(pose[4:]), points[real], pixels[real])
