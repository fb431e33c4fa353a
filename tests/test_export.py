# SPDX-License-Identifier: Apache-2.0
"""Exports are shapes that other tools open, and a dataset that we read back.

A ball of known density stands for a trained field: where its surface, normals and
colours are is known exactly.
"""

import dataclasses
import json

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

import train as train_script
from internal.cameras import Lens
from internal.coord import ForwardFacing, Unbounded
from internal.errors import UserError
from internal.export import folder as export_folder
from internal.export import shapes
from internal.export.density import from_field_space, normals, to_field_space
from internal.export.sightings import mean_colors, surface_points
from internal.poses import transform_points
from internal.scene import colmap
from internal.scene.scene import load_scene
from internal.structs import Rendering
from tests.conftest import flags
from tests.scene_writers import facing_world, surrounding_world, write_blender

NDC = ForwardFacing(np.array([2.0, 2.5], np.float32))
BALL_OF_TWO = Unbounded(np.float32(0.1), np.float32(100.0))
RADIUS = 0.5


def ball(points):
    """Density that falls through 10 at the surface of a ball about the origin."""
    return 20.0 / (1.0 + np.exp(40.0 * (np.linalg.norm(points, axis=-1) - RADIUS)))


@settings(deadline=None)
@given(
    st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-20.0, -1.0),
    st.sampled_from([NDC, BALL_OF_TWO]),
)  # fmt: skip
def test_field_space_and_back_is_the_identity(x, y, z, space):
    point = np.array([[x, y, z]])
    again = from_field_space(space, to_field_space(space, point))
    np.testing.assert_allclose(again, point, rtol=2e-3, atol=1e-5)


def test_ndc_of_the_near_plane_and_of_infinity():
    ends = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, -1e9]])
    np.testing.assert_allclose(to_field_space(NDC, ends)[:, 2], [-1.0, 1.0], atol=1e-6)


@pytest.mark.parametrize("space", [NDC, BALL_OF_TWO])
def test_rays_end_at_their_depth(space):
    camtoworld = np.array([[1.0, 0, 0, 0.1], [0, 1, 0, -0.2], [0, 0, 1, 0.3]])
    directions = np.array([[0.2, 0.1, -1.0], [-0.3, 0.0, -1.0]])
    depth = np.array([2.0, 5.0])
    points = surface_points(space, camtoworld, directions, depth)
    along = points - camtoworld[:, 3]
    np.testing.assert_allclose(along / -along[:, 2:], directions, atol=1e-12)
    # Forward-facing depth counts from the mean camera, at z = 0, not from this one.
    z = -depth if space is NDC else camtoworld[2, 3] - depth
    np.testing.assert_allclose(points[:, 2], z)


def test_normals_of_a_ball_point_away_from_its_middle():
    rng = np.random.default_rng(0)
    outwards = rng.normal(size=(50, 3))
    outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
    found = normals(ball, BALL_OF_TWO, RADIUS * outwards, np.full(50, 1e-3))
    np.testing.assert_allclose(found, outwards, atol=1e-3)


def ball_mesh():
    corners = np.array([[-0.7, -0.7, -0.7], [0.7, 0.7, 0.7]]).repeat(600, axis=0)
    vertices, faces = shapes.isosurface(ball, corners, 10.0, 40)
    colors = np.full(vertices.shape, 200, np.uint8)
    return shapes.face_outwards(shapes.Mesh(vertices, faces, colors), vertices)


def test_marching_cubes_of_a_ball_is_the_ball(tmp_path):
    shapes.write_mesh(tmp_path / "ball.glb", ball_mesh())
    opened = trimesh.load(tmp_path / "ball.glb", force="mesh")
    radii = np.linalg.norm(opened.vertices, axis=-1)
    np.testing.assert_allclose(radii, RADIUS, atol=0.01)
    merged = trimesh.Trimesh(opened.vertices, opened.faces)
    assert merged.is_watertight
    # Positive only if faces turn outwards: 4/3 pi 0.5^3 = 0.524.
    assert merged.volume == pytest.approx(0.524, rel=0.02)


