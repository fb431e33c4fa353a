# SPDX-License-Identifier: Apache-2.0
"""Laws of the ray tracer, of the night scene's files, and of darkened datasets."""

import dataclasses
import json
import shutil
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.ndimage
from PIL import Image

import make_scene
from internal import color
from internal.errors import UserError
from internal.files import image_io
from internal.files.made_folder import make_folder
from internal.night import (
    darken,
    dataset,
    pinhole,
    raytrace,
    shading,
    still_life,
    textures,
)
from internal.night.capture import NORMAL_LIGHT, CaptureModel, capture, view_key
from internal.night.shading import Surface
from internal.scene.config import SceneConfig
from internal.scene.scene import load_scene

SIZE: dict[str, Any] = {"width": 48, "height": 36}
FOCAL = dataset.focal_length(SIZE["width"])
# Compiled as a whole: op by op, every test would wait for dozens of compilations.
around = jax.jit(raytrace.directions_about)
highlight = jax.jit(shading.highlight)
lamp_light = jax.jit(shading.lamp_light)
nearest_hit = jax.jit(raytrace.nearest_hit)
fractal_noise = jax.jit(textures.fractal_noise)
pinhole_directions = jax.jit(pinhole.pinhole_directions, static_argnums=(2, 3, 4))
NOISE_FREE = CaptureModel(
    exposure=0.1, full_well=np.inf, read_noise=0.0, channel_gains=(1.0, 1.0, 1.0)
)


def column(*xyz: float) -> jax.Array:
    """One vector, as the tracer takes many."""
    return jnp.array(xyz, jnp.float32)[:, None]


def placed(shape: str, center, size: float) -> raytrace.Solids:
    """One solid of equal half sizes."""
    offset = -np.array(center, np.float32)[:, None] / size
    affine = np.concatenate([np.eye(3, dtype=np.float32) / size, offset], axis=1)
    return raytrace.Solids(
        object_from_world=jnp.asarray(affine[None]),
        half_sizes=jnp.full((1, 3), size),
        spheres=int(shape == "sphere"),
        boxes=int(shape == "box"),
    )


def surface_facing_up(roughness: float, metalness: float, rays: int) -> Surface:
    """White surfaces at the origin."""
    up = jnp.broadcast_to(column(0, 1, 0), (3, rays))
    return Surface(
        t=jnp.ones(rays),
        point=jnp.zeros((3, rays)),
        normal=up,
        albedo=jnp.ones((3, rays)),
        roughness=jnp.full(rays, roughness),
        metalness=jnp.full(rays, metalness),
        emission=jnp.zeros((3, rays)),
    )


@pytest.fixture(scope="module")
def world() -> shading.World:
    return still_life.build_world()


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    return dataset.make_cameras(30)


@pytest.fixture(scope="module")
def night(tmp_path_factory):
    """A small night scene: its folder and its facts."""
    folder = tmp_path_factory.mktemp("scenes") / "night"
    facts = dataset.write_scene(folder, CaptureModel(), views=9, **SIZE)
    return folder, facts


@pytest.mark.parametrize("shape", still_life.SHAPES)
@pytest.mark.parametrize("size", [0.3, 1.7])
def test_a_ray_straight_at_a_solid_hits_it_at_the_analytic_distance(shape, size):
    solids = placed(shape, (1.0, -2.0, 3.0), size)
    t, index = nearest_hit(solids, column(1, -2, 10), column(0, 0, -1))
    assert float(t[0]) == pytest.approx(7.0 - size, rel=1e-5)
    assert int(index[0]) == 0


@pytest.mark.parametrize("shape", still_life.SHAPES)
def test_distances_count_lengths_of_the_direction(shape):
    solids = placed(shape, (0.0, 0.0, 0.0), 1.0)
    t, _ = nearest_hit(solids, column(0, 0, 5), column(0, 0, -2))
    assert float(t[0]) == pytest.approx(2.0, rel=1e-5)


