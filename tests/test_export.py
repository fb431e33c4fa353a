# SPDX-License-Identifier: Apache-2.0
"""Exports are shapes that other tools open, and a dataset that we read back.

A ball of known density stands for a trained field: where its surface, normals and
colours are is known exactly.
"""

import dataclasses
import json
import resource
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import export as export_script
import train as train_script
from internal.cameras import Lens
from internal.configs import load_config
from internal.coord import ForwardFacing, Unbounded
from internal.errors import UserError
from internal.export import bake, shapes, splat_files
from internal.export import folder as export_folder
from internal.export.density import normals
from internal.export.sightings import (
    between_views,
    look_around,
    mean_colors,
    undistorted,
)
from internal.files import image_io
from internal.models import Model
from internal.parallel import data_mesh
from internal.rendering.surfaces import surface_points
from internal.scene import colmap
from internal.scene.config import SceneConfig
from internal.scene.scene import load_scene
from internal.structs import Rendering
from internal.training.checkpoints import Checkpoints, load_trained
from internal.training.step import initial_state
from tests.conftest import bindings, flags
from tests.scene_writers import facing_world, surrounding_world, write_blender

NDC = ForwardFacing(np.array([2.0, 2.5], np.float32))
BALL_OF_TWO = Unbounded(np.float32(0.1), np.float32(100.0))
RADIUS = 0.5


def ball(points):
    """Density that falls through 10 at the surface of a ball about the origin."""
    return 20.0 / (1.0 + np.exp(40.0 * (np.linalg.norm(points, axis=-1) - RADIUS)))


@given(
    st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-20.0, -1.0),
    st.sampled_from([NDC, BALL_OF_TWO]),
)  # fmt: skip
def test_field_space_and_back_is_the_identity(x, y, z, space):
    point = np.array([[x, y, z]])
    again = space.from_field(space.to_field(point))
    np.testing.assert_allclose(again, point, rtol=2e-3, atol=1e-5)


@pytest.mark.parametrize(
    ("place", "is_said"), [(0.0, False), (1e3, False), (4e6, True)]
)
def test_coordinates_that_single_precision_rounds_are_said(place, is_said, capsys):
    points = place + np.random.default_rng(0).uniform(-4.0, 4.0, (50, 3))
    export_folder.warn_of_rounding(points)
    said = capsys.readouterr().out
    assert ("subtract an offset" in said) == is_said
    assert ("steps of 0.25" in said) == is_said


def test_ndc_of_the_near_plane_and_of_infinity():
    ends = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, -1e9]])
    np.testing.assert_allclose(NDC.to_field(ends)[:, 2], [-1.0, 1.0], atol=1e-6)


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


def read_shape(path: Path, **options: Any) -> Any:
    """What trimesh reads; its types do not say of which kind."""
    return trimesh.load(path, **options)


def test_marching_cubes_of_a_ball_is_the_ball(tmp_path):
    shapes.write_mesh(tmp_path / "ball.glb", ball_mesh())
    opened = read_shape(tmp_path / "ball.glb", force="mesh")
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
    opened = read_shape(tmp_path / "cloud.ply")
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
    return load_scene(SceneConfig(str(folder), near=2.0, far=9.0), "train")


def ball_in(scene):
    """A ball where the cameras look, as the renderer and the field would see it."""
    ours = undistorted(scene)
    facing = isinstance(ours.space, ForwardFacing)
    scale = ours.model_from_world.scale
    target = np.array([0.0, 0.0, -5.0] if facing else [1.0, 2.0, 3.0])
    (middle,) = ours.model_from_world.points(target[None])
    radius = 0.8 * scale

    def density(points):
        apart = ours.space.from_field(np.asarray(points, float)) - middle
        inside = radius - np.linalg.norm(apart, axis=-1)
        return 100.0 / (1.0 + np.exp(-np.clip(60.0 * inside / radius, -50.0, 50.0)))

    def render(camera):
        lens, pose = ours.lenses[0], np.asarray(camera.camtoworlds[0], float)
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
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bake, "STEPS", 8)
        patch.setattr(bake, "RECOLOR_STEPS", 4)
        yield export_ball(scene, tmp_path_factory)


def export_ball(scene, tmp_path_factory):
    ours, density, render, middle, radius = ball_in(scene)
    folder = tmp_path_factory.mktemp("export")
    sightings = look_around(ours, render)
    between = look_around(between_views(ours), render)
    wanted = export_folder.Wanted(points=500, resolution=48, splats=400, look="both")
    facts = export_folder.write_all(folder, ours, sightings, between, density, wanted)
    world = ours.model_from_world.inverse()
    (centre,) = world.points(middle[None])
    return folder, ours, facts, centre, radius * world.scale, sightings


