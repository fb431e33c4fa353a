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
import posixpath
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from internal.cameras import Lens
from internal.errors import UserError, one_line
from internal.files import image_io, ply
from internal.files.listing import find_file, is_file, say_once
from internal.scene.mask_files import find_hiding, find_masks
from internal.scene.pairing import match_by_name, pair_poses, some
from internal.scene.readers.base import POINTS_OF_MODEL, Reader, SceneFiles
from internal.scene.readers.beside import Beside, find_beside
from internal.scene.readers.transforms_entries import (
    Entry,
    locate,
    number,
    read_camtoworld,
    read_entries,
)
from internal.scene.readers.transforms_lenses import check_one_size, read_lens
from internal.scene.readers.transforms_pictures import (
    Folders,
    check_repeated,
    find_picture,
    name_outside,
    name_unlisted,
    with_pictures,
)
from internal.scene.transforms_file import SINGLE_FILE, SPLIT_FILE

MOST_POINTS = 200_000  # of a dense cloud, evenly chosen
FEWEST_COMPARED = 3  # cameras with a model beside the file
WORST_FIT = 0.01  # of the spread of the camera centres
WORST_AXES = 0.05  # between unit vectors: 3 degrees


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
    frames = read_entries(paths["train"], is_test=False)
    if held_out:
        training = {frame.image_path for frame in frames}
        frames += read_entries(paths[held_out], is_test=True)
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
    frames = read_entries(data_dir / SINGLE_FILE, is_test=False)
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


def _scene_files(
    name: str,
    data_dir: Path,
    images_dir: str,
    pair_by: str,
    frames: Sequence[Entry],
) -> SceneFiles:
    if not images_dir:
        folders: Folders = {}
        frames = with_pictures(frames, folders)
        frames = [
            dataclasses.replace(frame, image_path=find_picture(frame, folders))
            for frame in frames
        ]
        name_unlisted(frames)
        name_outside(data_dir, frames)
    # A picture listed for training and for testing is held out: the last one wins.
    unique = {frame.image_path: frame for frame in frames}
    check_repeated(unique, frames)
    by_name = dict(sorted(zip(_names(unique, data_dir), unique.values(), strict=True)))
    names = tuple(by_name)
    image_paths = tuple(frame.image_path for frame in by_name.values())
    if images_dir:
        chosen = data_dir / images_dir
        paths = pair_poses(names, chosen, pair_by, frames[0].json_path)
        image_paths = tuple(paths[name] for name in names)
    camtoworlds = np.stack([read_camtoworld(frame) for frame in by_name.values()])
    points, points_source = _points(data_dir, frames, names, camtoworlds)
    test_names = frozenset(n for n, frame in by_name.items() if frame.is_test)
    lenses = tuple(read_lens(frame) for frame in by_name.values())
    mask_paths, masks_hide = _masks(data_dir, tuple(by_name.values()))
    check_one_size(tuple(by_name.values()), lenses)
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
        mask_paths=mask_paths,
        masks_hide=masks_hide,
        upright=_means_upright(image_paths, lenses, tuple(by_name.values())),
        points_source=points_source,
        transparent_is_black=name == BLENDER.name,
    )


def _means_upright(
    paths: Sequence[Path], lenses: Sequence[Lens], frames: Sequence[Entry]
) -> bool:
    """Whether poses mean photos as turned by their EXIF orientation, as far as the
    stated sizes tell: not if they fit the stored pixels alone. Where none tells, it is
    taken as meant and said."""
    told, untold = False, []
    for path, lens, frame in zip(paths, lenses, frames, strict=True):
        header = image_io.read_header(path)
        turned, stored = header.size(), header.stored_size
        is_wide = lens.width > lens.height
        if turned != stored and is_wide == (stored[0] > stored[1]):
            print(f"  {path}: taken as stored, without its EXIF turn, as its size says")
            return False
        if turned != stored and {"w", "h"} <= frame.values.keys():
            told = True
        elif header.orientation != 1:
            untold.append(path)
    if untold and not told:
        say_once(
            f"WARNING: {untold[0]}: turned as its EXIF orientation says, like "
            f"{len(untold)} of {len(paths)} photos; no stated size tells whether the "
            "poses mean that: if they do not, save the photos without the tag"
        )
    return True


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


def _masks(
    data_dir: Path, frames: Sequence[Entry]
) -> tuple[tuple[Path | None, ...], bool]:
    """The masks that the file names, or where it names none those of a folder, or else
    those of instant-ngp; and whether they say what to ignore, as these do."""
    found = tuple(_stated_mask(frame) for frame in frames)
    if not any(found):
        found = _folders_masks(data_dir, frames)
    hiding = find_hiding([frame.image_path for frame in frames])
    if not any(found):
        return hiding, any(hiding)
    if any(hiding):
        first = next(filter(None, hiding))
        say_once(f"WARNING: {first}, ...: not read, for the scene has other masks")
    return found, False


def _folders_masks(data_dir: Path, frames: Sequence[Entry]) -> tuple[Path | None, ...]:
    inside = [
        frame.image_path.relative_to(data_dir).as_posix()
        if frame.image_path.is_relative_to(data_dir)
        else frame.image_path.name
        for frame in frames
    ]
    return find_masks(data_dir, data_dir, inside)


def _stated_mask(frame: Entry) -> Path | None:
    foreign = [x for x in frame.values if "mask" in x.lower() and x != "mask_path"]
    if foreign:
        say_once(
            f"WARNING: {frame.json_path}: its {foreign[0]} is not read; mask_path "
            "names masks, black where a photo is ignored"
        )
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


def _listed(frames: Sequence[Entry], key: str) -> set[str]:
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


def _bounds(frames: Sequence[Entry]) -> Float[np.ndarray, "b 2"]:
    """Depths of each frame, where every frame has them."""
    if not all({"near", "far"} <= frame.values.keys() for frame in frames):
        return np.empty((0, 2))
    return np.array([[number(f, key, 0.0) for key in ("near", "far")] for f in frames])


def _points(
    data_dir: Path,
    frames: Sequence[Entry],
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
    return _sparse_points(data_dir, names, camtoworlds), POINTS_OF_MODEL


def _sparse_points(
    data_dir: Path, names: Sequence[str], camtoworlds: Float[np.ndarray, "n 3 4"]
) -> Float[np.ndarray, "m 3"]:
    """The points of a COLMAP model beside the JSON, in the JSON's frame.

    None, with a warning, where the two do not show the same cameras.
    """
    nothing = np.empty((0, 3))
    beside = find_beside(data_dir, names, camtoworlds, FEWEST_COMPARED)
    if not isinstance(beside, Beside):
        if beside:
            print(f"warning: {beside}; points not used")
        return nothing
    if beside.turned(opencv=True) < WORST_AXES:
        raise UserError(
            f"{data_dir}: the poses of its JSON have OpenCV's axes, as the model in "
            f"{beside.folder} tells; expected OpenGL's (x right, y up, z backwards): "
            "negate the second and third column of each transform_matrix"
        )
    if beside.is_misplaced(WORST_FIT) or beside.turned() > WORST_AXES:
        print(
            f"warning: {beside.folder}: its cameras are not those of the JSON; points "
            "not used"
        )
        return nothing
    return beside.points


BLENDER = Reader(
    "blender",
    "transforms_train.json (with transforms_test.json or transforms_val.json)",
    _matches_blender,
    read_blender,
)
NERFSTUDIO = Reader("nerfstudio", SINGLE_FILE, _matches_nerfstudio, read_nerfstudio)