def test_a_density_below_the_level_has_no_surface():
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    vertices, faces = shapes.isosurface(ball, corners, 1e6, 8)
    assert len(vertices) == len(faces) == 0


def test_dropped_vertices_take_their_faces_along():
    mesh = ball_mesh()
    half = shapes.keep_faces(mesh, mesh.vertices[:, 0] > 0.0)
    assert 0.4 < len(half.faces) / len(mesh.faces) < 0.5
    assert half.vertices[:, 0].min() > 0.0
    assert half.faces.max() == len(half.vertices) - 1


def test_a_cloud_is_opened_with_colours_and_normals(tmp_path):
    rng = np.random.default_rng(0)
    points, colors = rng.random((20, 3)), rng.integers(0, 255, (20, 3)).astype("u1")
    cloud = shapes.Cloud(points, np.tile([0.0, 0.6, 0.8], (20, 1)), colors)
    shapes.write_cloud(tmp_path / "cloud.ply", cloud)
    opened = trimesh.load(tmp_path / "cloud.ply")
    assert isinstance(opened, trimesh.PointCloud)
    np.testing.assert_allclose(opened.vertices, points, atol=1e-6)
    np.testing.assert_array_equal(opened.colors[:, :3], colors)
    content = opened.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_allclose(content["nz"].reshape(-1), 0.8, atol=1e-6)


