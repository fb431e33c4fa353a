# SPDX-License-Identifier: Apache-2.0
"""Everything that export.py writes, from rendered views to files.

All files are in the frame and units of the scene's pose file, so that they line up
with what the user has already.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import numpy as np
from jaxtyping import Float

from internal.errors import UserError
from internal.export import shapes, splat_files
from internal.export.bake import bake
from internal.export.dataset import write_dataset
from internal.export.density import Density, normals
from internal.export.shapes import Cloud, Mesh
from internal.export.sightings import Sighting, mean_colors
from internal.export.splats import Splats, carry_over
from internal.files.made_folder import Facts
from internal.poses import Similarity
from internal.scene import colmap
from internal.scene.scene import Scene

SPLAT_LOOKS = {"enhanced": "lit", "dark": "as dark as the photos"}
LOOKS = {"enhanced": ("enhanced",), "dark": ("dark",), "both": ("enhanced", "dark")}

COLMAP_POINTS = 20_000  # enough to start splats from
FINEST = 1e-3  # of the cloud's extent
FEWEST_VIEWS = 2  # that must agree on a point of the cloud
SMALLEST_STEP = 2e-3  # of normals' differences, share of the distance to the cameras


@dataclasses.dataclass(frozen=True)
class Wanted:
    """How much detail is exported."""

    points: int = 200_000
    resolution: int = 160  # cells along the mesh's longest side
    splats: int | None = None  # at most; None: no files of splats
    look: str = "enhanced"  # of the splats, of LOOKS


def write_all(
    folder: Path,
    scene: Scene,
    sightings: Sequence[Sighting],
    between: Sequence[Sighting],
    density: Density,
    wanted: Wanted,
) -> Facts:
    """Writes the cloud, the mesh, the splats and the dataset; returns sizes and bounds.

    Args:
        sightings: of the scene's views.
        between: of ``between_views``, where splats are wanted.

    Raises:
        UserError: no view ends on a surface.
    """
    cloud = find_cloud(scene, sightings, density, wanted.points)
    mesh = find_mesh(scene, sightings, density, cloud.points, wanted.resolution)
    cloud, mesh = _in_world(cloud, mesh, scene.model_from_world.inverse())
    warn_of_rounding(cloud.points)
    shapes.write_cloud(folder / "points.ply", cloud)
    for name in ("mesh.ply", "mesh.glb"):
        shapes.write_mesh(folder / name, mesh)
    facts: Facts = {"views": float(len(sightings)), "points": float(len(cloud.points))}
    facts |= {"triangles": float(len(mesh.faces))}
    facts |= _bounds("points", cloud.points) | _bounds("mesh", mesh.vertices)
    if wanted.splats:
        looks = LOOKS[wanted.look]
        baked = bake(scene, sightings, between, density, wanted.splats, looks)
        facts |= _write_splats(folder, baked, scene)
    _write_dataset(folder / "dataset", scene, sightings, cloud)
    return facts


def warn_of_rounding(points: Float[np.ndarray, "n 3"]) -> None:
    """Says so where single precision, which PLY and glTF files have, cannot tell what
    lies side by side: far from the origin, as in the coordinates of maps."""
    farthest, extent = np.abs(points).max(), np.ptp(points, axis=0).max()
    step = float(np.spacing(np.float32(farthest)))
    if step > FINEST * extent:
        print(
            f"WARNING: coordinates reach {farthest:.3g}, where PLY and glTF files have "
            f"steps of {step:.2g}, in a scene {extent:.3g} across: subtract an offset "
            "from the poses and train anew for files that are finer"
        )


def _in_world(
    cloud: Cloud, mesh: Mesh, world_from_model: Similarity
) -> tuple[Cloud, Mesh]:
    """Both in the frame of the scene's pose file."""
    in_world = world_from_model.points
    outwards = cloud.normals @ world_from_model.rotation.T
    return (
        Cloud(in_world(cloud.points), outwards, cloud.colors),
        dataclasses.replace(mesh, vertices=in_world(mesh.vertices)),
    )


def _write_splats(folder: Path, baked: dict[str, Splats], scene: Scene) -> Facts:
    """Writes each look as PLY and glTF; returns how many splats each has."""
    facts: Facts = {}
    for look, splats in baked.items():
        name = splats_name(look)
        facts[name] = float(len(splats))
        ours = carry_over(splats, scene.model_from_world.inverse())
        splat_files.write_ply(folder / f"{name}.ply", ours)
        splat_files.write_glb(folder / f"{name}.glb", ours)
    return facts