@pytest.mark.parametrize("shape", still_life.SHAPES)
@pytest.mark.parametrize("aim", [(0, 1.2, 5, 0, 0, -1), (0, 0, 5, 0, 0, 1)])
def test_a_ray_past_or_away_from_a_solid_misses_it(shape, aim):
    solids = placed(shape, (0.0, 0.0, 0.0), 1.0)
    t, _ = nearest_hit(solids, column(*aim[:3]), column(*aim[3:]))
    assert np.isinf(t[0])


def test_normals_are_unit_length_and_face_the_rays(world, poses):
    pose = poses[7].astype(np.float32)
    directions = pinhole_directions(pose, FOCAL, SIZE["width"], SIZE["height"], 1)[
        ..., 0
    ]
    origin = jnp.broadcast_to(pose[:, 3:], directions.shape)
    surface = jax.jit(shading.first_surface)(world, origin, directions)
    np.testing.assert_allclose(
        raytrace.dot(surface.normal, surface.normal), 1.0, atol=1e-5
    )
    assert (raytrace.dot(surface.normal, directions) < 1e-4).all()


def test_directions_around_an_axis_keep_their_angle():
    axis = raytrace.normalize(jax.random.normal(jax.random.key(0), (3, 200)))
    cosine = jnp.linspace(0.01, 1.0, 200)
    turned = around(axis, cosine, jnp.linspace(0.0, 1.0, 200))
    np.testing.assert_allclose(raytrace.dot(axis, turned), cosine, atol=1e-5)
    np.testing.assert_allclose(raytrace.dot(turned, turned), 1.0, atol=1e-5)


def test_with_the_lamps_off_a_lone_surface_shows_albedo_times_ambient(world):
    dark = shading.World(
        solids=placed("sphere", (0.0, -1.0, 0.0), 1.0),
        materials=jax.tree.map(lambda leaf: leaf[:1], world.materials),
        lamps=dataclasses.replace(world.lamps, radiances=jnp.zeros((4, 3))),
        ambient=world.ambient,
    )
    surface = surface_facing_up(roughness=0.9, metalness=0.0, rays=1)
    surface = dataclasses.replace(surface, albedo=column(0.2, 0.4, 0.8))
    lights = len(world.lamps.radii) + 1
    u = jnp.full((lights, 2, 1), 0.3)
    light = jax.jit(shading.shade)(dark, surface, column(0, 1, 0), u)
    expected = np.array([0.2, 0.4, 0.8]) * np.asarray(world.ambient)
    np.testing.assert_allclose(light[:, 0], expected, rtol=1e-5)


def test_a_solid_between_lamp_and_surface_takes_all_its_light():
    lamp = shading.Lamps(
        centers=jnp.array([0.0, 8.0, 0.0]),
        radii=jnp.array(0.2),
        radiances=jnp.ones(3),
    )
    surface = surface_facing_up(roughness=0.9, metalness=0.0, rays=1)
    u = jnp.full((2, 1), 0.5)
    lit, shadowed = (
        lamp_light(placed("box", center, 1.0), lamp, surface, column(0, 1, 0), u)
        for center in ((9.0, 4.0, 0.0), (0.0, 4.0, 0.0))
    )
    assert float(lit[0, 0]) > 0
    assert not shadowed.any()


def test_a_matte_surface_under_a_lamp_obeys_the_inverse_square_law():
    """Far away, a lamp of radiance 1 and radius r gives π r² / d² / π of albedo 1."""
    surface = surface_facing_up(roughness=1.0, metalness=0.0, rays=1)
    away = placed("sphere", (50.0, 0.0, 0.0), 1.0)

    def matte_light(distance):
        lamp = shading.Lamps(
            centers=jnp.array([0.0, distance, 0.0]),
            radii=jnp.array(0.1),
            radiances=jnp.ones(3),
        )
        total = lamp_light(away, lamp, surface, column(0, 1, 0), jnp.zeros((2, 1)))
        shine = highlight(
            surface, column(0, 1, 0), column(0, 1, 0), jnp.full(1, 0.1 / distance)
        )
        return float((total / (shading.diffuse(surface) + shine) / jnp.pi)[0, 0])

    assert matte_light(5.0) == pytest.approx((0.1 / 5.0) ** 2, rel=1e-3)
    assert matte_light(10.0) == pytest.approx((0.1 / 10.0) ** 2, rel=1e-3)


