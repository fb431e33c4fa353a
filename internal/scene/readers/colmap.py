# SPDX-License-Identifier: Apache-2.0
"""COLMAP scenes: a sparse model beside a folder of pictures."""

from pathlib import Path

import numpy as np

from internal.errors import UserError
from internal.scene.colmap import MODEL_FOLDERS, find_model, read_model
from internal.scene.pairing import find_input_folder, pair_by_name
from internal.scene.readers.base import Reader, SceneFiles


def matches(data_dir: Path) -> bool:
    return find_model(data_dir) is not None


def read(data_dir: Path, images_dir: str) -> SceneFiles:
    """Reads the registered images; photos that COLMAP could not place are left out.

    Raises:
        UserError: the model is broken or pictures are missing.
    """
    folder = find_model(data_dir)
    if folder is None:
        raise UserError(f"{data_dir}: no COLMAP model; looked for {COLMAP.looked_for}")
    model = read_model(folder)
    paths, _ = pair_by_name(model.names, find_input_folder(data_dir, images_dir))
    return SceneFiles(
        format=COLMAP.name,
        names=model.names,
        pose_paths=(folder,) * len(model.names),
        image_paths=paths,
        lenses=model.lenses,
        camtoworlds=model.camtoworlds,
        points=model.points,
        bounds=np.empty((0, 2)),
        test_names=None,
    )


COLMAP = Reader(
    "colmap",
    f"cameras, images and points3D (.bin or .txt) in {', '.join(MODEL_FOLDERS)}",
    matches,
    read,
)
