# SPDX-License-Identifier: Apache-2.0
"""COLMAP scenes: a sparse model beside a folder of pictures.

Poses belong to the pixels as stored: COLMAP does not turn photos by EXIF.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from internal.errors import UserError, one_line
from internal.files.listing import list_pictures, say_once
from internal.scene.colmap import MODEL_ROOTS, find_model, find_models, read_model
from internal.scene.mask_files import find_masks
from internal.scene.pairing import find_input_folder, match_by_name, pair_poses, some
from internal.scene.readers.base import Reader, SceneFiles

SPLIT = "test.txt"  # in the model's folder


def matches(data_dir: Path) -> bool:
    return bool(find_models(data_dir))


def read(data_dir: Path, images_dir: str, pair_by: str) -> SceneFiles:
    """Reads the registered images; photos that COLMAP could not place are left out.

    Raises:
        UserError: the model is broken or no picture is of it.
    """
    folder = find_model(data_dir)
    if folder is None:
        raise UserError(f"{data_dir}: no COLMAP model; looked for {COLMAP.looked_for}")
    model = read_model(folder)
    pictures = find_input_folder(data_dir, images_dir)
    paths = _pair(folder, model.names, pictures, pair_by)
    kept = [view for view, name in enumerate(model.names) if name in paths]
    return SceneFiles(
        format=COLMAP.name,
        names=tuple(model.names[view] for view in kept),
        pose_paths=(folder,) * len(kept),
        image_paths=tuple(paths[model.names[view]] for view in kept),
        lenses=tuple(model.lenses[view] for view in kept),
        camtoworlds=model.camtoworlds[kept],
        points=model.points,
        bounds=np.empty((0, 2)),
        test_names=_held_out(folder, [model.names[view] for view in kept]),
        mask_paths=find_masks(data_dir, pictures, [model.names[v] for v in kept]),
        upright=False,
    )


def _pair(
    folder: Path, names: Sequence[str], pictures: Path, pair_by: str
) -> dict[str, Path]:
    """The picture of each pose, by name; says which have none, either way.

    Where no name fits, pictures pair in other ways if ``pair_by`` allows it.
    """
    listed = list_pictures(pictures)
    matched = match_by_name(names, listed)
    if not matched and pair_by != "name":
        return pair_poses(names, pictures, pair_by, folder)
    if not matched:
        raise UserError(
            f"{pictures}: none of its {len(listed)} pictures, e.g. {listed[0]!r}, is "
            f"named in {folder}, e.g. {names[0]!r}; copy the photos that COLMAP read, "
            "under their names, or allow other pairs with Config.pair_by = 'number' "
            "or 'order'"
        )
    gone = [name for name in names if name not in matched]
    if gone:
        say_once(
            f"{folder}: {len(gone)} of {len(names)} poses have no photo in {pictures}: "
            f"{some(gone)} left out"
        )
    unposed = sorted(set(listed) - set(matched.values()))
    if unposed:
        say_once(
            f"{pictures}: {len(unposed)} of {len(listed)} photos have no pose in "
            f"{folder}: {some(unposed)} left out"
        )
    return {name: pictures / matched[name] for name in matched}


def _held_out(folder: Path, names: Sequence[str]) -> frozenset[str] | None:
    """The views that a ``test.txt`` beside the model lists, as 3D Gaussian splatting
    reads it; None without one."""
    path = folder / SPLIT
    if not path.is_file():
        return None
    try:
        listed = path.read_text(encoding="utf-8-sig").split("\n")
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: not a text ({one_line(error)}); write it") from error
    wanted = [line.strip() for line in listed if line.strip()]
    found = match_by_name(wanted, names)
    if wanted and not found:
        raise UserError(
            f"{path}: names no view of the model, e.g. {wanted[0][:80]!r}; expected a "
            f"name such as {names[0]!r} a line"
        )
    gone = [name for name in wanted if name not in found]
    if gone:
        say_once(f"WARNING: {path}: names views that are not there: {some(gone)}")
    return frozenset(found.values()) or None


COLMAP = Reader(
    "colmap",
    f"cameras, images and points3D (.bin or .txt) in {', '.join(MODEL_ROOTS)} "
    "or a numbered folder of these such as sparse/0",
    matches,
    read,
)