def test_the_cloud_and_the_mesh_lie_on_the_ball_in_the_users_frame(exported):
    folder, _, facts, centre, radius, _ = exported
    cloud = read_shape(folder / "points.ply")
    assert 50 < len(cloud.vertices) == facts["points"] <= 500
    apart = np.linalg.norm(cloud.vertices - centre, axis=-1)
    np.testing.assert_allclose(apart, radius, rtol=0.02)
    for name in ("mesh.ply", "mesh.glb"):
        mesh = read_shape(folder / name, force="mesh")
        assert len(mesh.faces) == facts["triangles"] > 100
        apart = np.linalg.norm(mesh.vertices - centre, axis=-1)
        np.testing.assert_allclose(apart, radius, rtol=0.1)
        outwards = mesh.triangles_center - centre
        assert (np.einsum("fi,fi->f", mesh.face_normals, outwards) > 0).mean() > 0.95
        np.testing.assert_allclose(
            np.median(mesh.visual.vertex_colors, axis=0), [204, 102, 51, 255], atol=1
        )


def test_the_splats_lie_on_the_ball_in_the_users_frame(exported):
    folder, _, facts, centre, radius, _ = exported
    lit = splat_files.read_ply(folder / "splats.ply")
    dark = splat_files.read_ply(folder / "splats_dark.ply")
    assert {"splats.glb", "splats_dark.glb"} <= {p.name for p in folder.iterdir()}
    assert 50 < len(lit) == facts["splats"] == facts["splats_dark"] <= 400
    np.testing.assert_array_equal(lit.points, dark.points)
    on_ball = np.linalg.norm(lit.points - centre, axis=-1) < 3.0 * radius
    apart = np.linalg.norm(lit.points[on_ball] - centre, axis=-1)
    # 400 splats are few: the cells that they stand for are deep.
    assert on_ball.sum() > 30 and np.median(np.abs(apart / radius - 1.0)) < 0.15
    listed = dict(export_folder.list_exported(facts))
    assert {"splats.ply", "splats.glb", "splats_dark.ply"} <= listed.keys()


@pytest.mark.parametrize("flag", ["--splats", "--points", "--resolution"])
@pytest.mark.parametrize("value", ["0", "-3", "many"])
def test_nothing_to_export_is_refused_before_anything_is_read(flag, value, capsys):
    with pytest.raises(SystemExit, match="2"):
        export_script.main([f"{flag}={value}", "--run=no/such/run"])
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.endswith(f"{flag}: '{value}' is not a whole number above 0")


def test_a_model_that_knows_no_shape_leaves_no_export(night_run):
    arguments = ["--splats", "50", "--points", "20", "--resolution", "4"]
    with pytest.raises(UserError, match="knows no shape yet"):
        export_script.main([*arguments, f"--run={night_run}"])
    assert not [path for path in night_run.iterdir() if "export" in path.name]


def test_a_diverged_model_is_refused(night, tmp_path):
    config = load_config(
        [], [*bindings(night), f"Config.checkpoint_dir = {str(tmp_path)!r}"]
    )
    state = initial_state(config, Model(config.model))
    leaves, tree = jax.tree.flatten(state.params)
    broken = jax.tree.unflatten(tree, [leaves[0] + np.inf, *leaves[1:]])
    with Checkpoints(tmp_path, 1) as checkpoints:
        checkpoints.save(dataclasses.replace(state, params=broken))
    with pytest.raises(UserError, match="step 0 is not finite"):
        load_trained(config, data_mesh(jax.device_count()))


@pytest.mark.parametrize("write", [splat_files.write_ply, splat_files.write_glb])
def test_a_disk_that_fills_up_leaves_no_part_of_a_file(tmp_path, write):
    count = 400
    splats = bake.first_splats(
        np.ones((count, 3)),
        np.ones(count),
        np.ones((count, 3)),
        np.zeros((count, 3)),
        0.9,
    )
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, limits[1]))
    try:
        with pytest.raises(UserError, match=r"splats\.any: cannot write"):
            write(tmp_path / "splats.any", splats)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list(tmp_path.iterdir())


def test_between_two_views_is_half_way(scene):
    ours = undistorted(scene)
    between = between_views(ours)
    centres = np.asarray(ours.cameras.camtoworlds)[:, :, 3]
    assert len(between.lenses) == len(between.cameras)
    assert len(between.cameras) > 0 or isinstance(ours.space, Unbounded)
    middles = 0.5 * (centres[:, None] + centres)
    for camtoworld in np.asarray(between.cameras.camtoworlds):
        rotation = camtoworld[:, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-5)
        apart = np.linalg.norm(middles - camtoworld[:, 3], axis=-1)
        assert apart.min() < 1e-5


def test_views_back_to_back_have_nothing_between_them(scene):
    ours = undistorted(scene)
    cameras = ours.cameras.take(np.array([0, 0]))
    turned = np.array(cameras.camtoworlds)
    turned[1, :, [0, 2]] *= -1.0
    pair = dataclasses.replace(
        ours,
        lenses=ours.lenses[:2],
        cameras=dataclasses.replace(cameras, camtoworlds=turned),
    )
    assert len(between_views(pair).cameras) == 0


