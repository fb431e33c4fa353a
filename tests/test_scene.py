# SPDX-License-Identifier: Apache-2.0
"""A scene loads alike from every format, in a frame that suits its cameras, and
says what is wrong where it cannot."""

import dataclasses
import os
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from internal import poses
from internal.cameras import NODES, Lens, pixel_directions
from internal.coord import ForwardFacing, Unbounded
from internal.errors import UserError
from internal.files import image_io
from internal.scene import readers
from internal.scene.config import SceneConfig
from internal.scene.extent import visible_distances
from internal.scene.scene import Scene, load_scene
from tests.scene_writers import (
    LENS,
    World,
    edit_json,
    facing_world,
    flat_picture,
    frame_entries,
    intrinsics,
    look_at,
    random_rotation,
    surrounding_world,
    write_blender,
    write_colmap,
    write_json,
    write_llff,
    write_model,
    write_nerfstudio,
    write_pictures,
)

DATA = Path(os.environ.get("LLNERF_DATA", Path(__file__).parents[2] / "shared/data"))
WORLD = facing_world()
TURNED = np.stack([np.eye(3, 4), np.diag([-1, 1, -1]) @ np.eye(3, 4)])
OPPOSITE = World(TURNED, np.zeros((0, 3)))
MOVE = (3.7, random_rotation(), np.array([1.0, -2.0, 5.0]))
BOUNDS: dict[str, Any] = {"near": 2.5, "far": 7.0}


def load(folder: Path, split: str = "train", **options) -> Scene:
    find_points = options.pop("find_points", None)
    return load_scene(SceneConfig(str(folder), **options), split, find_points)


