# SPDX-License-Identifier: Apache-2.0
"""Masked pixels are in nothing that is trained or scored, wherever a scene says so."""

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from internal.errors import UserError
from internal.files import image_io
from internal.night import darken
from internal.night.capture import CaptureModel
from internal.scene import identity, masks
from internal.scene.config import SceneConfig
from internal.scene.mask_files import match_masks
from internal.scene.noise import noise_of_files
from internal.scene.scene import load_scene
from tests.scene_writers import (
    edit_json,
    facing_world,
    flat_picture,
    write_blender,
    write_colmap,
    write_llff,
    write_nerfstudio,
)

WORLD = facing_world()
BOUNDS: dict[str, Any] = {"near": 2.5, "far": 7.0}
COUNTED = np.zeros((18, 24), bool)
COUNTED[6:, 8:] = True


def write_mask(path, counted=COUNTED, white=1.0):
    path.parent.mkdir(parents=True, exist_ok=True)
    image_io.write(path, np.repeat(counted[..., None], 3, -1) * np.float32(white))


def load(folder, split="train", **options):
    return load_scene(SceneConfig(str(folder), **BOUNDS, **options), split)


def name_mask(folder, view, path):
    """Names a mask for a view in transforms.json."""

    def change(content):
        frames = {f["file_path"]: f for f in content["frames"]}
        frames[f"images/{view:02}.png"]["mask_path"] = path

    edit_json(folder / "transforms.json", change)


@pytest.mark.parametrize("write", [write_nerfstudio, write_llff, write_colmap])
@pytest.mark.parametrize("name", ["01.png", "01.png.png", "01.PNG", "01.jpg"])
def test_a_folder_of_masks_beside_the_photos_is_taken(tmp_path, write, name, capsys):
    write(tmp_path, WORLD)
    write_mask(tmp_path / "masks" / name)
    scene = load(tmp_path)
    assert scene.view_names[0] == "01.png"
    np.testing.assert_array_equal(scene.mask(0), COUNTED)
    assert all(scene.mask(view).all() for view in range(1, 5))
    # 240 of 24 x 18 pixels of one photo of six.
    assert "masks: 1 of 6 photos, 9.3 % of the pixels" in capsys.readouterr().out
    np.testing.assert_array_equal(scene.images[0][~COUNTED], 0)
    np.testing.assert_array_equal(scene.images[0][COUNTED], 5 * 257)
    assert scene.brightness == pytest.approx(7.0 / 255)  # of 5 ... 9
    assert load(tmp_path, "test").masks == ()


def test_a_named_mask_is_taken_and_a_missing_one_is_one_line(tmp_path):
    write_nerfstudio(tmp_path, WORLD)
    write_mask(tmp_path / "elsewhere" / "x.png")
    name_mask(tmp_path, 2, "elsewhere\\x.png")
    np.testing.assert_array_equal(load(tmp_path).mask(1), COUNTED)
    name_mask(tmp_path, 2, "elsewhere/y.png")
    with pytest.raises(UserError, match=r"y\.png: mask not found, but .* for 02\.png"):
        load(tmp_path)
    name_mask(tmp_path, 2, 7)
    with pytest.raises(UserError, match=r"mask_path of 02\.png is 7"):
        load(tmp_path)


def test_masks_follow_photos_into_folders_and_other_sizes(tmp_path):
    world = facing_world()
    write_nerfstudio(tmp_path, world)
    (tmp_path / "images_2" / "left").mkdir(parents=True)
    for name in world.names:
        small = flat_picture(9.0, 12, 9)
        image_io.write(tmp_path / "images_2" / "left" / name, small)

    def change(content):
        for frame in content["frames"]:
            name = frame["file_path"].removeprefix("images/")
            frame["file_path"] = f"images_2/left/{name}"

    edit_json(tmp_path / "transforms.json", change)
    write_mask(tmp_path / "masks" / "left" / "01.png")
    np.testing.assert_array_equal(load(tmp_path).mask(0), COUNTED[::2, ::2])
    write_mask(tmp_path / "masks_2" / "left" / "01.png", COUNTED[::-2, ::2])
    np.testing.assert_array_equal(load(tmp_path).mask(0), COUNTED[::-2, ::2])


def test_other_photos_of_the_views_have_the_scenes_masks(tmp_path):
    scene = tmp_path / "scene"
    write_colmap(scene, WORLD)
    write_mask(scene / "masks" / "01.png")
    other = tmp_path / "other"
    other.mkdir()
    for name in WORLD.names:
        image_io.write(other / name, flat_picture(90.0))
    found = load(scene, images_dir=str(other))
    np.testing.assert_array_equal(found.mask(0), COUNTED)