def test_normals_of_the_cloud_are_those_of_the_ball(exported):
    folder, _, _, centre, radius, _ = exported
    cloud = read_shape(folder / "points.ply")
    data = cloud.metadata["_ply_raw"]["vertex"]["data"]
    found = np.stack([data[n].reshape(-1) for n in ("nx", "ny", "nz")], axis=-1)
    expected = (cloud.vertices - centre) / radius
    assert np.median((found * expected).sum(axis=-1)) > 0.99


def test_the_dataset_is_read_back_as_the_same_cameras_and_lit_pictures(exported):
    folder, ours, _, _, _, sightings = exported
    for loader in ("nerfstudio", "colmap"):
        again = load_scene(
            SceneConfig(
                str(folder / "dataset"), dataset_loader=loader, holdout=0,
                near=ours.near, far=ours.far,
            ),
            "train",
        )  # fmt: skip
        assert len(again.view_names) == len(ours.view_names)
        assert set(again.lenses) == set(ours.lenses)
        np.testing.assert_allclose(in_world(again), in_world(ours), atol=1e-5)
        for image, sighting in zip(again.images, sightings, strict=True):
            np.testing.assert_allclose(image / 257.0, sighting.srgb, atol=0.01)
    model = colmap.read_model(folder / "dataset" / "sparse" / "0")
    assert len(model.points) == len(read_shape(folder / "points.ply").vertices)


def test_the_dataset_keeps_the_rules_of_the_tools_it_is_for(exported):
    """What their readers insist on (OpenSplat: nerfstudio.cpp, point_io.cpp;
    nerfstudio: nerfstudio_dataparser.py):

    - camera_model: a name they know; ply_file_path: not empty, below the folder.
    - Each frame: file_path of a file that exists, with its ending; w, h, fl_x, fl_y,
      cx, cy (there are no common ones); transform_matrix 4 x 4, camera to world, whose
      last row is 0 0 0 1.
    - train_, val_ and test_filenames: all three or none.
    - The points: "ply", the format, one element vertex of properties x y z first, red
      green blue next to each other, and no others: OpenSplat reads them by position
      and knows no alpha.
    """
    folder = exported[0] / "dataset"
    content = json.loads((folder / "transforms.json").read_text())
    assert content["camera_model"] in ("PINHOLE", "OPENCV", "SIMPLE_PINHOLE")
    splits = [f"{split}_filenames" in content for split in ("train", "val", "test")]
    assert all(splits) or not any(splits)
    for frame in content["frames"]:
        with_size = image_io.read_srgb(folder / frame["file_path"])
        assert with_size.shape == (frame["h"], frame["w"], 3)
        assert {"fl_x", "fl_y", "cx", "cy"} <= frame.keys()
        matrix = np.array(frame["transform_matrix"])
        np.testing.assert_allclose(
            matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-6
        )
        np.testing.assert_array_equal(matrix[3], [0, 0, 0, 1])
    points = (folder / content["ply_file_path"]).read_bytes()
    header, _, body = points.partition(b"end_header\n")
    lines = header.decode().splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    count = int(lines[2].removeprefix("element vertex "))
    assert lines[3:] == [
        *(f"property float {name}" for name in "xyz"),
        *(f"property uchar {name}" for name in ("red", "green", "blue")),
    ]
    assert len(body) == 15 * count > 0
    again = read_shape(folder / content["ply_file_path"])
    model = colmap.read_model(folder / "sparse" / "0")
    np.testing.assert_allclose(
        np.sort(again.vertices, axis=0), np.sort(model.points, axis=0), atol=1e-5
    )


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
    centres = np.asarray(scene.cameras.camtoworlds, np.float64)[:, :, 3]
    return scene.model_from_world.inverse().points(centres)


def test_a_point_behind_a_surface_is_not_seen(scene):
    ours, _, render, middle, _ = ball_in(scene)
    sightings = look_around(ours, render)
    counts, _ = mean_colors(middle[None], sightings)
    assert counts[0] == 0


def test_a_model_without_a_surface_is_refused(scene, tmp_path):
    ours, density, render, _, _ = ball_in(scene)

    def see_nothing(camera):
        rendering = render(camera)
        return dataclasses.replace(rendering, depth=rendering.depth * 0 + 1e3)

    sightings = look_around(ours, see_nothing)
    with pytest.raises(UserError, match="knows no shape yet"):
        wanted = export_folder.Wanted(points=10, resolution=8)
        export_folder.write_all(tmp_path, ours, sightings, [], density, wanted)


def test_panoramas_have_no_pinhole():
    with pytest.raises(UserError, match="panorama"):
        colmap.pinhole(Lens("EQUIRECTANGULAR", 20, 10, (20.0, 10.0)))


def test_a_distorted_lens_keeps_its_focal_length_and_principal_point():
    lens = Lens("OPENCV", 24, 18, (20.0, 21.0, 12.5, 9.5, 0.1, 0.0, 0.0, 0.0))
    assert colmap.pinhole(lens) == Lens("PINHOLE", 24, 18, (20.0, 21.0, 12.5, 9.5))