@pytest.mark.parametrize("roughness", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("tilt", [0.0, 1.0])
def test_facets_never_reflect_more_light_than_they_get(roughness, tilt):
    """Integral over the hemisphere of BRDF times cosine, of a perfect mirror metal."""
    n = 200
    cosine, turn = jnp.meshgrid(jnp.arange(0.5, n) / n, jnp.arange(0.5, n) / n)
    cosine, turn = cosine.ravel(), turn.ravel()
    surface = surface_facing_up(roughness, metalness=1.0, rays=cosine.size)
    to_light = around(surface.normal, cosine, turn)
    viewer = jnp.broadcast_to(column(np.sin(tilt), np.cos(tilt), 0), to_light.shape)
    brdf = highlight(surface, to_light, viewer, jnp.zeros(cosine.size))
    reflected = 2 * np.pi * float(jnp.mean(brdf[0] * cosine))
    assert 0.25 < reflected < 1.01


def test_highlights_follow_the_viewer_and_diffuse_light_does_not():
    """A ball is brightest where its normal halves the angle of light and viewer."""
    normals = raytrace.normalize(jax.random.normal(jax.random.key(1), (3, 20_000)))
    ball = surface_facing_up(0.3, metalness=0.0, rays=20_000)
    ball = dataclasses.replace(ball, normal=normals)
    light = raytrace.normalize(column(-1, 2, 1))
    lights = jnp.broadcast_to(light, normals.shape)

    def brightest_normal(viewer):
        viewers = jnp.broadcast_to(viewer, normals.shape)
        shine = highlight(ball, lights, viewers, jnp.zeros(20_000))[0]
        return normals[:, jnp.argmax(shine * raytrace.dot(normals, lights))]

    for viewer in (column(0, 0, 1), raytrace.normalize(column(1, 0.2, 1))):
        half = raytrace.normalize(light + viewer)[:, 0]
        assert float(brightest_normal(viewer) @ half) > 0.99
    np.testing.assert_allclose(shading.diffuse(ball), 1 / np.pi, rtol=1e-6)


def test_noise_is_continuous_bounded_and_detailed():
    line = jnp.linspace(-3, 3, 6001)[None] * column(0.5, -0.6, 0.7)
    noise = np.asarray(fractal_noise(line))
    assert noise.min() >= 0 and noise.max() <= 1
    assert np.abs(np.diff(noise)).max() < 0.05
    assert noise.std() > 0.1


def test_the_chart_shows_its_24_colours():
    columns, rows = np.meshgrid((np.arange(6) + 0.5) / 6, (np.arange(4) + 0.5) / 4)
    unit = np.stack(
        [(2 * columns - 1) / 1.05, (1 - 2 * rows) / 1.08, np.ones((4, 6))]
    ).reshape(3, 24)
    colors = textures._chart(jnp.asarray(unit, jnp.float32))
    expected = color.srgb_to_linear(textures.CHART_SRGB)
    np.testing.assert_allclose(np.asarray(colors).T, expected, atol=1e-6)


def test_cameras_are_rigid_face_one_way_and_look_at_the_target(poses):
    rotation, center = poses[:, :, :3], poses[:, :, 3]
    np.testing.assert_allclose(
        rotation.swapaxes(1, 2) @ rotation, np.broadcast_to(np.eye(3), (30, 3, 3)),
        atol=1e-12,
    )  # fmt: skip
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0)
    forward = -rotation[:, :, 2]
    mean = forward.mean(axis=0) / np.linalg.norm(forward.mean(axis=0))
    assert np.degrees(np.arccos(forward @ mean)).max() < 20
    to_target = dataset.TARGET - center
    np.testing.assert_allclose(
        np.cross(forward, to_target), np.zeros((30, 3)), atol=1e-9
    )