def test_transparent_pixels_are_masked_but_empty_in_blenders_scenes(tmp_path):
    alpha = np.where(COUNTED, 1.0, np.where(COUNTED.cumsum(1) == 0, 0.9, 0.0))
    rgba = np.concatenate([flat_picture(9.0), alpha[..., None]], -1)
    for write, folder in ((write_llff, "images"), (write_blender, "low")):
        write(tmp_path / folder, WORLD)
        rgba = np.concatenate([flat_picture(9.0), alpha[..., None]], -1)
        image_io.write(
            tmp_path / folder / folder / "01.png", np.asarray(rgba, np.float32)
        )
        scene = load(tmp_path / folder)
        if folder == "images":
            np.testing.assert_array_equal(scene.mask(0), COUNTED)
        else:
            assert scene.masks == () and scene.images[0][5, 3].max() > 2000
    image_io.write(
        tmp_path / "images/images/01.png", np.asarray(rgba * 0 + 1, np.float32)
    )
    assert load(tmp_path / "images").masks == ()


@pytest.mark.parametrize("white, edge", [(1.0, 0.3), (1 / 255, 0.0)])
def test_black_is_ignored_and_faint_edges_of_white_too(tmp_path, white, edge):
    write_llff(tmp_path, WORLD)
    values = np.where(COUNTED, white, 0.0)
    values[5] = edge
    path = tmp_path / "masks" / "01.png"
    write_mask(path, values)
    np.testing.assert_array_equal(load(tmp_path).mask(0), COUNTED)


def test_a_mask_of_another_size_is_resized_of_another_shape_refused(tmp_path):
    write_llff(tmp_path, WORLD)
    path = tmp_path / "masks" / "01.png"
    write_mask(path, np.repeat(np.repeat(COUNTED, 2, 0), 2, 1))
    np.testing.assert_array_equal(load(tmp_path).mask(0), COUNTED)
    write_mask(path, COUNTED[::2, ::2])
    np.testing.assert_array_equal(load(tmp_path).mask(0), COUNTED)
    write_mask(path, COUNTED.T)
    with pytest.raises(
        UserError, match=r"01\.png: 18x24 pixels, but its photo .*24x18"
    ):
        load(tmp_path)


def test_what_cannot_be_meant_is_one_line(tmp_path, capsys):
    write_llff(tmp_path, WORLD)
    path = tmp_path / "masks" / "01.png"
    write_mask(path)
    write_mask(tmp_path / "masks" / "other.png")
    load(tmp_path)
    assert "1 of 2 masks belong to no photo: other.png" in capsys.readouterr().out
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(UserError, match=r"masks/01\.png: not a readable image"):
        load(tmp_path)
    for split in ("train", "test"):  # both before hours of training
        write_mask(path, ~COUNTED & COUNTED)
        with pytest.raises(UserError, match=r"masks/01\.png: all of 01\.png is masked"):
            load(tmp_path, split)
    path.unlink()
    with pytest.raises(
        UserError, match=r"none of its 1 masks, e\.g\. 'other\.png', is"
    ):
        load(tmp_path)


def test_a_test_view_without_a_pixel_that_counts_is_named(tmp_path, capsys):
    write_llff(tmp_path, WORLD)
    write_mask(tmp_path / "masks" / "02.png", ~COUNTED & COUNTED)
    write_mask(tmp_path / "masks" / "04.png")
    scene = load(tmp_path, "test", holdout=2)
    assert "all of 02.png is masked: this test view is not" in capsys.readouterr().out
    assert scene.masked == {"02.png": 1.0, "04.png": 1.0 - COUNTED.mean()}
    assert scene.brightness == pytest.approx(6.0 / 255)  # of 4 and 8
    load(tmp_path, holdout=2)
    for name in ("00.png", "04.png"):
        write_mask(tmp_path / "masks" / name, ~COUNTED & COUNTED)
    with pytest.raises(UserError, match=r"all of 00\.png is masked; black"):
        load(tmp_path, holdout=2)


@pytest.mark.parametrize("jpeg_quality", [0, 90])
def test_a_darkened_scene_keeps_its_masks(tmp_path, jpeg_quality):
    bright, dark = tmp_path / "bright", tmp_path / "dark"
    write_nerfstudio(bright, WORLD)
    write_mask(bright / "elsewhere" / "x.png")
    name_mask(bright, 2, "elsewhere/x.png")
    opaque = COUNTED[::-1].astype(np.float32)[..., None]
    rgba = np.concatenate([flat_picture(90.0), opaque], -1)
    image_io.write(bright / "images" / "03.png", rgba)
    darken.darken(bright, dark, CaptureModel(), jpeg_quality=jpeg_quality)
    scenes = [load(folder) for folder in (bright, dark)]
    for scene in scenes:
        assert list(scene.masked) == ["02.png", "03.png"]
        np.testing.assert_array_equal(scene.mask(1), COUNTED)
        np.testing.assert_array_equal(scene.mask(2), COUNTED[::-1])
    assert scenes[-1].truth


def test_a_filled_pixel_is_the_nearest_that_counts():
    mask = np.array([[True, False, False, False, True]])
    picture = np.arange(15, dtype=np.float32).reshape(1, 5, 3)
    found = masks.filled(picture, mask)
    np.testing.assert_array_equal(found[0, [0, 1, 3, 4]], picture[0, [0, 0, 4, 4]])
    np.testing.assert_array_equal(masks.filled(picture, masks.ALL), picture)


