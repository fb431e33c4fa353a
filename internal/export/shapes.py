# SPDX-License-Identifier: Apache-2.0
"""Point clouds and meshes of a scene, and their files.

The only module that imports trimesh; marching cubes are scikit-image's (both of the
extra ``export``).
Coordinates are those of whoever calls; colours are 8-bit sRGB.
"""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8

from internal.export.density import Density
from internal.files import atomic, ply

MARGIN = 0.02  # of the box around the points


@dataclasses.dataclass(frozen=True)
class Cloud:
    """Coloured points with normals."""

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    colors: UInt8[np.ndarray, "n 3"]


@dataclasses.dataclass(frozen=True)
class Mesh:
    """Triangles with coloured vertices; they turn counter-clockwise seen from
    outside."""

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "m 3"]
    colors: UInt8[np.ndarray, "n 3"]


def choose_threshold(densities: Float[np.ndarray, " n"]) -> float:
    """The level that counts as solid.

    Half of a ray's weight lies before its median depth, on the rising flank of the
    density; a quarter of all rays rise more gently than the level chosen here.

    Args:
        densities: at the points where rays' weights reach their half.
    """
    return float(np.percentile(densities, 25.0))


def isosurface(
    density: Density,
    points: Float[np.ndarray, "n 3"],
    level: float,
    resolution: int,
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Marching cubes over the box around ``points``, but for its outermost per mille.

    Args:
        resolution: cells along the longest side of the box.

    Returns:
        Vertices, in the space of the points, and faces; none where the density
        never crosses the level.
    """
    from skimage.measure import marching_cubes

    low, high = np.percentile(points, [0.1, 99.9], axis=0)
    low, high = low - MARGIN * (high - low), high + MARGIN * (high - low)
    cell = (high - low).max() / resolution
    counts = np.maximum(np.ceil((high - low) / cell).astype(int), 1) + 1
    axes = [low[i] + cell * np.arange(counts[i]) for i in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).astype(np.float32)
    volume = density(grid.reshape(-1, 3)).reshape(grid.shape[:3])
    if not volume.min() < level < volume.max():
        return np.zeros((0, 3)), np.zeros((0, 3), int)
    vertices, faces, _, _ = marching_cubes(volume, level, spacing=(cell,) * 3)
    return low + vertices.astype(np.float64), faces.astype(int)


def keep_faces(mesh: Mesh, keep: np.ndarray) -> Mesh:
    """The faces whose corners are all kept, without the vertices nobody needs."""
    faces = mesh.faces[keep[mesh.faces].all(axis=-1)]
    used, renumbered = np.unique(faces, return_inverse=True)
    return Mesh(mesh.vertices[used], renumbered.reshape(-1, 3), mesh.colors[used])


def face_outwards(mesh: Mesh, outwards: Float[np.ndarray, "n 3"]) -> Mesh:
    """Turns all faces over if most of them disagree with the vertices' normals."""
    corners = mesh.vertices[mesh.faces]
    turned = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    agreement = np.einsum("fi,fi->f", turned, outwards[mesh.faces].mean(axis=1))
    faces = mesh.faces if agreement.sum() >= 0.0 else mesh.faces[:, ::-1]
    return dataclasses.replace(mesh, faces=faces)


def write_cloud(path: Path, cloud: Cloud) -> None:
    """Writes a PLY with normals and colours, atomically."""
    names = ("x", "y", "z", "nx", "ny", "nz", "red", "green", "blue")
    columns = (*cloud.points.T, *cloud.normals.T, *cloud.colors.T)
    ply.write(path, dict(zip(names, columns, strict=True)))


def write_mesh(path: Path, mesh: Mesh) -> None:
    """Writes PLY or GLB by the name's ending, atomically."""
    import trimesh

    colors = np.pad(mesh.colors, ((0, 0), (0, 1)), constant_values=255)
    triangles = trimesh.Trimesh(
        mesh.vertices, mesh.faces, vertex_colors=colors, process=False
    )
    content: Any = triangles.export(file_type=path.suffix[1:])
    with atomic.writing(path) as partial:
        partial.write_bytes(content)
