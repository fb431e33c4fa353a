# SPDX-License-Identifier: Apache-2.0
"""Splats in files: the PLY of 3D Gaussian Splatting, and glTF with
KHR_gaussian_splatting.

Both hold the same float32 numbers in the same frame, apart from what each states
another way: a PLY holds logits of opacity, logarithms of scales and quaternions
w x y z; a glTF (ratified extension) opacities, scales and quaternions x y z w.
"""

import json
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import ArrayLike, Float

from internal.color import srgb_to_linear
from internal.errors import UserError
from internal.export.splats import Splats, base_colors
from internal.files import atomic, ply

EXTENSION = "KHR_gaussian_splatting"
GLB_MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
FLOAT, ARRAY_BUFFER, POINTS_MODE = 5126, 34962, 0
TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
DRAWN_AS = {
    "kernel": "ellipse",
    "colorSpace": "srgb_rec709_display",
    "projection": "perspective",
    "sortingMethod": "cameraDistance",
}


def write_ply(path: Path, splats: Splats) -> None:
    """Writes the layout of the 3DGS authors' files, atomically.

    ``f_rest`` goes through one channel's harmonics before the next channel's; normals
    are zero, as in every such file.
    """
    harmonics = np.asarray(splats.harmonics)
    rest = harmonics[:, 1:].transpose(0, 2, 1).reshape(len(splats), -1)
    ply.write(
        path,
        {
            **_columns("xyz", splats.points),
            **_columns(("nx", "ny", "nz"), np.zeros((len(splats), 3))),
            **_columns([f"f_dc_{i}" for i in range(3)], harmonics[:, 0]),
            **_columns([f"f_rest_{i}" for i in range(rest.shape[1])], rest),
            "opacity": np.asarray(splats.opacity_logits),
            **_columns([f"scale_{i}" for i in range(3)], splats.log_scales),
            **_columns([f"rot_{i}" for i in range(4)], splats.quaternions),
        },
    )


def _columns(names: Iterable[str], values: ArrayLike) -> dict[str, np.ndarray]:
    return dict(zip(names, np.asarray(values).T, strict=True))


def read_ply(path: Path) -> Splats:
    """Reads what ``write_ply`` wrote.

    Raises:
        UserError: it is another kind of file, or cut short.
    """
    rows = ply.read(path)
    names = rows.dtype.names or ()
    if "opacity" not in names:
        raise UserError(f"{path}: a PLY file without splats; give a splats.ply")

    def columns(prefix: str) -> np.ndarray:
        values = [rows[name] for name in names if name.startswith(prefix)]
        return np.stack(values, axis=-1) if values else np.zeros((len(rows), 0))

    rest = columns("f_rest_").reshape(len(rows), 3, -1).transpose(0, 2, 1)
    return Splats(
        np.stack([rows[axis] for axis in "xyz"], axis=-1),
        columns("rot_"),
        columns("scale_"),
        rows["opacity"],
        np.concatenate([columns("f_dc_")[:, None], rest.astype(np.float32)], axis=1),
    )


def write_glb(path: Path, splats: Splats) -> None:
    """Writes a binary glTF, atomically.

    Readers without the extension show coloured points (``COLOR_0``, which glTF wants
    in linear light).
    """
    attributes = {
        name: np.ascontiguousarray(values, "<f4")
        for name, values in _attributes(splats).items()
    }
    text = json.dumps(_document(attributes), separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    size = sum(values.nbytes for values in attributes.values())
    length = 12 + 8 + len(text) + 8 + size
    with atomic.writing(path) as partial, partial.open("wb") as file:
        file.write(struct.pack("<III", GLB_MAGIC, 2, length))
        file.write(struct.pack("<II", len(text), JSON_CHUNK) + text)
        file.write(struct.pack("<II", size, BINARY_CHUNK))
        for values in attributes.values():
            file.write(values.tobytes())


def _document(attributes: dict[str, np.ndarray]) -> dict[str, Any]:
    """The glTF's JSON: one mesh of points whose attributes follow each other in one
    buffer."""
    sizes = [values.nbytes for values in attributes.values()]
    views = [
        {
            "buffer": 0,
            "byteOffset": sum(sizes[:place]),
            "byteLength": size,
            "target": ARRAY_BUFFER,
        }
        for place, size in enumerate(sizes)
    ]
    accessors: list[dict[str, Any]] = [
        {
            "bufferView": place,
            "componentType": FLOAT,
            "count": len(values),
            "type": TYPES[1 if values.ndim == 1 else values.shape[1]],
        }
        for place, values in enumerate(attributes.values())
    ]
    names = {name: place for place, name in enumerate(attributes)}
    points = attributes["POSITION"]
    accessors[names["POSITION"]] |= {
        "min": points.min(axis=0).astype(float).tolist(),
        "max": points.max(axis=0).astype(float).tolist(),
    }
    primitive = {
        "mode": POINTS_MODE,
        "attributes": names,
        "extensions": {EXTENSION: DRAWN_AS},
    }
    return {
        "asset": {"version": "2.0", "generator": "llnerf-jax"},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "splats"}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": sum(sizes)}],
    }


def _attributes(splats: Splats) -> dict[str, Float[np.ndarray, "n ..."]]:
    """The attributes of the primitive in the extension's units; all 4-byte floats."""
    harmonics = np.asarray(splats.harmonics, np.float64)
    logits = np.asarray(splats.opacity_logits, np.float64)
    opacities = 1.0 / (1.0 + np.exp(-logits))
    quaternions = np.asarray(splats.quaternions, np.float64)
    quaternions /= np.linalg.norm(quaternions, axis=-1, keepdims=True)
    srgb = np.clip(base_colors(harmonics), 0.0, 1.0)
    linear = np.asarray(srgb_to_linear(srgb))
    named = {
        "POSITION": np.asarray(splats.points),
        "COLOR_0": np.concatenate([linear, opacities[:, None]], axis=-1),
        f"{EXTENSION}:ROTATION": np.roll(quaternions, -1, axis=-1),
        f"{EXTENSION}:SCALE": np.exp(np.asarray(splats.log_scales, np.float64)),
        f"{EXTENSION}:OPACITY": opacities,
    }
    for place in range(harmonics.shape[1]):
        degree = int(place**0.5)
        coefficient = place - degree**2
        name = f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{coefficient}"
        named[name] = harmonics[:, place]
    return named