def test_one_views_surfaces_project_onto_the_same_colours_in_another(night, world):
    """Back-projected depth of view 1 lands on the same matte surface in view 7."""
    train = json.loads((night[0] / "transforms_train.json").read_text())
    frames = {frame["file_path"]: frame for frame in train["frames"]}
    first, second = (
        np.array(frames[name]["transform_matrix"], np.float32)[:3]
        for name in ("low/001.png", "low/007.png")
    )
    pictures = [
        image_io.read_srgb(night[0] / "high" / name) for name in ("001.png", "007.png")
    ]
    focal = train["fl_x"]
    depths = [
        np.asarray(pinhole.depth_map(world.solids, pose, focal, **SIZE))
        for pose in (first, second)
    ]
    width, height = SIZE["width"], SIZE["height"]
    y, x = np.mgrid[:height, :width]
    # OpenGL pinhole, written out anew: x right, y up, looking along -z.
    rays = [(x + 0.5 - width / 2) / focal, (height / 2 - y - 0.5) / focal, -1.0 + 0 * x]
    points = (depths[0][..., None] * np.stack(rays, -1)) @ first[:, :3].T + first[:, 3]
    seen = (points - second[:, 3]) @ second[:, :3]
    z = -seen[..., 2]
    place = [
        height / 2 - focal * seen[..., 1] / z - 0.5,
        width / 2 + focal * seen[..., 0] / z - 0.5,
    ]

    def look_up(channel):
        return scipy.ndimage.map_coordinates(channel, place, order=1, cval=-1.0)

    inside = look_up(depths[1]) > 0
    visible = inside & (np.abs(look_up(depths[1]) / z - 1) < 0.01)
    assert visible.sum() > 0.75 * inside.sum()
    projected = np.stack([look_up(pictures[1][..., c]) for c in range(3)], axis=-1)
    difference = np.abs(pictures[0] - projected).mean(-1)[visible]
    elsewhere = np.abs(pictures[0] - pictures[1]).mean(-1)[visible]
    assert np.median(difference) < 0.45 * np.median(elsewhere)


def test_rays_pass_through_pixel_centres_and_their_subpixels_surround_them():
    """Pixel (0, 0) of 8x6 pixels is centred 3.5 left of and 2.5 above the axis."""
    pose = np.eye(4, dtype=np.float32)[:3]
    centers = np.asarray(pinhole_directions(pose, 10.0, 8, 6, 1))[..., 0]
    np.testing.assert_allclose(centers[:, 0], [-0.35, 0.25, -1.0], rtol=1e-6)
    np.testing.assert_allclose(centers[:, 1], [-0.25, 0.25, -1.0], rtol=1e-6)
    np.testing.assert_allclose(centers[:, 8], [-0.35, 0.15, -1.0], rtol=1e-6)
    fine = pinhole_directions(pose, 10.0, 8, 6, 3)
    np.testing.assert_allclose(fine.mean(axis=-1), centers, atol=1e-6)


def test_the_scene_has_the_promised_light_and_depth(night):
    folder, facts = night
    assert 0.42 < facts["truth_level"] / 255 < 0.48
    assert 8 < facts["dark_level"] < 30
    assert 1.5 < facts["far"] / facts["near"] < 3.5
    clipped = [
        (image_io.read_srgb(path) == 1).any(axis=-1).mean()
        for path in sorted((folder / "high").iterdir())
    ]
    assert np.mean(clipped) < 0.03


def test_a_written_scene_states_exact_poses_and_loads_with_its_truth(night):
    folder, facts = night
    assert len(list((folder / "low").iterdir())) == 9
    assert len(list((folder / "high").iterdir())) == 9
    stated = {}
    for split, pictures, count in (("train", "low", 7), ("test", "high", 2)):
        content = json.loads((folder / f"transforms_{split}.json").read_text())
        assert len(content["frames"]) == count
        assert (content["w"], content["h"], content["cx"]) == (48, 36, 24)
        fov = 2 * np.arctan(content["w"] / (2 * content["fl_x"]))
        assert fov == pytest.approx(content["camera_angle_x"])
        for frame in content["frames"]:
            assert frame["file_path"].startswith(f"{pictures}/")
            stated[frame["file_path"][-7:]] = np.array(frame["transform_matrix"])
    for name, pose in zip(sorted(stated), dataset.make_cameras(9), strict=True):
        np.testing.assert_array_equal(stated[name][:3], pose)
    scene = load_scene(SceneConfig(str(folder)), "test")
    assert scene.view_names == ("000.png", "008.png")
    assert len(scene.truth) == 2
    assert (scene.near, scene.far) == pytest.approx((facts["near"], facts["far"]))
    assert np.mean(scene.images[0]) < 0.25 * np.mean(scene.truth[0])