@pytest.fixture(scope="module", params=[facing_world, surrounding_world])
def scene(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    world = request.param()
    write_blender(folder, world, test=(0, 3))
    return load_scene(folder, split="train", near=2.0, far=9.0)


def ball_in(scene):
    """A ball where the cameras look, as the renderer and the field would see it."""
    ours = export_folder.undistorted(scene)
    poses = np.asarray(ours.cameras.camtoworlds, np.float64)
    facing = isinstance(ours.space, ForwardFacing)
    scale = np.cbrt(np.linalg.det(ours.model_from_world[:3, :3]))
    middle = transform_points(
        ours.model_from_world, np.array([[0.0, 0.0, -5.0] if facing else [1.0, 2, 3]])
    )[0]
    radius = 0.8 * scale

    def density(points):
        apart = from_field_space(ours.space, np.asarray(points, float)) - middle
        inside = radius - np.linalg.norm(apart, axis=-1)
        return 100.0 / (1.0 + np.exp(-np.clip(60.0 * inside / radius, -50.0, 50.0)))

    def render(view):
        lens, pose = ours.lenses[view], poses[view]
        rays = colmap.lens_directions(lens).astype(float) @ pose[:, :3].T
        to_middle = middle - pose[:, 3]
        a, b = (rays**2).sum(-1), rays @ to_middle
        root = b**2 - a * (to_middle @ to_middle - radius**2)
        hit = root > 0.0
        t = (b - np.sqrt(np.maximum(root, 0.0))) / a
        z = pose[2, 3] + t * rays[:, 2]
        depth = np.where(hit, -z if facing else t, 1e3)
        shape = (lens.height, lens.width, 1)
        rgb = np.where(hit[:, None], [0.8, 0.4, 0.2], 0.0).reshape(*shape[:2], 3)
        return Rendering(jnp.float32(rgb), jnp.float32(depth.reshape(shape)))

    return ours, density, render, middle, radius


@pytest.fixture(scope="module")
def exported(scene, tmp_path_factory):
    ours, density, render, middle, radius = ball_in(scene)
    folder = tmp_path_factory.mktemp("export")
    sightings = export_folder.look_around(ours, render)
    wanted = export_folder.Wanted(points=500, resolution=48)
    facts = export_folder.write_all(folder, ours, sightings, density, wanted)
    world = np.linalg.inv(ours.model_from_world)
    scale = np.cbrt(np.linalg.det(world[:3, :3]))
    centre = transform_points(world, middle[None])[0]
    return folder, ours, facts, centre, radius * scale, sightings


def test_the_cloud_and_the_mesh_lie_on_the_ball_in_the_users_frame(exported):
    folder, _, facts, centre, radius, _ = exported
    cloud = trimesh.load(folder / "points.ply")
    assert 50 < len(cloud.vertices) == facts["points"] <= 500
    apart = np.linalg.norm(cloud.vertices - centre, axis=-1)
    np.testing.assert_allclose(apart, radius, rtol=0.02)
    for name in ("mesh.ply", "mesh.glb"):
        mesh = trimesh.load(folder / name, force="mesh")
        assert len(mesh.faces) == facts["triangles"] > 100
        apart = np.linalg.norm(mesh.vertices - centre, axis=-1)
        np.testing.assert_allclose(apart, radius, rtol=0.1)
        outwards = mesh.triangles_center - centre
        assert (np.einsum("fi,fi->f", mesh.face_normals, outwards) > 0).mean() > 0.95
        np.testing.assert_allclose(
            np.median(mesh.visual.vertex_colors, axis=0), [204, 102, 51, 255], atol=1
        )


def test_normals_of_the_cloud_are_those_of_the_ball(exported):
    folder, _, _, centre, radius, _ = exported
    cloud = trimesh.load(folder / "points.ply")
    data = cloud.metadata["_ply_raw"]["vertex"]["data"]
    found = np.stack([data[n].reshape(-1) for n in ("nx", "ny", "nz")], axis=-1)
    expected = (cloud.vertices - centre) / radius
    assert np.median((found * expected).sum(axis=-1)) > 0.99


def test_the_dataset_is_read_back_as_the_same_cameras_and_lit_pictures(exported):
    folder, ours, _, _, _, sightings = exported
    for loader in ("nerfstudio", "colmap"):
        again = load_scene(
            folder / "dataset", split="train", dataset_loader=loader, holdout=0,
            near=ours.near, far=ours.far,
        )  # fmt: skip
        assert len(again.view_names) == len(ours.view_names)
        assert set(again.lenses) == set(ours.lenses)
        np.testing.assert_allclose(in_world(again), in_world(ours), atol=1e-5)
        for image, sighting in zip(again.images, sightings, strict=True):
            np.testing.assert_allclose(image / 257.0, sighting.srgb, atol=0.01)
    model = colmap.read_model(folder / "dataset" / "sparse" / "0")
    assert len(model.points) == len(trimesh.load(folder / "points.ply").vertices)


def test_the_dataset_trains(exported, tmp_path):
    folder, *_ = exported
    arguments = flags(
        folder / "dataset",
        tmp_path / "run",
        "Train.max_steps = 1",
        "Train.enhance_start = 0",
    )
    assert train_script.main(arguments) == 0
    trained = json.loads((tmp_path / "run" / "metrics.jsonl").read_text())
    assert trained["step"] == 1


def in_world(scene):
    return transform_points(
        np.linalg.inv(scene.model_from_world),
        np.asarray(scene.cameras.camtoworlds, np.float64)[:, :, 3],
    )


def test_a_point_behind_a_surface_is_not_seen(scene):
    ours, _, render, middle, _ = ball_in(scene)
    sightings = export_folder.look_around(ours, render)
    counts, _ = mean_colors(middle[None], sightings)
    assert counts[0] == 0


def test_a_model_without_a_surface_is_refused(scene, tmp_path):
    ours, density, render, _, _ = ball_in(scene)

    def see_nothing(view):
        rendering = render(view)
        return dataclasses.replace(rendering, depth=rendering.depth * 0 + 1e3)

    sightings = export_folder.look_around(ours, see_nothing)
    with pytest.raises(UserError, match="knows no shape yet"):
        wanted = export_folder.Wanted(points=10, resolution=8)
        export_folder.write_all(tmp_path, ours, sightings, density, wanted)


def test_panoramas_have_no_pinhole():
    with pytest.raises(UserError, match="panorama"):
        colmap.pinhole(Lens("EQUIRECTANGULAR", 20, 10, (20.0, 10.0)))


def test_a_distorted_lens_keeps_its_focal_length_and_principal_point():
    lens = Lens("OPENCV", 24, 18, (20.0, 21.0, 12.5, 9.5, 0.1, 0.0, 0.0, 0.0))
    assert colmap.pinhole(lens) == Lens("PINHOLE", 24, 18, (20.0, 21.0, 12.5, 9.5))
