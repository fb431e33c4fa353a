# SPDX-License-Identifier: Apache-2.0
"""LLFF scenes: ``poses_bounds.npy`` beside a folder of pictures.

Each row holds a 3x5 matrix and two depths. The matrix has the camera's down,
right and backward axes, its centre, and (height, width, focal length) in pixels
of the full-size photos, as stored: the EXIF orientation does not count. Row i
belongs to the i-th picture in order of names: the file names none, so their order is
what pairs them, and it is printed.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from internal.cameras import Lens
from internal.errors import UserError, one_line
from internal.files.listing import list_pictures, say_once
from internal.scene.mask_files import find_masks
from internal.scene.pairing import counts_up, find_input_folder
from internal.scene.readers.base import Reader, SceneFiles
from internal.scene.readers.beside import Beside, find_beside

POSES_FILE = "poses_bounds.npy"
FEWEST_COMPARED = 4  # fewer cameras fit nearly always
WORST_FIT = 0.05  # of the spread of the camera centres
LARGEST_NUMBER = 1e9  # pixels or units: beyond, it is a mistake


def matches(data_dir: Path) -> bool:
    return (data_dir / POSES_FILE).is_file()


def read(data_dir: Path, images_dir: str, pair_by: str) -> SceneFiles:
    """Reads the poses and pairs them with the pictures of a folder, in order whatever
    ``pair_by`` says.

    Raises:
        UserError: the file is broken, or poses and pictures do not count alike.
    """
    poses_path = data_dir / POSES_FILE
    rows = _read_rows(poses_path)
    folder = find_input_folder(data_dir, images_dir)
    names = list_pictures(folder)
    if len(names) != len(rows):
        raise UserError(
            f"{poses_path}: {len(rows)} poses but {len(names)} pictures in {folder}; "
            "poses belong to pictures by sorted order, so the counts must agree: "
            "remove the pictures that have no pose"
        )
    as_text = "" if counts_up(names) else f", as text: {', '.join(names[:3])}, ..."
    say_once(
        f"{poses_path}: its {len(rows)} poses carry no names: they are paired by order "
        f"with the pictures of {folder}, from {names[0]} to {names[-1]}{as_text}"
    )
    matrices = rows[:, :15].reshape(-1, 3, 5)
    camtoworlds = _opengl_from_llff(matrices[:, :, :4])
    _compare_with_model(data_dir, names, camtoworlds)
    return SceneFiles(
        format=LLFF.name,
        names=names,
        pose_paths=(poses_path,) * len(names),
        image_paths=tuple(folder / name for name in names),
        lenses=tuple(_lens(*map(float, hwf)) for hwf in matrices[:, :, 4]),
        camtoworlds=camtoworlds,
        points=np.empty((0, 3)),
        bounds=rows[:, 15:],
        test_names=None,
        mask_paths=find_masks(data_dir, folder, names),
        upright=False,
    )


def _compare_with_model(
    data_dir: Path, names: Sequence[str], camtoworlds: Float[np.ndarray, "n 3 4"]
) -> None:
    """Says so where a COLMAP model beside the file, which has names, places the photos
    elsewhere than the rows in their order."""
    try:
        beside = find_beside(data_dir, names, camtoworlds, FEWEST_COMPARED)
    except UserError:  # it is not what is read
        return
    if isinstance(beside, Beside) and beside.is_misplaced(WORST_FIT):
        say_once(
            f"WARNING: {data_dir / POSES_FILE}: its rows, in the order of the "
            f"pictures' names, place them elsewhere than {beside.folder}: rows and "
            "pictures are in different orders, or one of the two is of other photos"
        )


def _read_rows(path: Path) -> Float[np.ndarray, "n 17"]:
    try:
        rows = np.load(path, allow_pickle=False)
    except Exception as error:  # a broken header raises what Python's parser raises
        reason = one_line(error)
        raise UserError(
            f"{path}: not a NumPy file ({reason}); copy it again"
        ) from error
    if not isinstance(rows, np.ndarray) or rows.dtype.kind not in "fiu":
        raise UserError(f"{path}: not an array of numbers; copy it again")
    if rows.ndim != 2 or rows.shape[1] != 17:
        raise UserError(
            f"{path}: shape {rows.shape}; expected (views, 17), as written by LLFF's "
            "imgs2poses.py"
        )
    rows = rows.astype(np.float64)
    stated = rows[:, [4, 9, 14, 15, 16]]
    broken = ~((stated > 0.0) & (stated < LARGEST_NUMBER)).all(axis=1)
    if broken.any():
        raise UserError(
            f"{path}: picture size, focal length or depths of row "
            f"{int(broken.argmax())} are not positive numbers; run LLFF's "
            "imgs2poses.py again"
        )
    return rows


def _lens(height: float, width: float, focal: float) -> Lens:
    size = round(width), round(height)
    return Lens("SIMPLE_PINHOLE", *size, (focal, size[0] / 2.0, size[1] / 2.0))


def _opengl_from_llff(
    poses: Float[np.ndarray, "n 3 4"],
) -> Float[np.ndarray, "n 3 4"]:
    down, right, backward, centre = np.moveaxis(poses, -1, 0)
    return np.stack([right, -down, backward, centre], axis=-1)


LLFF = Reader("llff", POSES_FILE, matches, read)
