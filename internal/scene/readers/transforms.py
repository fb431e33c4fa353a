# SPDX-License-Identifier: Apache-2.0
"""Scenes whose poses are JSON: ``transforms*.json`` in its two customs.

``blender``: one file per split, ``transforms_{train,val,test}.json`` (NeRF's
synthetic scenes, LOM, RealX3D). ``val`` is read only where there is no ``test``.
``nerfstudio``: one ``transforms.json`` (instant-ngp, nerfstudio), whose split is
``train_filenames`` and ``test_filenames`` where it has them.

Both: OpenGL camera-to-world matrices; intrinsics in pixels of the stated ``w`` by
``h``, global or per frame, or ``camera_angle_x`` alone; ``near`` and ``far`` as
optional depths; ``mask_path`` per frame. A picture listed in a normal-light folder
stands for its dark twin. Points are those of ``ply_file_path``, in the JSON's frame;
else those of a COLMAP model beside the file, moved by the similarity that takes its
camera centres to the JSON's: an ``applied_transform`` needs no special case.
"""

import dataclasses
import json
import math
import os
import posixpath
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote

import numpy as np
from jaxtyping import Float

from internal import poses
from internal.cameras import Lens
from internal.errors import UserError, one_line
from internal.files import image_io, ply
from internal.files.listing import (
    composed,
    find_file,
    is_file,
    is_metadata,
    say_once,
)
from internal.scene import colmap
from internal.scene.mask_files import find_masks
from internal.scene.pairing import dark_twin, match_by_name, pair_poses, some
from internal.scene.readers.base import Reader, SceneFiles
from internal.scene.transforms_file import (
    DISTORTION_TERMS,
    LAST_ROW,
    SINGLE_FILE,
    SPLIT_FILE,
)

LARGEST_NUMBER = 1e9  # of pixels or depths; also finite
FOCAL_KEYS = (
    ("fl_x", "fl_y"),
    ("camera_angle_x", "camera_angle_y"),
    ("x_fov", "y_fov"),
)
ALIKE = 0.05  # of a focal length: between what is stated in several ways
FRACTION = 1.0  # pixels: a principal point below is stated as a part of the picture
# instant-ngp's
NOT_READ = (
    *("ftheta_p0", "from_mitsuba", "latlong", "equirectangular"),
    *("transform_matrix_start", "transform_matrix_end"),  # a shutter that rolls
)
MOST_POINTS = 200_000  # of a dense cloud, evenly chosen
WORST_FIT = 0.01  # of the spread of the camera centres
WORST_AXES = 0.05  # between unit vectors: 3 degrees
ALL_TERMS = (*"k1 k2 k3 k4 k5 k6 p1 p2 s1 s2 s3 s4 tau_x tau_y".split(),)
LISTED_TERMS = ("k1", "k2", "k3", "k4", "p1", "p2")  # of distortion_params
FISHEYE_MODELS = ("OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE")
PERSPECTIVE_MODELS = (
    *("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL"),
    *("OPENCV", "FULL_OPENCV", "PERSPECTIVE"),
)

# Of folders that were looked at, the pictures by their names up to the ending.
_Folders = dict[Path, dict[str, list[Path]]]


@dataclasses.dataclass(frozen=True)
class _Frame:
    """One entry of ``frames`` with the file-wide values it inherits."""

    json_path: Path
    image_path: Path  # as listed, or its dark twin
    values: Mapping[str, Any]
    is_test: bool


def _matches_blender(data_dir: Path) -> bool:
    return (data_dir / SPLIT_FILE.format("train")).is_file()


def _matches_nerfstudio(data_dir: Path) -> bool:
    return (data_dir / SINGLE_FILE).is_file()


def read_blender(data_dir: Path, images_dir: str, pair_by: str) -> SceneFiles:
    """Reads one JSON file per split.

    Raises:
        UserError: a file is broken, or a picture is missing.
    """
    paths = {s: data_dir / SPLIT_FILE.format(s) for s in ("train", "val", "test")}
    held_out = next((s for s in ("test", "val") if paths[s].is_file()), None)
    frames = _read_frames(paths["train"], is_test=False)
    if held_out:
        training = {frame.image_path for frame in frames}
        frames += _read_frames(paths[held_out], is_test=True)
        both = training & {frame.image_path for frame in frames if frame.is_test}
        if both:
            say_once(
                f"WARNING: {paths[held_out]}: {len(both)} of its views are in "
                f"{paths['train'].name} too: held out, not trained on"
            )
    return _scene_files(BLENDER.name, data_dir, images_dir, pair_by, frames)