def _write_dataset(
    folder: Path, scene: Scene, sightings: Sequence[Sighting], cloud: Cloud
) -> None:
    """Writes the lit pictures with their cameras and some points of the cloud."""
    names = tuple(
        PurePosixPath(n).with_suffix(".png").as_posix() for n in scene.view_names
    )
    some = slice(None, None, -(-len(cloud.points) // COLMAP_POINTS))
    camtoworlds = np.asarray(scene.cameras.camtoworlds, np.float64)
    poses = scene.model_from_world.inverse().poses(camtoworlds)
    model = colmap.Reconstruction(names, scene.lenses, poses, cloud.points[some])
    folder.mkdir()
    pictures = [sighting.srgb for sighting in sightings]
    write_dataset(folder, pictures, model, cloud.colors[some], (scene.near, scene.far))


def find_cloud(
    scene: Scene, sightings: Sequence[Sighting], density: Density, count: int
) -> Cloud:
    """At most ``count`` points where rays of the views end, in the model's frame.

    Only points on which several views agree.

    Raises:
        UserError: there are none.
    """
    pixels = sum(int(sighting.is_surface.sum()) for sighting in sightings)
    every = max(-(-pixels // count), 1)
    ends = [sighting.points[sighting.is_surface] for sighting in sightings]
    colors = [sighting.srgb[sighting.is_surface] for sighting in sightings]
    points, own_colors = np.concatenate(ends)[::every], np.concatenate(colors)[::every]
    seen, _ = mean_colors(points, sightings)
    agreed = seen >= min(FEWEST_VIEWS, len(sightings))
    if not agreed.any():
        raise UserError(
            "no two views agree on any surface: the model knows no shape yet; train "
            "it for longer"
        )
    points = points[agreed]
    steps = SMALLEST_STEP * _distances(scene, points)
    outwards = normals(density, scene.space, points, steps)
    return Cloud(points, outwards, own_colors[agreed])


def find_mesh(
    scene: Scene,
    sightings: Sequence[Sighting],
    density: Density,
    points: Float[np.ndarray, "n 3"],
    resolution: int,
) -> Mesh:
    """The surface through the cloud, cropped to what the views saw, model frame.

    Raises:
        UserError: there is none.
    """
    in_field = scene.space.to_field(points)
    level = shapes.choose_threshold(density(in_field))
    vertices, faces = shapes.isosurface(density, in_field, level, resolution)
    vertices = scene.space.from_field(vertices)
    seen, colors = mean_colors(vertices, sightings)
    mesh = shapes.keep_faces(Mesh(vertices, faces, colors), seen > 0)
    if len(mesh.faces) == 0:
        raise UserError(
            "no surface is where the views look: the model knows no shape yet; train "
            "it for longer"
        )
    steps = SMALLEST_STEP * _distances(scene, mesh.vertices)
    return shapes.face_outwards(
        mesh, normals(density, scene.space, mesh.vertices, steps)
    )


def splats_name(look: str) -> str:
    """The name, without ending, of the files of splats in one of the two looks."""
    return "splats" if look == "enhanced" else f"splats_{look}"


def list_exported(facts: Facts) -> list[tuple[str, str]]:
    """What was exported, a line per file: (file, size and bounds)."""

    def box(name: str) -> str:
        ends = [f"{facts[f'{name}_{axis}0']:.3g} to {facts[f'{name}_{axis}1']:.3g}"
                for axis in "xyz"]  # fmt: skip
        return f"x {ends[0]}, y {ends[1]}, z {ends[2]}"

    triangles = f"{facts['triangles']:,.0f} triangles, {box('mesh')}"
    splats = [
        (f"{name}.{kind}", f"{facts[name]:,.0f} Gaussian splats, {meaning}")
        for name, meaning in (
            (splats_name(look), SPLAT_LOOKS[look]) for look in SPLAT_LOOKS
        )
        if name in facts
        for kind in ("ply", "glb")
    ]
    return [
        *splats,
        ("points.ply", f"{facts['points']:,.0f} points, {box('points')}"),
        ("mesh.ply", triangles),
        ("mesh.glb", triangles),
        ("dataset", f"{facts['views']:,.0f} lit pictures with cameras"),
    ]


def _distances(
    scene: Scene, points: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, " n"]:
    """From each point to the middle of the cameras."""
    middle = np.asarray(scene.cameras.camtoworlds)[:, :, 3].mean(axis=0)
    return np.linalg.norm(points - middle, axis=-1)


def _bounds(name: str, points: Float[np.ndarray, "n 3"]) -> Facts:
    if len(points) == 0:
        points = np.zeros((1, 3))
    ends = points.min(axis=0), points.max(axis=0)
    return {
        f"{name}_{axis}{end}": float(ends[end][i])
        for i, axis in enumerate("xyz")
        for end in (0, 1)
    }