def test_a_scene_is_reused_refused_or_overwritten(night, monkeypatch):
    folder, facts = night
    size: dict[str, Any] = {"views": 9, **SIZE}
    truth = (folder / "high" / "004.png").read_bytes()
    dark = (folder / "low" / "004.png").read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(dataset, "render_views", None)
        assert dataset.write_scene(folder, CaptureModel(), **size) == facts
        with pytest.raises(UserError, match="exposure was"):
            dataset.write_scene(folder, CaptureModel(exposure=0.5), **size)
    other = CaptureModel(seed=7)
    dataset.write_scene(folder, other, **size, overwrite=True)
    assert (folder / "high" / "004.png").read_bytes() == truth
    assert (folder / "low" / "004.png").read_bytes() != dark
    dataset.write_scene(folder, CaptureModel(), **size, overwrite=True)
    assert (folder / "low" / "004.png").read_bytes() == dark


def test_a_folder_appears_whole_or_not_at_all(tmp_path):
    def fail(folder):
        (folder / "half").write_text("...")
        raise OSError(28, "No space left on device")

    with pytest.raises(UserError, match="No space left"):
        make_folder(tmp_path / "out", {}, fail, overwrite=False)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_users_own_folder_is_never_replaced(tmp_path, overwrite):
    (tmp_path / "photo.jpg").write_text("mine")
    with pytest.raises(UserError, match="choose another folder"):
        make_folder(tmp_path, {}, lambda folder: {}, overwrite=overwrite)
    assert (tmp_path / "photo.jpg").read_text() == "mine"


def test_tiny_scenes_are_refused(tmp_path):
    with pytest.raises(UserError, match="make a scene"):
        dataset.write_scene(tmp_path / "out", CaptureModel(), views=1)


@pytest.fixture
def originals(night, tmp_path):
    """A normal-light dataset of one picture folder: the night scene's truth."""
    folder = tmp_path / "bright"
    shutil.copytree(night[0] / "high", folder / "images")
    content = json.loads((night[0] / "transforms_train.json").read_text())
    for frame in content["frames"]:
        frame["file_path"] = frame["file_path"].replace("low/", "images/")
    (folder / "transforms.json").write_text(json.dumps(content))
    return folder


def test_a_darkened_dataset_keeps_its_format_and_pairs_with_its_originals(
    originals, tmp_path
):
    out = tmp_path / "dark"
    facts = darken.darken(originals, out, NOISE_FREE)
    original = (originals / "images" / "003.png").read_bytes()
    assert (out / "high" / "003.png").read_bytes() == original
    assert facts["views"] == 7
    poses = (originals / "transforms.json").read_text()
    assert (out / "transforms.json").read_text() == poses
    bright = load_scene(SceneConfig(str(originals)), "train")
    dark = load_scene(SceneConfig(str(out)), "train")
    assert len(dark.truth) == len(dark.images) == len(bright.images)
    np.testing.assert_array_equal(dark.truth[0], bright.images[0])
    light = 0.1 * color.srgb_to_linear(bright.images[0] / np.float32(65535))
    expected = color.to_uint8(color.linear_to_srgb(light))
    np.testing.assert_array_equal(dark.images[0], expected.astype(np.uint16) * 257)