def read_nerfstudio(data_dir: Path, images_dir: str, pair_by: str) -> SceneFiles:
    """Reads one JSON file for all views.

    Raises:
        UserError: the file is broken, or a picture is missing.
    """
    frames = _read_frames(data_dir / SINGLE_FILE, is_test=False)
    test = _listed(frames, "test_filenames") or _listed(frames, "val_filenames")
    train = _listed(frames, "train_filenames")
    if train & test:
        say_once(
            f"WARNING: {data_dir / SINGLE_FILE}: {len(train & test)} views are in two "
            "of its lists of filenames: held out, not trained on"
        )
    frames = [
        dataclasses.replace(frame, is_test=frame.values["file_path"] in test)
        for frame in frames
        if not train or frame.values["file_path"] in train | test
    ]
    return _scene_files(NERFSTUDIO.name, data_dir, images_dir, pair_by, frames)


def _read_frames(path: Path, is_test: bool) -> list[_Frame]:
    try:
        content = json.loads(_decoded(path.read_bytes()), object_pairs_hook=_unique)
    except (ValueError, OSError, RecursionError) as error:
        raise UserError(f"{path}: not a JSON file ({error}); write it again") from error
    frames = content.get("frames") if isinstance(content, dict) else None
    if not isinstance(frames, list) or not frames:
        raise UserError(f'{path}: no "frames"; expected a NeRF transforms file')
    shared = {key: value for key, value in content.items() if key != "frames"}
    for index, frame in enumerate(frames):
        listed = frame.get("file_path") if isinstance(frame, dict) else None
        if not isinstance(listed, str) or not listed:
            raise UserError(f'{path}: frame {index} has no "file_path"')
        _check_own_size(path, shared, frame)
    return [
        _Frame(
            path,
            dark_twin(locate(path.parent, f["file_path"])),
            _inherited(shared, f),
            is_test,
        )
        for f in frames
    ]


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


def _check_one_size(frames: Sequence[_Frame], lenses: Sequence[Lens]) -> None:
    """Refuses one focal length in pixels for pictures of several sizes where no w and
    h says for which. Pictures may lie on their sides."""
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