def rays(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Model-frame origins and directions of all pixels, [views, pixels, 3]."""
    lens = scene.lenses[0]
    y, x = np.divmod(np.arange(lens.width * lens.height), lens.width)
    view = np.arange(len(scene.cameras))[:, None]
    grid = [jnp.asarray(np.broadcast_to(a, (len(view), len(x)))) for a in (view, x, y)]
    cameras = dataclasses.replace(
        scene.cameras,
        **{
            f.name: jnp.asarray(getattr(scene.cameras, f.name))
            for f in dataclasses.fields(scene.cameras)
        },
    )
    origins, directions = pixel_directions(cameras, *grid)
    return np.asarray(origins), np.asarray(directions)


class TestFormatsAgree:
    def test_every_format_gives_the_same_rays(self, tmp_path):
        """Same cameras, COLMAP's in other coordinates: normalisation undoes them."""
        moved = WORLD.moved(*MOVE)
        test = {"test_filenames": ["images/00.png"]}
        scenes = [
            load(write_blender(tmp_path / "blender", WORLD), **BOUNDS),
            load(write_nerfstudio(tmp_path / "nerfstudio", WORLD, **test), **BOUNDS),
            load(write_llff(tmp_path / "llff", WORLD), **BOUNDS),
            load(
                write_colmap(tmp_path / "colmap", moved).parent,
                near=2.5 * MOVE[0],
                far=7.0 * MOVE[0],
            ),
        ]
        expected = rays(scenes[0])
        for scene in scenes:
            assert scene.format in ("blender", "nerfstudio", "llff", "colmap")
            assert scene.view_names == tuple(WORLD.names[1:])
            assert isinstance(scene.space, ForwardFacing)
            np.testing.assert_allclose(scene.space.scale, [40 / 24, 40 / 18])
            for ours, theirs in zip(rays(scene), expected, strict=True):
                np.testing.assert_allclose(ours, theirs, atol=2e-5)
            for image, other in zip(scene.images, scenes[0].images, strict=True):
                np.testing.assert_array_equal(image, other)

    def test_depth_range_from_points_scales_with_the_world(self, tmp_path):
        """In JSON units through the similarity, in COLMAP's own units without."""
        moved = WORLD.moved(*MOVE)
        write_model(tmp_path / "json/sparse/0", moved)
        by_json = load(write_blender(tmp_path / "json", WORLD))
        by_colmap = load(write_colmap(tmp_path / "colmap", moved).parent)
        assert by_colmap.near == pytest.approx(MOVE[0] * by_json.near)
        assert by_colmap.far == pytest.approx(MOVE[0] * by_json.far)


class TestFrame:
    def test_forward_facing(self, tmp_path, capsys):
        """Average camera at the origin looking down -z, 0.75 near at depth 1."""
        scene = load(write_llff(tmp_path, WORLD), holdout=0)
        assert isinstance(scene.space, ForwardFacing)
        assert "ndc (detected" in capsys.readouterr().out
        centres = scene.cameras.camtoworlds[:, :, 3]
        np.testing.assert_allclose(centres.mean(axis=0), 0.0, atol=1e-6)
        axis = scene.cameras.camtoworlds[:, :, 2].mean(axis=0)
        np.testing.assert_allclose(axis[:2], 0.0, atol=1e-6)
        spread = [np.ptp(c, axis=0) for c in (centres, WORLD.camtoworlds[:, :, 3])]
        assert np.linalg.norm(spread[0]) == pytest.approx(
            np.linalg.norm(spread[1]) / (0.75 * 2.5), rel=0.05
        )
        assert (scene.near, scene.far) == (2.5, 7.0)

    def test_no_point_lies_before_the_near_plane(self, tmp_path):
        scene = load(write_colmap(tmp_path, WORLD).parent)
        points = scene.model_from_world.points(WORLD.points)
        assert points[:, 2].max() < -1.0

    def test_surrounding(self, tmp_path, capsys):
        """Focus at the origin, farthest camera at distance 1, bounds in that unit."""
        world = surrounding_world()
        scene = load(write_colmap(tmp_path, world).parent, holdout=0)
        assert isinstance(scene.space, Unbounded)
        assert "contract (detected" in capsys.readouterr().out
        distances = np.linalg.norm(scene.cameras.camtoworlds[:, :, 3], axis=-1)
        assert distances.max() == pytest.approx(1.0)
        focus = scene.model_from_world.points(np.array([[1.0, 2.0, 3.0]]))
        np.testing.assert_allclose(focus, 0.0, atol=1e-6)
        scale = scene.model_from_world.scale
        assert float(scene.space.near) == pytest.approx(scale * scene.near)
        assert float(scene.space.far) == pytest.approx(scale * scene.far)
        assert 2.9 < scene.near < 3.4 and 4.6 < scene.far < 5.2  # 4 -+ 0.5 * sqrt(3)

    def test_forced(self, tmp_path, capsys):
        write_llff(tmp_path, WORLD)
        assert isinstance(load(tmp_path, projection="contract").space, Unbounded)
        assert isinstance(load(tmp_path, projection="ndc").space, ForwardFacing)
        assert "ndc (forced" in capsys.readouterr().out

    def test_ndc_cannot_hold_cameras_that_surround(self, tmp_path):
        write_colmap(tmp_path, surrounding_world())
        with pytest.raises(UserError, match=r"set Config\.projection = .contract"):
            load(tmp_path, projection="ndc")

    def test_panoramas_are_never_forward_facing(self, tmp_path):
        lens = Lens("EQUIRECTANGULAR", 24, 18, (24.0, 18.0))
        write_colmap(tmp_path, dataclasses.replace(WORLD, lens=lens))
        assert isinstance(load(tmp_path).space, Unbounded)

    def test_splits_share_frame_and_bounds(self, tmp_path):
        write_colmap(tmp_path, WORLD)
        train, test = (load(tmp_path, split) for split in ("train", "test"))
        np.testing.assert_array_equal(
            train.model_from_world.matrix, test.model_from_world.matrix
        )
        assert (train.near, train.far) == (test.near, test.far)
        both = train.view_names + test.view_names
        assert sorted(both) == WORLD.names

    def test_model_from_world_moves_the_cameras(self, tmp_path):
        scene = load(write_colmap(tmp_path, surrounding_world()).parent, holdout=0)
        centres = surrounding_world().camtoworlds[:, :, 3]
        moved = scene.model_from_world.points(centres)
        np.testing.assert_allclose(moved, scene.cameras.camtoworlds[:, :, 3], atol=1e-6)


class TestSplit:
    @pytest.mark.parametrize(
        ("holdout", "test"),
        [(8, ["00.png", "08.png"]), (4, ["00.png", "04.png", "08.png"]), (0, [])],
    )
    def test_every_nth_view_is_held_out(self, tmp_path, holdout, test):
        write_llff(tmp_path, facing_world(10))
        train = load(tmp_path, holdout=holdout)
        assert set(WORLD.names) - set(train.view_names) == set(test) & set(WORLD.names)
        assert len(train.images) == 10 - len(test)
        if test:
            assert list(load(tmp_path, "test", holdout=holdout).view_names) == test

    def test_files_decide_before_holdout(self, tmp_path):
        write_blender(tmp_path, WORLD, test=(1, 3))
        test = load(tmp_path, "test", holdout=2, **BOUNDS)
        assert test.view_names == ("01.png", "03.png")

    def test_bad_splits_are_refused(self, tmp_path):
        write_llff(tmp_path, WORLD)
        with pytest.raises(UserError, match="unknown split 'val'"):
            load(tmp_path, "val")
        with pytest.raises(UserError, match="no test views"):
            load(tmp_path, "test", holdout=0)

    @pytest.mark.parametrize(("views", "holdout"), [(1, 0), (2, 8)])
    def test_fewer_than_two_training_views_are_refused(self, tmp_path, views, holdout):
        write_llff(tmp_path, facing_world(views))
        with pytest.raises(UserError, match=f"1 training views of {views}"):
            load(tmp_path, holdout=holdout)


class TestBounds:
    def test_given_beats_file_beats_points(self, tmp_path, capsys):
        write_blender(tmp_path, WORLD)
        write_model(tmp_path / "sparse", WORLD)
        from_points = load(tmp_path)
        assert "from 400 sparse points" in capsys.readouterr().out
        assert 2.5 < from_points.near < 3.1 and 5.8 < from_points.far < 6.8
        for path in tmp_path.glob("*.json"):
            edit_json(path, lambda c: c.update(near=1.5, far=9.0))
        stated = load(tmp_path)
        assert (stated.near, stated.far) == (1.5, 9.0)
        assert "from transforms_test.json" in capsys.readouterr().out
        given_near = load(tmp_path, near=2.0)
        assert (given_near.near, given_near.far) == (2.0, 9.0)
        assert "one given, else from" in capsys.readouterr().out

    def test_outliers_do_not_widen_the_range(self, tmp_path):
        clean = load(write_colmap(tmp_path / "clean", WORLD).parent)
        stray = np.vstack([WORLD.points, [[0.0, 0.0, -600.0], [0.0, 0.0, -0.5]]])
        spoilt = dataclasses.replace(WORLD, points=stray)
        dirty = load(write_colmap(tmp_path / "dirty", spoilt).parent)
        assert dirty.near == pytest.approx(clean.near, rel=0.05)
        assert dirty.far == pytest.approx(clean.far, rel=0.05)

    def test_without_depths_and_points_the_cameras_say_a_wide_range(
        self, tmp_path, capsys
    ):
        write_nerfstudio(tmp_path, WORLD)
        scene = load(tmp_path)
        assert isinstance(scene.space, Unbounded)
        assert scene.near < 1.0 and scene.far > 20.0
        assert "guessed from the cameras" in capsys.readouterr().out
        assert load(tmp_path, near=1.5).near == 1.5

    @pytest.mark.parametrize(
        ("near", "far"), [(5.0, 5.0), (6.0, 5.0), (-1.0, 5.0), (1.0, np.inf)]
    )
    def test_order_and_sign(self, tmp_path, near, far):
        write_llff(tmp_path, WORLD)
        with pytest.raises(UserError, match=r"expected 0 < near < far"):
            load(tmp_path, near=near, far=far)

    def test_visible_distances_by_hand(self):
        """A camera at z = 1 sees depth 3 ahead; not behind, not beside."""
        pose = np.hstack([np.eye(3), [[0.0], [0.0], [1.0]]])
        points = np.array([[1.0, 0.0, -2.0], [4.0, 0.0, 4.0], [9.0, 0.0, -2.0]])
        np.testing.assert_allclose(visible_distances(points, pose, LENS), [3.0])
        panorama = Lens("EQUIRECTANGULAR", 24, 18, (24.0, 18.0))
        np.testing.assert_allclose(
            visible_distances(points, pose, panorama),
            [np.sqrt(10.0), 5.0, np.sqrt(90.0)],
        )


class TestPoses:
    @pytest.mark.parametrize(
        ("spoil", "message"),
        [
            (lambda pose: pose * np.nan, "it is not finite"),
            (lambda pose: pose * [-1, 1, 1, 1], "its axes are not a rotation"),
            (lambda pose: pose * [2, 2, 2, 1], "its axes are not a rotation"),
            (lambda pose: pose * [1, 1.1, 1, 1], "its axes are not a rotation"),
            (lambda pose: pose * [0, 0, 0, 1], "its axes are not a rotation"),
        ],
        ids=["nan", "mirrored", "scaled", "sheared", "zero"],
    )
    def test_bad_pose_names_file_and_view(self, tmp_path, spoil, message):
        camtoworlds = WORLD.camtoworlds.copy()
        camtoworlds[2] = spoil(camtoworlds[2])
        write_llff(tmp_path, dataclasses.replace(WORLD, camtoworlds=camtoworlds))
        with pytest.raises(
            UserError, match=rf"poses_bounds\.npy: bad pose of 02\.png .{message}"
        ):
            load(tmp_path)

    def test_rounded_rotations_pass(self, tmp_path):
        rounded = dataclasses.replace(WORLD, camtoworlds=WORLD.camtoworlds.round(3))
        assert len(load(write_llff(tmp_path, rounded)).images) == 5

    def test_bad_lens_names_file_and_view(self, tmp_path):
        lens = Lens("OPENCV", 24, 18, (*LENS.params, -3.0, 5.0, 0.1, 0.1))
        write_colmap(tmp_path, dataclasses.replace(WORLD, lens=lens))
        with pytest.raises(
            UserError, match=r"sparse/0: 00\.png: lens OPENCV.*no direction"
        ):
            load(tmp_path)

    def test_cameras_at_one_place_are_refused(self, tmp_path):
        world = World(np.tile(WORLD.camtoworlds[:1], (4, 1, 1)), WORLD.points)
        write_colmap(tmp_path, world)
        with pytest.raises(UserError, match="all cameras stand at one place"):
            load(tmp_path, projection="contract")

    @given(st.integers(0, 10**6), st.floats(0.01, 100.0))
    def test_fit_similarity_recovers_it(self, seed, scale):
        rng = np.random.default_rng(seed)
        world = WORLD.moved(scale, random_rotation(seed), rng.normal(size=3))
        fitted = poses.fit_similarity(
            WORLD.camtoworlds[:, :, 3], world.camtoworlds[:, :, 3]
        )
        np.testing.assert_allclose(
            fitted.poses(WORLD.camtoworlds),
            world.camtoworlds,
            atol=1e-8 * max(scale, 1.0),
        )
        np.testing.assert_allclose(
            fitted.points(WORLD.points),
            world.points,
            atol=1e-7 * max(scale, 1.0),
        )

    def test_fit_similarity_never_mirrors(self):
        points = WORLD.points[:20]
        fitted = poses.fit_similarity(points, points * [-1.0, 1.0, 1.0])
        assert np.linalg.det(fitted.rotation) > 0.0

    def test_focus_is_where_the_axes_meet(self):
        target = np.array([0.3, -0.2, -5.0])
        centres = np.random.default_rng(0).normal(size=(5, 3))
        np.testing.assert_allclose(poses.focus_point(look_at(centres, target)), target)

    def test_parallel_axes_focus_among_the_cameras(self):
        centres = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 3.0]])
        pose = np.concatenate([np.tile(np.eye(3), (3, 1, 1)), centres[..., None]], -1)
        np.testing.assert_allclose(poses.focus_point(pose), [0, 0, 1], atol=1e-12)
        tilt = Rotation.from_euler("x", 0.1, degrees=True).as_matrix()
        pose[0, :, :3] = tilt  # noise, not a focus 600 units away
        np.testing.assert_allclose(poses.focus_point(pose), [0, 0, 1], atol=0.02)

    @pytest.mark.parametrize(
        ("world", "half_angle", "near", "expected"),
        [
            (WORLD, 0.6, 2.5, True),
            (WORLD, 1.4, 2.5, False),  # wide pixels leave the frustum
            (WORLD, 0.6, 0.05, False),  # cameras stand past the near plane
            (surrounding_world(), 0.6, 2.5, False),
            (OPPOSITE, 0.6, 2.5, False),  # there is no mean axis
        ],
    )
    def test_forward_facing_detection(self, world, half_angle, near, expected):
        half_angles = np.full(len(world.camtoworlds), half_angle)
        found = poses.is_forward_facing(world.camtoworlds, half_angles, near)
        assert found is expected

    def test_average_pose_of_one_camera_is_that_camera(self):
        pose = WORLD.camtoworlds[:1]
        np.testing.assert_allclose(poses.average_pose(pose), pose[0], atol=1e-12)