def test_masks_that_look_inverted_are_warned_about(tmp_path, capsys):
    write_llff(tmp_path, WORLD)
    for name in WORLD.names:
        write_mask(tmp_path / "masks" / name, ~COUNTED)
    load(tmp_path)
    assert "WARNING" not in capsys.readouterr().out
    for name in WORLD.names:
        write_mask(tmp_path / "masks" / name)
    load(tmp_path)
    assert "WARNING: masks cover more than half" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["mask", "Masks", "image_masks", "images-mask"])
def test_a_folder_that_is_nearly_called_masks_is_named(tmp_path, name, capsys):
    write_nerfstudio(tmp_path, WORLD)
    write_mask(tmp_path / name / "01.png")
    assert load(tmp_path).masks == ()
    assert f"{name}: not read; masks are read from a folder" in capsys.readouterr().out


def test_names_of_masks():
    names = ["a.jpg", "b.jpg", "c.1.jpg", "d.jpg", "d.png", "left/e.JPG", "é.jpg"]
    listed = ["a.png", "b.jpg.png", "c.1.png", "d.jpg.png", "left/e.jpg.png"]
    found = match_masks(names, [*listed, "é.jpg.png", "none.png"])
    assert found == {
        **{"a.jpg": "a.png", "b.jpg": "b.jpg.png", "c.1.jpg": "c.1.png"},
        **{"d.jpg": "d.jpg.png", "left/e.JPG": "left/e.jpg.png", "é.jpg": "é.jpg.png"},
    }
    assert match_masks(["d.jpg", "d.png"], ["d.webp"]) == {}  # whose?


@given(st.integers(1, 30), st.integers(1, 30), st.integers(1, 40), st.integers(0, 99))
def test_a_resized_pixel_counts_if_all_does_that_it_covers(old, rows, columns, seed):
    mask = np.random.default_rng(seed).random((old, 7)) < 0.8
    found = masks.resize_mask(mask, columns, rows)
    for y, x in np.ndindex(rows, columns):
        top, bottom = y * old // rows, -(-(y + 1) * old // rows)
        left, right = x * 7 // columns, -(-(x + 1) * 7 // columns)
        assert found[y, x] == mask[top:bottom, left:right].all()


@pytest.mark.parametrize("factor", [1, 2, 5])
def test_a_scene_knows_nothing_of_what_is_under_its_masks(tmp_path, factor):
    """Photos, truth, noise and brightness are equal bit for bit."""
    scenes = []
    rng = np.random.default_rng(0)
    own = rng.uniform(0.0, 0.3, (6, 36, 48, 3))
    garbage = rng.uniform(0.0, 1.0, (2, 36, 48, 3))
    counted = rng.random((36, 48)) < 0.9
    counted[:22] = False
    counted[25:] = True
    for world, rubbish in zip(("a", "b"), garbage, strict=True):
        folder = tmp_path / world
        write_llff(folder, WORLD)
        for i, name in enumerate(WORLD.names):
            photo = np.where(counted[..., None], own[i], rubbish)
            image_io.write(folder / "images" / name, np.asarray(photo, np.float32))
            bright = np.where(counted[..., None], 3 * own[i], rubbish)
            (folder / "gt").mkdir(exist_ok=True)
            image_io.write(folder / "gt" / name, np.asarray(bright, np.float32))
            write_mask(folder / "masks" / name, counted)
        scenes.append(load(folder, factor=factor, unrounded=True))
    first, second = scenes
    for what in ("images", "truth", "masks"):
        for one, two in zip(getattr(first, what), getattr(second, what), strict=True):
            np.testing.assert_array_equal(one, two)
    assert first.brightness == second.brightness
    assert first.noise == second.noise
    assert 0.0 < masks.masked_share(first.masks) < 1.0


def test_the_noise_is_that_of_the_photo_without_what_is_masked(tmp_path):
    rng = np.random.default_rng(0)
    photo = np.asarray(rng.normal(0.3, 0.02, (160, 200, 3)), np.float32)
    photo[:80] = 0.1
    for name, rows in (("all", photo), ("part", photo[80:])):
        image_io.write(tmp_path / f"{name}.png", rows)
    counted = np.ones((160, 200), bool)
    counted[:80] = False
    whole, part = [tmp_path / "all.png"], noise_of_files([tmp_path / "part.png"])
    assert part.growth[1] > 1e-5
    assert noise_of_files(whole) != part
    for mask in (counted, counted[::2, ::5]):
        assert noise_of_files(whole, [mask]) == part


def test_a_scene_remembers_its_masks(tmp_path):
    write_llff(tmp_path, WORLD)
    without = load(tmp_path).identity
    assert "mask" not in json.dumps(without)  # as runs before there were masks have it
    write_mask(tmp_path / "masks" / "01.png")
    first = load(tmp_path).identity
    write_mask(tmp_path / "masks" / "01.png", COUNTED[::-1])
    second = load(tmp_path).identity
    for old, new in ((without, first), (first, second), (second, without)):
        assert identity.changes(old, new) == ["1 of 6 views with another mask (01.png)"]
    assert identity.changes(second, load(tmp_path).identity) == []