def _inherited(shared: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """A frame's values: its own before the file's. Where it states focal lengths in
    one way, those that the file states in other ways are not meant for it."""
    in_own_way = [ways for ways in FOCAL_KEYS if any(key in own for key in ways)]
    others = {key for ways in FOCAL_KEYS if ways not in in_own_way for key in ways}
    if in_own_way:
        shared = {k: value for k, value in shared.items() if k not in others}
    return {**shared, **own}


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
    return _of_another_machine(folder, spellings[-1]) or folder / listed


def _of_another_machine(folder: Path, listed: str) -> Path | None:
    """What the scene holds at the longest end of a path."""
    parts = PurePosixPath(listed).parts
    for start in range(1, len(parts)):
        path = folder.joinpath(*parts[start:])
        if is_file(find_file(path)):
            return path
    return None


def _name_outside(data_dir: Path, frames: Sequence[_Frame]) -> None:
    """Says so if pictures are taken from elsewhere though the scene has some of these
    names: a scene that was copied still lists those that it was copied from."""
    outside = [f for f in frames if not f.image_path.is_relative_to(data_dir)]
    for frame in outside[:1]:
        inside = _of_another_machine(data_dir, frame.image_path.as_posix())
        if inside:
            say_once(
                f"WARNING: {frame.json_path}: {len(outside)} of {len(frames)} pictures "
                f"are taken from elsewhere, as it says, such as {frame.image_path}, "
                f"not {inside}: list paths from its own folder to use these"
            )


def _scene_files(
    name: str,
    data_dir: Path,
    images_dir: str,
    pair_by: str,
    frames: Sequence[_Frame],
) -> SceneFiles:
    if not images_dir:
        folders: _Folders = {}
        frames = _with_pictures(frames, folders)
        frames = [
            dataclasses.replace(frame, image_path=_find_picture(frame, folders))
            for frame in frames
        ]
        _name_unlisted(frames)
        _name_outside(data_dir, frames)
    # A picture listed for training and for testing is held out: the last one wins.
    unique = {frame.image_path: frame for frame in frames}
    _check_repeated(unique, frames)
    by_name = dict(sorted(zip(_names(unique, data_dir), unique.values(), strict=True)))
    names = tuple(by_name)
    image_paths = tuple(frame.image_path for frame in by_name.values())
    if images_dir:
        chosen = data_dir / images_dir
        paths = pair_poses(names, chosen, pair_by, frames[0].json_path)
        image_paths = tuple(paths[name] for name in names)
    camtoworlds = np.stack([_camtoworld(frame) for frame in by_name.values()])
    points, points_source = _points(data_dir, frames, names, camtoworlds)
    test_names = frozenset(n for n, frame in by_name.items() if frame.is_test)
    lenses = tuple(_lens(frame) for frame in by_name.values())
    _check_one_size(tuple(by_name.values()), lenses)
    return SceneFiles(
        format=name,
        names=names,
        pose_paths=tuple(frame.json_path for frame in by_name.values()),
        image_paths=image_paths,
        lenses=lenses,
        camtoworlds=camtoworlds,
        points=points,
        bounds=_bounds(frames),
        test_names=test_names or None,
        mask_paths=_masks(data_dir, tuple(by_name.values())),
        upright=_means_upright(image_paths, lenses, tuple(by_name.values())),
        points_source=points_source,
        transparent_is_black=name == BLENDER.name,
    )


def _name_unlisted(frames: Sequence[_Frame]) -> None:
    """Names the pictures beside those of the frames that no frame lists."""
    listed = {frame.image_path.name for frame in frames}
    file = frames[0].json_path.name
    chosen = " that its lists of filenames name" * bool(
        frames[0].values.get("train_filenames")
    )
    for folder in sorted({frame.image_path.parent for frame in frames}):
        beside = sorted(
            path.name
            for path in folder.iterdir()
            if image_io.is_image(path) and path.is_file() and not is_metadata(path)
        )
        unlisted = [name for name in beside if name not in listed]
        if unlisted:
            say_once(
                f"{folder}: {len(unlisted)} of {len(beside)} pictures are in no frame "
                f"of {file}{chosen}: {some(unlisted)} left out"
            )


def _check_repeated(unique: Mapping[Path, _Frame], frames: Sequence[_Frame]) -> None:
    """Refuses a picture that is listed twice with two poses."""
    for frame in frames:
        last = unique[frame.image_path]
        if last is frame:
            continue
        if not np.allclose(_camtoworld(last), _camtoworld(frame)):
            raise UserError(
                f"{frame.json_path}: {frame.image_path} is listed with two different "
                "poses; remove the wrong one"
            )


def _means_upright(
    paths: Sequence[Path], lenses: Sequence[Lens], frames: Sequence[_Frame]
) -> bool:
    """Whether poses mean photos as turned by their EXIF orientation, as far as the
    stated sizes tell: not if they fit the stored pixels alone. Where none tells, it is
    taken as meant and said."""
    told, untold = False, []
    for path, lens, frame in zip(paths, lenses, frames, strict=True):
        turned, stored = image_io.read_size(path), image_io.read_size(path, False)
        is_wide = lens.width > lens.height
        if turned != stored and is_wide == (stored[0] > stored[1]):
            print(f"  {path}: taken as stored, without its EXIF turn, as its size says")
            return False
        if turned != stored and {"w", "h"} <= frame.values.keys():
            told = True
        elif image_io.is_turned(path):
            untold.append(path)
    if untold and not told:
        say_once(
            f"WARNING: {untold[0]}: turned as its EXIF orientation says, like "
            f"{len(untold)} of {len(paths)} photos; no stated size tells whether the "
            "poses mean that: if they do not, save the photos without the tag"
        )
    return True


def _with_pictures(frames: Sequence[_Frame], folders: _Folders) -> list[_Frame]:
    """The frames without those test views whose photo is not there: benchmarks list
    pictures that they keep for themselves."""
    missing = [
        frame for frame in frames if frame.is_test and not _alike(frame, folders)
    ]
    if missing:
        shown = ", ".join(frame.image_path.name for frame in missing[:3])
        is_all = len(missing) == sum(frame.is_test for frame in frames)
        instead = "; none is left, so others are held out" if is_all else ""
        print(
            f"WARNING: {missing[0].json_path}: {len(missing)} test views have no photo "
            f"here ({shown}, ...); they are left out{instead}"
        )
    return [frame for frame in frames if frame not in missing]


def _names(paths: Iterable[Path], data_dir: Path) -> list[str]:
    """File names, or paths from the scene's folder where those are ambiguous."""
    paths = list(paths)
    short = [path.name for path in paths]
    if len(set(short)) == len(short):
        return short
    inside = [path.is_relative_to(data_dir) for path in paths]
    return [
        (path.relative_to(data_dir) if is_inside else path).as_posix()
        for path, is_inside in zip(paths, inside, strict=True)
    ]


def _masks(data_dir: Path, frames: Sequence[_Frame]) -> tuple[Path | None, ...]:
    """The masks that the file names, or where it names none those of a folder."""
    stated = tuple(_stated_mask(frame) for frame in frames)
    if any(stated):
        return stated
    inside = [
        frame.image_path.relative_to(data_dir).as_posix()
        if frame.image_path.is_relative_to(data_dir)
        else frame.image_path.name
        for frame in frames
    ]
    return find_masks(data_dir, data_dir, inside)


def _stated_mask(frame: _Frame) -> Path | None:
    listed = frame.values.get("mask_path") or None
    if listed is None:
        return None
    if not isinstance(listed, str):
        raise UserError(
            f"{frame.json_path}: mask_path of {frame.image_path.name} is "
            f"{repr(listed)[:60]}; expected a path"
        )
    path = find_file(locate(frame.json_path.parent, listed))
    if not is_file(path):
        raise UserError(
            f"{path}: mask not found, but {frame.json_path} names it for "
            f"{frame.image_path.name}; copy it there or remove its mask_path"
        )
    return path


def _listed(frames: Sequence[_Frame], key: str) -> set[str]:
    """The ``file_path`` of the frames that the file lists under a key, in whatever
    spelling; none where it has none. Names that mean no frame are named."""
    path, names = frames[0].json_path, frames[0].values.get(key) or []
    if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
        raise UserError(
            f"{path}: {key} is {str(names)[:60]}; expected a list of the file_path of "
            "frames"
        )
    stated = {posixpath.normpath(f.values["file_path"]): f for f in frames}
    names = list(map(posixpath.normpath, names))
    found = match_by_name(names, list(stated))
    lonely = [name for name in names if name not in found]
    if lonely and not found:
        raise UserError(
            f"{path}: {key} ({lonely[0]}, ...) name no file_path of its frames; write "
            "them alike"
        )
    if lonely:
        say_once(f"WARNING: {path}: {key} name what is no frame: {some(lonely)}")
    return {stated[name].values["file_path"] for name in found.values()}


def _find_picture(frame: _Frame, folders: _Folders) -> Path:
    """The listed file; or the one of that stem, with any extension or case."""
    found = _alike(frame, folders)
    if found is None:
        raise UserError(
            f"{frame.image_path}: image not found, but {frame.json_path} lists it; "
            "copy it there or remove its frame"
        )
    return found


def _alike(frame: _Frame, folders: _Folders) -> Path | None:
    path = find_file(frame.image_path)
    if is_file(path):
        return path
    if path.parent not in folders:
        folders[path.parent] = _by_stem(path.parent)
    stems = {composed(stem).casefold() for stem in (path.name, path.stem)}
    alike = sorted(x for stem in stems for x in folders[path.parent].get(stem, ()))
    named = composed(path.name).casefold()
    alike = [other for other in alike if other.name.casefold() == named] or alike
    if len(alike) > 1:
        raise UserError(
            f"{path}: not there, and {alike[0].name} and {alike[1].name} could both be "
            f"meant; write its ending into {frame.json_path}"
        )
    return alike[0] if alike else None


def _by_stem(folder: Path) -> dict[str, list[Path]]:
    """The pictures of a folder by their names up to the ending, in lower case."""
    found: dict[str, list[Path]] = {}
    for path in folder.glob("*") if os.path.isdir(folder) else ():
        if image_io.is_image(path) and is_file(path) and not is_metadata(path):
            found.setdefault(composed(path.stem).casefold(), []).append(path)
    return found


def _camtoworld(frame: _Frame) -> Float[np.ndarray, "3 4"]:
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


def _lens(frame: _Frame) -> Lens:
    width, height = _stated_size(frame)
    foreign = [key for key in NOT_READ if frame.values.get(key, False) is not False]
    if foreign:
        raise UserError(
            f"{frame.json_path}: has {foreign[0]}, which this program does not read; "
            "expected a camera_model of nerfstudio, and its OpenGL poses"
        )
    model = str(frame.values.get("camera_model") or "OPENCV").upper()
    if frame.values.get("is_fisheye", False):
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
        terms = (_number(frame, key, 0.0) for key in DISTORTION_TERMS[model])
        return Lens(model, width, height, (*pinhole, *terms))

    _check_terms(frame, model)
    if model in FISHEYE_MODELS:
        return lens("OPENCV_FISHEYE")
    # The simplest lens that has all of the terms.
    simple, full = lens("OPENCV"), lens("FULL_OPENCV")
    if any(full.params[len(simple.params) :]):
        return full
    return simple if any(simple.params[len(pinhole) :]) else lens("PINHOLE")


def _check_terms(frame: _Frame, model: str) -> None:
    """Refuses distortion that no lens here of that model has.

    k4 to k6 are a denominator in OpenCV's full model alone; nerfstudio's k4 of other
    lenses that are no fisheye belongs to r^8.
    """
    own = DISTORTION_TERMS["OPENCV_FISHEYE"]
    if model not in FISHEYE_MODELS:
        own = DISTORTION_TERMS["FULL_OPENCV"]
        own = own if model == "FULL_OPENCV" else (*DISTORTION_TERMS["OPENCV"], "k3")
    for key in ALL_TERMS:
        if key not in own and _number(frame, key, 0.0) != 0.0:
            raise UserError(
                f"{frame.json_path}: {key} of {frame.image_path.name} is "
                f"{_number(frame, key, 0.0):g}; this program has no such term in a "
                f"{model} lens: calibrate with {', '.join(own)} alone, or undistort "
                "the photos"
            )


def _stated_size(frame: _Frame) -> tuple[int, int]:
    """(width, height) in pixels as stated, else of the picture itself."""
    if not {"w", "h"} <= frame.values.keys():
        return image_io.read_size(_find_picture(frame, {}))
    width, height = round(_number(frame, "w", 0.0)), round(_number(frame, "h", 0.0))
    if min(width, height) < 1:
        raise UserError(f"{frame.json_path}: picture size {width}x{height} is empty")
    return width, height


def _focal_lengths(frame: _Frame, width: int, height: int) -> tuple[float, float]:
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


def _focal_length(frame: _Frame, axis: str, pixels: int) -> float:
    """In pixels, as stated for one axis in any of three ways; 0 if in none."""
    if _number(frame, f"fl_{axis}", 1.0) <= 0.0:
        raise UserError(
            f"{frame.json_path}: fl_{axis} of {frame.image_path.name} is "
            f"{frame.values[f'fl_{axis}']:g}; expected pixels, above 0"
        )
    fov = _number(frame, f"camera_angle_{axis}", 0.0)
    if not 0.0 <= fov < math.pi:
        raise UserError(
            f"{frame.json_path}: camera_angle_{axis} is {fov:g}; expected radians, "
            "less than pi: divide degrees by 57.29578"
        )
    degrees = _number(frame, f"{axis}_fov", 0.0)
    if not 0.0 <= degrees < 180.0:
        raise UserError(
            f"{frame.json_path}: {axis}_fov is {degrees:g}; expected degrees, below 180"
        )
    ways = {
        f"fl_{axis}": _number(frame, f"fl_{axis}", 0.0),
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


def _middle(frame: _Frame, key: str, side: int) -> float:
    """A coordinate of the principal point, in pixels; half the side if not stated."""
    place = _number(frame, key, side / 2.0)
    if not min(FRACTION, 0.1 * side) < place < side:
        raise UserError(
            f"{frame.json_path}: {key} of {frame.image_path.name} is {place:g}, of "
            f"{side} pixels; expected pixels, inside the picture"
        )
    return place


def _with_listed_distortion(frame: _Frame) -> _Frame:
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


def _number(frame: _Frame, key: str, default: float) -> float:
    value = frame.values.get(key, default)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not abs(value) < LARGEST_NUMBER:
        raise UserError(
            f"{frame.json_path}: {key} of {frame.image_path.name} is "
            f"{repr(value)[:60]}; expected a finite number"
        )
    return float(value)


def _bounds(frames: Sequence[_Frame]) -> Float[np.ndarray, "b 2"]:
    """Depths of each frame, where every frame has them."""
    if not all({"near", "far"} <= frame.values.keys() for frame in frames):
        return np.empty((0, 2))
    return np.array([[_number(f, key, 0.0) for key in ("near", "far")] for f in frames])


def _points(
    data_dir: Path,
    frames: Sequence[_Frame],
    names: Sequence[str],
    camtoworlds: Float[np.ndarray, "n 3 4"],
) -> tuple[Float[np.ndarray, "m 3"], str]:
    """Points in the JSON's frame, and what they are. A cloud that cannot be read is
    named and done without: points only say how deep the scene is."""
    listed = {}
    for frame in frames:
        name = frame.values.get("ply_file_path") or None
        if name is not None and not isinstance(name, str):
            raise UserError(
                f"{frame.json_path}: ply_file_path is {repr(name)[:60]}; expected a "
                "path"
            )
        if name:
            listed[name] = frame.json_path
    for name, json_path in listed.items():
        path = find_file(locate(json_path.parent, name))
        try:
            rows = ply.read(path)
            points = np.stack([rows[axis] for axis in "xyz"], -1).astype(np.float64)
        except (UserError, ValueError) as error:
            print(f"WARNING: {json_path}: ply_file_path not used: {one_line(error)}")
            continue
        points = points[np.isfinite(points).all(axis=-1)]
        every = -(-len(points) // MOST_POINTS) or 1
        return points[::every], f"points of {path.name}"
    return _sparse_points(data_dir, names, camtoworlds), "sparse points"


def _sparse_points(
    data_dir: Path, names: Sequence[str], camtoworlds: Float[np.ndarray, "n 3 4"]
) -> Float[np.ndarray, "m 3"]:
    """The points of a COLMAP model beside the JSON, in the JSON's frame.

    None, with a warning, where the two do not show the same cameras: the
    similarity is fitted to the centres and checked on them and on the axes.
    """
    nothing = np.empty((0, 3))
    folder = colmap.find_model(data_dir)
    if folder is None:
        return nothing
    model = colmap.read_model(folder)
    theirs = {PurePosixPath(name).name: i for i, name in enumerate(model.names)}
    ours = {PurePosixPath(name).name: i for i, name in enumerate(names)}
    common = sorted(ours.keys() & theirs.keys())
    source = model.camtoworlds[[theirs[name] for name in common]]
    target = camtoworlds[[ours[name] for name in common]]
    if len(common) < 3 or not np.isfinite(target).all():
        print(f"warning: {folder}: fewer than 3 images have poses; points not used")
        return nothing
    similarity = poses.fit_similarity(source[:, :, 3], target[:, :, 3])
    error = np.abs(similarity.poses(source) - target)
    spread = np.linalg.norm(np.std(target[:, :, 3], axis=0))
    turned = similarity.poses(source)[:, :, :3] * (1.0, -1.0, -1.0)
    if np.abs(turned - target[:, :, :3]).max() < WORST_AXES:
        raise UserError(
            f"{data_dir}: the poses of its JSON have OpenCV's axes, as the model in "
            f"{folder} tells; expected OpenGL's (x right, y up, z backwards): negate "
            "the second and third column of each transform_matrix"
        )
    if error[:, :, 3].max() > WORST_FIT * spread or error[:, :, :3].max() > WORST_AXES:
        print(
            f"warning: {folder}: its cameras are not those of the JSON; points not used"
        )
        return nothing
    return similarity.points(model.points)


BLENDER = Reader(
    "blender",
    "transforms_train.json (with transforms_test.json or transforms_val.json)",
    _matches_blender,
    read_blender,
)
NERFSTUDIO = Reader("nerfstudio", SINGLE_FILE, _matches_nerfstudio, read_nerfstudio)