class TestPictures:
    def test_levels_are_exact(self, tmp_path):
        scene = load(write_llff(tmp_path, WORLD), holdout=0)
        for i, image in enumerate(scene.images):
            assert image.dtype == np.uint16 and image.shape == (18, 24, 3)
            np.testing.assert_array_equal(image, (4 + i) * 257)

    def test_factor_averages_blocks_and_keeps_half_levels(self, tmp_path):
        """A checkerboard of 10 and 11 becomes 10.5, which 8 bits cannot hold."""
        write_llff(tmp_path, WORLD)
        checker = flat_picture(10.0)
        checker[(np.indices((18, 24)).sum(axis=0) % 2) == 1] = 11.0 / 255.0
        image_io.write(tmp_path / "images" / "00.png", checker)
        image = load(tmp_path, "test", factor=2).images[0]
        assert image.shape == (9, 12, 3)
        np.testing.assert_allclose(image / 257.0, 10.5, atol=0.01)

    def test_factor_rounds_the_size_down_and_the_rays_still_span_the_picture(
        self, tmp_path
    ):
        """18 / 4 = 4.5 rows become 4, each 4.5 rows high: fy = 20 * 4 / 18."""
        scene = load(write_colmap(tmp_path, WORLD).parent, factor=4)
        assert scene.images[0].shape == (4, 6, 3)
        (lens,) = set(scene.lenses)
        assert (lens.model, lens.width, lens.height) == ("PINHOLE", 6, 4)
        np.testing.assert_allclose(lens.params, [5.0, 20 * 4 / 18, 3.0, 2.0])
        assert isinstance(scene.space, ForwardFacing)
        np.testing.assert_allclose(scene.space.scale, [40 / 24, 40 / 18], rtol=1e-6)

    @pytest.mark.parametrize("factor", [0, 19])
    def test_impossible_factor(self, tmp_path, factor):
        write_llff(tmp_path, WORLD)
        with pytest.raises(UserError, match="factor"):
            load(tmp_path, factor=factor)

    def test_smaller_files_scale_the_lens(self, tmp_path):
        write_llff(tmp_path, WORLD)
        for name in WORLD.names:
            image_io.write(tmp_path / "images" / name, flat_picture(5.0, 12, 9))
        lens = load(tmp_path).lenses[0]
        assert lens == Lens("SIMPLE_PINHOLE", 12, 9, (10.0, 6.0, 4.5))

    def test_views_with_equal_lenses_share_a_table(self, tmp_path):
        write_nerfstudio(tmp_path, WORLD)
        path = tmp_path / "transforms.json"
        edit_json(path, lambda c: c["frames"][0].update(fl_x=30.0, w=12.0, cx=6.0))
        image_io.write(tmp_path / "images" / "05.png", flat_picture(5.0, 12, 18))
        cameras = load(tmp_path, holdout=0, **BOUNDS).cameras
        assert cameras.directions.shape == (2 * NODES**2, 3)
        np.testing.assert_array_equal(cameras.table_starts, [0, 0, 0, 0, 0, NODES**2])
        np.testing.assert_array_equal(cameras.widths, [24, 24, 24, 24, 24, 12])
        assert all(
            isinstance(getattr(cameras, field.name), np.ndarray)
            for field in dataclasses.fields(cameras)
        )

    def test_another_shape_is_refused(self, tmp_path):
        write_llff(tmp_path, WORLD)
        image_io.write(tmp_path / "images" / "03.png", flat_picture(5.0, 18, 24))
        with pytest.raises(UserError, match=r"03\.png: 18x24 pixels .* for 24x18"):
            load(tmp_path)

    @pytest.mark.parametrize(
        "spoil",
        [
            lambda content: b"",
            lambda content: content[: len(content) // 2],
            lambda content: b"this is not a picture",
        ],
        ids=["empty", "truncated", "text"],
    )
    def test_unreadable_pictures_are_named(self, tmp_path, spoil):
        write_llff(tmp_path, WORLD)
        path = tmp_path / "images" / "03.png"
        path.write_bytes(spoil(path.read_bytes()))
        with pytest.raises(UserError, match=r"03\.png: not a readable image"):
            load(tmp_path)

    def test_raw_photos_are_explained(self, tmp_path):
        write_nerfstudio(tmp_path, WORLD)
        raw = tmp_path / "images" / "03.DNG"
        (tmp_path / "images" / "03.png").rename(raw)
        edit_json(
            tmp_path / "transforms.json",
            lambda c: c["frames"][2].update(file_path="images/03.DNG"),
        )
        with pytest.raises(UserError, match=r"03\.DNG: RAW photo"):
            load(tmp_path, **BOUNDS)

    @pytest.mark.parametrize("write", [write_llff, write_colmap])
    def test_poses_of_colmap_and_llff_mean_pixels_as_stored(self, tmp_path, write):
        write(tmp_path, WORLD)
        stored = flat_picture(40.0)
        stored[9:] = 0.0
        buffer = oiio.ImageBuf(np.ascontiguousarray(stored))
        buffer.specmod()["Orientation"] = 3  # upside down
        buffer.set_write_format("uint8")
        (tmp_path / "images" / "00.png").unlink()
        assert buffer.write(str(tmp_path / "images" / "00.jpg"))
        image = load(tmp_path, "test").images[0]
        assert image[:8].min() > 37 * 257 and image[10:].max() < 3 * 257

    def test_exif_orientation_is_applied(self, tmp_path):
        """Stored 18x24 lying on its side (6: turn clockwise), seen as 24x18."""
        write_nerfstudio(tmp_path, WORLD)
        stored = flat_picture(40.0, 18, 24)
        stored[12:] = 0.0  # the bottom half comes to the left
        buffer = oiio.ImageBuf(np.ascontiguousarray(stored))
        buffer.specmod()["Orientation"] = 6
        buffer.set_write_format("uint8")
        (tmp_path / "images" / "00.png").unlink()
        assert buffer.write(str(tmp_path / "images" / "00.jpg"))
        image = load(tmp_path, "test").images[0]
        assert image.shape == (18, 24, 3)
        assert image[:, :10].max() < 3 * 257 and image[:, 14:].min() > 37 * 257

    @pytest.mark.parametrize(
        ("orientation", "size", "stated", "is_said"),
        [
            (1, (24, 18), {}, False),
            (3, (24, 18), {"w": 24, "h": 18}, True),
            (6, (18, 24), {"w": 24, "h": 18}, False),
            (6, (18, 24), {}, True),
        ],
    )
    def test_an_orientation_that_no_size_tells_is_said(
        self, tmp_path, capsys, orientation, size, stated, is_said
    ):
        write_nerfstudio(tmp_path, WORLD)

        def change(content):
            for key in ("w", "h"):
                del content[key]
            content.update(stated)

        edit_json(tmp_path / "transforms.json", change)
        buffer = oiio.ImageBuf(np.ascontiguousarray(flat_picture(40.0, *size)))
        buffer.specmod()["Orientation"] = orientation
        (tmp_path / "images" / "00.png").unlink()
        assert buffer.write(str(tmp_path / "images" / "00.jpg"))
        load(tmp_path)
        said = "like 1 of 6 photos; no stated size tells" in capsys.readouterr().out
        assert said == is_said

    def test_one_photo_whose_size_tells_speaks_for_all(self, tmp_path, capsys):
        write_nerfstudio(tmp_path, WORLD)
        for name, orientation, size in (("00", 6, (18, 24)), ("01", 3, (24, 18))):
            buffer = oiio.ImageBuf(np.ascontiguousarray(flat_picture(40.0, *size)))
            buffer.specmod()["Orientation"] = orientation
            (tmp_path / "images" / f"{name}.png").unlink()
            assert buffer.write(str(tmp_path / "images" / f"{name}.jpg"))
        assert load(tmp_path).upright
        assert "no stated size tells" not in capsys.readouterr().out

    def test_alpha_is_composited_onto_black(self, tmp_path):
        write_llff(tmp_path, WORLD)
        rgba = np.concatenate([flat_picture(100.0), flat_picture(0.0)[..., :1]], -1)
        rgba[:, 12:, 3] = 1.0
        image_io.write(tmp_path / "images" / "00.png", rgba)
        image = load(tmp_path, "test").images[0]
        np.testing.assert_array_equal(image[:, :12], 0)
        np.testing.assert_array_equal(image[:, 12:], 100 * 257)

    def test_normal_light_is_warned_about_with_its_brightness(self, tmp_path, capsys):
        write_llff(tmp_path, WORLD)
        load(tmp_path)
        assert "WARNING" not in capsys.readouterr().out
        write_pictures(tmp_path / "images", WORLD.names, first_level=150.0)
        load(tmp_path, holdout=0)
        printed = capsys.readouterr().out
        assert "WARNING: this does not look like a low-light scene" in printed
        assert "mean brightness 152 of 255" in printed  # 150 ... 155, to even


class TestTruth:
    def test_folder_beside_the_dark_one_is_found(self, tmp_path, capsys):
        test = load(write_blender(tmp_path, WORLD, test=(1, 3)), "test", **BOUNDS)
        levels = [
            int(image.max()) // 257 for image in (*test.images, *test.truth.values())
        ]
        assert levels == [5, 7, 151, 153]
        assert "paired by equal names: 00.png -> 00.png" in capsys.readouterr().out

    def test_without_one_there_is_none(self, tmp_path, capsys):
        assert load(write_llff(tmp_path, WORLD)).truth == {}
        assert "none found; Config.gt_dir" in capsys.readouterr().out

    @pytest.mark.parametrize("absolute", [False, True])
    def test_given_folder(self, tmp_path, absolute):
        write_llff(tmp_path, WORLD)
        write_pictures(tmp_path / "day", [f"day_{n}" for n in WORLD.names], 200.0)
        gt_dir = str(tmp_path / "day") if absolute else "day"
        scene = load(tmp_path, gt_dir=gt_dir, factor=2)
        assert [t.shape for t in scene.truth.values()] == [(9, 12, 3)] * 5
        assert [int(t.max()) // 257 for t in scene.truth.values()] == [
            201,
            202,
            203,
            204,
            205,
        ]

    def test_order_pairs_over_all_pictures_not_over_the_split(self, tmp_path):
        write_llff(tmp_path, WORLD)
        write_pictures(tmp_path / "gt", [f"{c}.png" for c in "abcdef"], 200.0)
        test = load(tmp_path, "test", holdout=4)
        assert [int(t.max()) // 257 for t in test.truth.values()] == [200, 204]

    def test_order_counts_photos_that_have_no_pose(self, tmp_path):
        """COLMAP placed 00 ... 05 of seven photos; the seventh sorts first."""
        write_colmap(tmp_path, WORLD)
        write_pictures(tmp_path / "images", ["00-unplaced.png"])
        write_pictures(tmp_path / "gt", [f"{c}.png" for c in "abcdefg"], 200.0)
        test = load(tmp_path, "test", holdout=4)
        assert [int(t.max()) // 257 for t in test.truth.values()] == [201, 205]

    def test_what_cannot_be_paired_is_refused_for_scores_alone(self, tmp_path, capsys):
        write_llff(tmp_path, WORLD)
        write_pictures(tmp_path / "gt", ["a.png", "b.png"])
        for options, message in (
            ({}, "cannot pair its 2 pictures with 6 views"),
            ({"gt_dir": "nowhere"}, "folder of pictures not found"),
        ):
            with pytest.raises(UserError, match=message):
                load(tmp_path, "test", **options)
            assert load(tmp_path, **options).truth == {}
            assert f"WARNING: none for scores: {tmp_path}" in capsys.readouterr().out

    @pytest.mark.parametrize(
        ("given", "rule", "has"),
        [
            (["00.png", "02.png", "04.png"], "names", [0, 1, 2]),
            (["04.png", "00.jpg"], "names", [0, 2]),
            (["day_4.png", "day_2.png"], "numbers in the names", [1, 2]),
            (["01.png", "02.png", "03.png", "04.png", "05.png"], "names", [1, 2]),
        ],
    )
    def test_views_have_the_truth_that_is_there(
        self, tmp_path, capsys, given, rule, has
    ):
        """Views 0, 2 and 4 are for testing; level 200 + n is the truth of view n."""
        write_llff(tmp_path, WORLD)
        for name in given:
            number = int("".join(c for c in name if c.isdigit()))
            write_pictures(tmp_path / "gt", [name], 200.0 + number)
        load(tmp_path, holdout=2)
        test = load(tmp_path, "test", holdout=2)
        assert list(test.truth) == has
        levels = [round(int(t.max()) / 257) for t in test.truth.values()]
        assert levels == [200 + 2 * view for view in has]
        printed = capsys.readouterr().out
        assert f"paired by {rule}" in printed
        lonely = [f"0{2 * view}.png" for view in range(3) if view not in has]
        expected = f"none for {', '.join(lonely)} of 3 test views"
        assert (expected in printed) == bool(lonely)

    def test_test_views_of_bright_photos_alone_are_truth_without_input(
        self, tmp_path, capsys
    ):
        """RealX3D: train/ is dark, test/ shows other views in normal light."""
        for split, level in (("train", 4.0), ("test", 150.0)):
            write_pictures(tmp_path / split, WORLD.names[:4], level)
            frames = frame_entries(WORLD, split)[:4]
            content = {**intrinsics(LENS), "near": 2.0, "far": 7.0, "frames": frames}
            write_json(tmp_path / f"transforms_{split}.json", content)
        train, test = (load(tmp_path, split) for split in ("train", "test"))
        assert len(train.images) == 4 and train.truth == {}
        assert len(test.images) == 0 and list(test.truth) == [0, 1, 2, 3]
        assert int(test.truth[2].max()) == 152 * 257
        assert "test views' own photos (test/00.png" in capsys.readouterr().out
        write_pictures(tmp_path / "test", WORLD.names[:4], 5.0)  # dark: they are input
        test = load(tmp_path, "test")
        assert len(test.images) == 4 and test.truth == {}

    def test_one_pixel_is_resized_with_a_warning_more_is_refused(
        self, tmp_path, capsys
    ):
        write_blender(tmp_path, WORLD)
        truth = tmp_path / "high" / "00.png"
        image_io.write(truth, flat_picture(150.0, 24, 19))
        scene = load(tmp_path, "test", **BOUNDS)
        assert scene.truth[0].shape == (18, 24, 3)
        np.testing.assert_array_equal(scene.truth[0], 150 * 257)
        assert "warning" in capsys.readouterr().out
        image_io.write(truth, flat_picture(150.0, 24, 20))
        with pytest.raises(UserError, match=r"24x20 pixels, but the dark .* has 24x18"):
            load(tmp_path, "test", **BOUNDS)

    def test_bright_input_by_images_dir_is_its_own_truth(self, tmp_path):
        write_blender(tmp_path, WORLD)
        scene = load(tmp_path, images_dir="high", **BOUNDS)
        for image, truth in zip(scene.images, scene.truth.values(), strict=True):
            np.testing.assert_array_equal(image, truth)


def real(name: str) -> Path:
    folder = DATA / name
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there; LLNERF_DATA names the folder of captures")
    return folder


class TestRealCaptures:
    @pytest.mark.parametrize(
        ("name", "train", "test", "near", "far"),
        [
            ("lom/buu", 22, 3, (2.3, 3.3), (5.0, 8.0)),
            ("lom/chair", 43, 5, (1.5, 2.6), (5.0, 10.0)),
        ],
    )
    def test_lom(self, capsys, name, train, test, near, far):
        folder = real(name)
        scenes = [load(folder, split, factor=4) for split in ("train", "test")]
        assert [len(scene.images) for scene in scenes] == [train, test]
        assert [len(scene.truth) for scene in scenes] == [train, test]
        for scene in scenes:
            assert near[0] < scene.near < near[1] and far[0] < scene.far < far[1]
            assert isinstance(scene.space, ForwardFacing)
            assert scene.images[0].shape == (93, 125, 3)
            assert np.mean(scene.images) < 0.25 * np.mean(list(scene.truth.values()))
        printed = capsys.readouterr().out
        assert "ndc (detected" in printed and "WARNING" not in printed

    def test_lom_json_and_colmap_agree(self):
        """One reconstruction in two coordinate systems: same model-frame rays."""
        folder = real("lom/buu")
        options = {"factor": 25, "images_dir": "low"}
        by_json = load(folder, holdout=0, **options)
        by_colmap = load(folder, dataset_loader="colmap", holdout=0, **options)
        views = [by_colmap.view_names.index(name) for name in by_json.view_names]
        np.testing.assert_allclose(
            by_colmap.cameras.camtoworlds[views],
            by_json.cameras.camtoworlds,
            atol=0.02,  # near comes from the training views, which differ
        )

    def test_enhanced_pictures_can_be_the_input(self):
        folder = real("lom/buu")
        scene = load(
            folder,
            "test",
            images_dir="Low_light_enhance/enh_SCI",
            pair_by="number",
            factor=4,
        )
        assert len(scene.images) == len(scene.truth) == 3
        dark = load(folder, "test", factor=4)
        assert np.mean(scene.images) > 2.0 * np.mean(dark.images)

    def test_fern(self, capsys):
        scene = load(real("llff/fern"), "test", factor=4)
        assert scene.view_names == ("image000.png", "image008.png", "image016.png")
        assert scene.images[0].shape == (94, 126, 3)
        assert isinstance(scene.space, ForwardFacing)
        assert "WARNING: this does not look" in capsys.readouterr().out


def test_gains_of_photos_are_read_from_the_file_that_prepare_writes(tmp_path, capsys):
    folder = write_llff(tmp_path, WORLD)
    names = readers.read_files(folder, "auto", "").names
    gains = {name: [1.0 + i / 10] * 3 for i, name in enumerate(names)}
    write_json(folder / "exposures.json", {"gains": gains})
    scene = load(folder)
    expected = [gains[name] for name in scene.view_names]
    np.testing.assert_allclose(scene.gains, expected, rtol=1e-6)
    assert "exposures: differ" in capsys.readouterr().out
    plain = load(folder, photo_gains=False)
    np.testing.assert_array_equal(plain.gains, 1.0)


@pytest.mark.parametrize("gains", [{}, {"gains": {}}, "zero", [1]])
def test_gains_that_make_no_sense_are_named(tmp_path, gains):
    folder = write_llff(tmp_path, WORLD)
    names = readers.read_files(folder, "auto", "").names
    content = {"gains": dict.fromkeys(names, [0.0] * 3)} if gains == "zero" else gains
    write_json(folder / "exposures.json", content)
    with pytest.raises(UserError, match=r"exposures\.json.*Config\.photo_gains"):
        load(folder)


def test_photos_without_any_light_are_refused(tmp_path):
    folder = write_nerfstudio(tmp_path, WORLD, **BOUNDS)
    for name in WORLD.names:
        image_io.write(folder / "images" / name, flat_picture(0))
    with pytest.raises(UserError, match=r"images: all \d photos are black"):
        load(folder)


def test_cameras_at_one_place_are_warned_of(tmp_path, capsys):
    still = dataclasses.replace(WORLD, camtoworlds=WORLD.camtoworlds.copy())
    still.camtoworlds[:, :, 3] = WORLD.camtoworlds[0, :, 3]
    load(write_nerfstudio(tmp_path, still, **BOUNDS))
    assert "all 6 cameras stand at one place" in capsys.readouterr().out