def test_splits_in_two_folders_pair_by_folder(night, tmp_path):
    """NeRF's synthetic scenes repeat their file names in train and test."""
    originals, out = tmp_path / "bright", tmp_path / "dark"
    for split in ("train", "test"):
        content = json.loads((night[0] / f"transforms_{split}.json").read_text())
        (originals / split).mkdir(parents=True)
        for number, frame in enumerate(content["frames"]):
            source = night[0] / "high" / frame["file_path"].split("/")[1]
            shutil.copy(source, originals / split / f"r_{number}.png")
            frame["file_path"] = f"./{split}/r_{number}"
        (originals / f"transforms_{split}.json").write_text(json.dumps(content))
    darken.darken(originals, out, NOISE_FREE)
    for split in ("train", "test"):
        scene, bright = (
            load_scene(SceneConfig(str(folder)), split) for folder in (out, originals)
        )
        np.testing.assert_array_equal(scene.truth[1], bright.images[1])


def test_darkening_refuses_pairs_and_the_dataset_itself(night, originals):
    with pytest.raises(UserError, match="truth already"):
        darken.darken(night[0], originals / "out", NORMAL_LIGHT)
    with pytest.raises(UserError, match="dataset itself"):
        darken.darken(originals, originals / "out", NORMAL_LIGHT)


def test_linked_pictures_and_other_formats_are_darkened(originals, tmp_path):
    (originals / "images").rename(tmp_path / "elsewhere")
    (originals / "images").symlink_to(tmp_path / "elsewhere")
    picture = tmp_path / "elsewhere" / "003.png"
    Image.open(picture).save(picture.with_suffix(".avif"), quality=100)
    picture.unlink()
    (originals / "images" / ".DS_Store").touch()
    out = tmp_path / "out"
    facts = darken.darken(originals, out, NOISE_FREE)
    for folder, ending in (("images", "png"), ("high", "avif")):
        assert len(list((out / folder).iterdir())) == facts["views"]
        assert (out / folder / f"003.{ending}").is_file()
        assert not (out / folder).is_symlink()
    assert load_scene(SceneConfig(str(out)), "train").truth


def test_pictures_outside_of_a_dataset_are_refused(originals, tmp_path):
    (originals / "images").rename(tmp_path / "elsewhere")
    poses = originals / "transforms.json"
    poses.write_text(poses.read_text().replace("images/", "../elsewhere/"))
    with pytest.raises(UserError, match=r"001\.png: lies outside"):
        darken.darken(originals, tmp_path / "out", NOISE_FREE)


def test_the_script_makes_darkens_and_says_so(originals, tmp_path, capsys):
    out = tmp_path / "dark"
    arguments = [
        "darken",
        str(originals),
        str(out),
        "--exposure",
        "0.05",
        "--seed",
        "3",
    ]
    assert make_scene.main(arguments) == 0
    assert str(out) in capsys.readouterr().out
    recorded = json.loads((out / "made_with.json").read_text())["settings"]
    assert (recorded["exposure"], recorded["seed"]) == (0.05, 3)


@pytest.mark.parametrize("ending", [".png", ".jpg"])
def test_darkened_photos_can_go_through_a_jpeg_whatever_they_are_stored_as(
    originals, tmp_path, ending
):
    for path in (originals / "images").iterdir():
        image_io.write(path.with_suffix(ending), image_io.read_srgb(path))
    poses = originals / "transforms.json"
    poses.write_text(poses.read_text().replace(".png", ending))
    for quality, folder in ((0, "plain"), (60, "compressed")):
        darken.darken(originals, tmp_path / folder, NOISE_FREE, jpeg_quality=quality)
    name = f"images/003{ending}"
    bright = image_io.read_srgb(originals / name)
    dark = capture(color.srgb_to_linear(bright), NOISE_FREE, view_key(NOISE_FREE, 0))
    image_io.write(tmp_path / "x.jpg", dark / np.float32(255), jpeg_quality=60)
    compressed = image_io.read_srgb(tmp_path / "compressed" / name)
    np.testing.assert_array_equal(compressed, image_io.read_srgb(tmp_path / "x.jpg"))
    assert not np.array_equal(compressed, image_io.read_srgb(tmp_path / "plain" / name))
    assert "quality 60" in (tmp_path / "compressed" / "README.txt").read_text()
