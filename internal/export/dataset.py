# SPDX-License-Identifier: Apache-2.0
"""Lit pictures with poses, as a scene that any NeRF or splatting tool trains on.

``images/`` and two statements of the same pinhole cameras: ``transforms.json``
(nerfstudio, instant-ngp, OpenSplat) and ``sparse/0`` (COLMAP text). Both have coloured
points, which splatting starts from: ``points.ply`` for the former.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from internal.files import image_io, ply
from internal.scene import colmap
from internal.scene.transforms_file import View, write_single

POINTS_FILE = "points.ply"


def write_dataset(
    folder: Path,
    pictures: Sequence[UInt8[np.ndarray, "_height _width 3"]],
    model: colmap.Reconstruction,
    colors: UInt8[np.ndarray, "m 3"],
    bounds: tuple[float, float],
) -> None:
    """Writes pictures and cameras into an existing folder.

    Args:
        pictures: one per view of ``model``, whose names end in .png.
        model: pinhole cameras and points, in the frame of the scene's pose file.
        colors: of the model's points.
        bounds: near and far depth.
    """
    for name, picture in zip(model.names, pictures, strict=True):
        path = folder / "images" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        image_io.write(path, picture.astype(np.float32) / 255.0)
    # Without normals: not all readers of these look at more than x y z and colours.
    ply.write(
        folder / POINTS_FILE,
        {
            **dict(zip("xyz", model.points.T, strict=True)),
            **dict(zip(("red", "green", "blue"), colors.T, strict=True)),
        },
    )
    views = [
        View(f"images/{name}", lens, camtoworld)
        for name, lens, camtoworld in zip(
            model.names, model.lenses, model.camtoworlds, strict=True
        )
    ]
    write_single(folder, views, bounds=bounds, points_file=POINTS_FILE)
    sparse = folder / "sparse" / "0"
    sparse.mkdir(parents=True)
    colmap.write_model(sparse, model, colors)
