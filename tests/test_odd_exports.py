# SPDX-License-Identifier: Apache-2.0
"""What other programs write into scenes: read as they mean it, or said not to be."""

import dataclasses
import json
import shutil

import numpy as np
import OpenImageIO as oiio
import pytest

from internal.cameras import Lens
from internal.errors import UserError
from internal.files import image_io
from internal.scene.config import SceneConfig
from internal.scene.gains import load_gains
from internal.scene.pose_checks import check_lenses
from internal.scene.readers import read_files
from internal.scene.readers.transforms_entries import Entry
from internal.scene.scene import load_scene
from tests.scene_writers import (
    edit_json,
    flat_picture,
    surrounding_world,
    write_blender,
    write_colmap,
    write_model,
    write_nerfstudio,
    write_pictures,
)

WORLD = surrounding_world(6)
HIDDEN = np.zeros((18, 24, 3), np.float32)
HIDDEN[:6] = 0.02  # not black, that is


def write_truth(folder, picture):
    folder.mkdir()
    for name in WORLD.names:
        image_io.write(folder / name, picture)


def load(folder, split="train", **options):
    return load_scene(SceneConfig(str(folder), **options), split)


@pytest.mark.parametrize("beside", [None, "masks"])
def test_masks_of_instant_ngp_hide_what_is_not_black(beside, tmp_path, capsys):
    write_nerfstudio(tmp_path, WORLD)
    for name in WORLD.names[:3]:
        image_io.write(tmp_path / "images" / f"dynamic_mask_{name}", HIDDEN)
    if beside:  # which mean the other custom, and come first
        (tmp_path / "masks").mkdir()
        image_io.write(tmp_path / "masks" / "01.png", np.ones_like(HIDDEN))
    scene = load(tmp_path, holdout=0)
    said = capsys.readouterr().out
    for view in range(len(WORLD.names)):
        counted = np.ones((18, 24), bool)
        counted[:6] = view >= 3 or bool(beside)
        assert (scene.mask(view) == counted).all()
    assert ("dynamic_mask_00.png, ...: not read" in said) == bool(beside)
    assert "in no frame" not in said


def test_masks_under_another_key_are_named(tmp_path, capsys):
    write_nerfstudio(tmp_path, WORLD, mask_filename="mask.png")
    load(tmp_path)
    assert "its mask_filename is not read" in capsys.readouterr().out


def test_what_is_null_in_json_is_not_stated(tmp_path):
    write_nerfstudio(tmp_path, WORLD, k1=None, ply_file_path=None, near=None)

    def change(content):
        for frame in content["frames"]:
            frame.update(fl_x=None, w=None, mask_path=None, p1=None)

    before = read_files(tmp_path, "auto", "")
    edit_json(tmp_path / "transforms.json", change)
    assert read_files(tmp_path, "auto", "").lenses == before.lenses


@pytest.mark.parametrize("values", [[0, 0, 0, 0], [0, 0, 0.03, 0]])
def test_a_shutter_that_rolls_is_refused_and_none_is_not(values, tmp_path):
    write_nerfstudio(tmp_path, WORLD, rolling_shutter=values)
    if any(values):
        with pytest.raises(UserError, match="has rolling_shutter"):
            load(tmp_path)
    else:
        load(tmp_path)


def test_the_circle_of_a_fisheye_is_said_not_to_be_read(tmp_path, capsys):
    lens = {"camera_model": "OPENCV_FISHEYE", "fisheye_crop_radius": 8.0}
    write_nerfstudio(tmp_path, WORLD, **lens)
    load(tmp_path)
    assert "its fisheye_crop_radius is not read" in capsys.readouterr().out


def test_frames_without_photos_are_left_out_without_comparing_all(
    tmp_path, monkeypatch
):
    write_blender(tmp_path, WORLD, test=(0, 1, 2))
    for folder in ("low", "high"):
        (tmp_path / folder / "01.png").unlink()
    monkeypatch.setattr(Entry, "__eq__", lambda *_: pytest.fail("compared"))
    names = read_files(tmp_path, "auto", "").names
    assert names == ("00.png", "02.png", "03.png", "04.png", "05.png")


def test_a_gain_is_that_of_the_longest_end_of_a_path(tmp_path):
    gains = {"1.png": [1, 1, 1], "left/1.png": [2, 2, 2], "t/1.png": [9, 9, 9]}
    (tmp_path / "exposures.json").write_text(json.dumps({"gains": gains}))
    photos = [tmp_path / "images" / name for name in ("1.png", "left/1.png")]
    assert load_gains(tmp_path, photos)[:, 0].tolist() == [1.0, 2.0]
    with pytest.raises(UserError, match="no gain for every photo"):
        load_gains(tmp_path, [tmp_path / "images" / "2.png"])


@pytest.mark.parametrize(
    ("top", "bits"),
    [(250, 8), (1000, 10), (4095, 12), (4096, 0), (16383, 14), (16000, 0), (65535, 0)],
)
def test_files_of_16_bits_that_use_fewer_are_warned_of(top, bits, tmp_path, capsys):
    write_colmap(tmp_path, WORLD)
    ramp = np.linspace(0.0, top / 65535.0, 24, dtype=np.float32)
    picture = np.broadcast_to(ramp[None, :, None], (18, 24, 3))
    for name in WORLD.names:
        image_io.write(tmp_path / "images" / name, picture, bits=16)
    load(tmp_path)
    said = capsys.readouterr().out
    words = f"is above {top} of 65535: if these are values of {bits} bits, multiply "
    assert ("multiply" in said) == bool(bits)
    assert (f"{words}them by {2 ** (16 - bits)};" in said) == bool(bits)


def test_dark_files_of_8_bits_are_no_fewer_bits(tmp_path, capsys):
    write_colmap(tmp_path, WORLD)
    load(tmp_path)
    assert "multiply" not in capsys.readouterr().out


@pytest.mark.parametrize("kind", [np.int32, np.uint32])
def test_integers_of_32_bits_are_refused(kind, tmp_path):
    path = tmp_path / "photo.tif"  # 8 bits of them used: black, if all were
    oiio.ImageBuf(np.full((4, 5, 1), 200, kind)).write(str(path))
    with pytest.raises(UserError, match="integers of 32 bits"):
        image_io.read_srgb(path)


@pytest.mark.parametrize("factor", [1, 2])
def test_larger_truth_of_a_photos_shape_is_brought_to_its_size(
    factor, tmp_path, capsys
):
    write_colmap(tmp_path, WORLD)
    fine = np.zeros((36, 48, 3), np.float32)
    fine[::2, ::2] = 0.8
    write_truth(tmp_path / "high", fine)
    truth = load(tmp_path, "test", factor=factor).truth[0]
    assert truth.shape == (18 // factor, 24 // factor, 3)
    assert np.abs(truth / 65535.0 - 0.2).max() < 1e-4
    assert "48x36 pixels is brought to the 24x18" in capsys.readouterr().out


@pytest.mark.parametrize("size", [(12, 9), (48, 30), (30, 18)])
def test_truth_that_is_smaller_or_of_another_shape_is_refused(size, tmp_path):
    write_colmap(tmp_path, WORLD)
    write_truth(tmp_path / "high", flat_picture(150, *size))
    with pytest.raises(UserError, match="truth must show the same pixels"):
        load(tmp_path, "test")


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("bundle.out", "Bundler"),
        ("bundle/bundle.out", "Bundler"),
        ("scene.nvm", "VisualSFM"),
        ("reconstruction.json", "OpenSfM"),
        ("cameras.sfm", "Meshroom"),
        ("cameras_sphere.npz", "NeuS"),
        ("cams/1_cam.txt", "MVSNet"),
        ("pose/1.txt", "NSVF or ScanNet"),
        ("1.xmp", "RealityScan"),
        ("rgbd/1.jpg", "Record3D"),
        ("keyframes/cameras/1.json", "Polycam"),
        ("metadata.json", "Record3D"),
        ("cameras.xml", "Metashape"),
        ("poses.csv", "RealityScan"),
        ("sfm_data.json", "OpenMVG"),
        ("transforms_all.json", "call it transforms.json"),
        ("sparse/0/cameras.bin", "without images.bin, points3D.bin"),
    ],
)
def test_poses_that_are_not_read_are_known_by_their_files(path, words, tmp_path):
    write_pictures(tmp_path / "images", WORLD.names)
    (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / path).write_text("")
    with pytest.raises(UserError, match=words):
        read_files(tmp_path, "auto", "")


@pytest.mark.parametrize(
    ("place", "words"),
    [
        (".", "move its files to a folder sparse/0"),
        ("colmap_text", "colmap_text is a COLMAP model: move its files"),
        ("dense/0/sparse", "the scene is {}/dense/0"),
    ],
)
def test_a_model_in_another_folder_says_where_it_belongs(place, words, tmp_path):
    write_model(tmp_path / place, WORLD)
    with pytest.raises(UserError) as error:
        read_files(tmp_path, "auto", "")
    assert words.format(tmp_path) in str(error.value)


def test_folders_that_are_there_are_named_where_none_is_of_pictures(tmp_path):
    write_colmap(tmp_path, WORLD)
    (tmp_path / "images").rename(tmp_path / "input")
    with pytest.raises(UserError, match="there are input, sparse: put the photos"):
        read_files(tmp_path, "auto", "")


@pytest.mark.parametrize("where", ["file", "frame"])
def test_keys_that_nobody_reads_are_named(where, tmp_path, capsys):
    write_nerfstudio(tmp_path, WORLD, aabb_scale=16, applied_scale=2.0, masked=1)
    read_files(tmp_path, "auto", "")
    assert "not read: " not in capsys.readouterr().out

    def change(content):
        (content if where == "file" else content["frames"][2])["skew"] = 3.0

    edit_json(tmp_path / "transforms.json", change)
    read_files(tmp_path, "auto", "")
    assert "not read: skew;" in capsys.readouterr().out


def test_a_text_is_no_answer_whether_a_lens_is_a_fisheye(tmp_path):
    write_nerfstudio(tmp_path, WORLD, is_fisheye="false")
    with pytest.raises(UserError, match=r"is_fisheye of 00\.png is .false."):
        read_files(tmp_path, "auto", "")


def test_a_folder_of_another_case_is_the_one_meant(tmp_path):
    write_nerfstudio(tmp_path, WORLD)
    before = read_files(tmp_path, "auto", "")
    (tmp_path / "images").rename(tmp_path / "Images")
    found = read_files(tmp_path, "auto", "")
    assert [path.name for path in found.image_paths] == list(before.names)
    shutil.copytree(tmp_path / "Images", tmp_path / "IMAGES")  # which one?
    with pytest.raises(UserError, match="image not found"):
        read_files(tmp_path, "auto", "")


@pytest.mark.parametrize(("cx", "cy", "is_said"), [(9.0, 12.0, True), (11, 8, False)])
def test_a_principal_point_of_the_turned_picture_is_said(
    cx, cy, is_said, tmp_path, capsys
):
    write_nerfstudio(tmp_path, WORLD, cx=cx, cy=cy)
    load(tmp_path)
    assert ("a picture that was turned, 18x24" in capsys.readouterr().out) == is_said


def test_a_square_picture_is_not_said_to_be_turned(tmp_path, capsys):
    lens = Lens("PINHOLE", 24, 24, (20.0, 20.0, 12.5, 11.5))
    write_nerfstudio(tmp_path, dataclasses.replace(WORLD, lens=lens))
    check_lenses(read_files(tmp_path, "auto", ""))
    assert "turned" not in capsys.readouterr().out


def test_photos_that_are_white_are_named_and_those_with_a_dark_pixel_are_not(
    tmp_path, capsys
):
    write_nerfstudio(tmp_path, WORLD)
    picture = np.ones_like(HIDDEN)
    image_io.write(tmp_path / "images" / "02.png", picture)
    picture[3, 5] = 0.9
    image_io.write(tmp_path / "images" / "03.png", picture)
    load(tmp_path, holdout=0)
    assert "all white: 02.png: remove" in capsys.readouterr().out


def test_photos_of_another_shape_are_said_to_be_turned_where_they_are(tmp_path):
    write_nerfstudio(tmp_path, WORLD, w=18.0, h=24.0, cx=9.0, cy=12.0)
    with pytest.raises(UserError, match="24x18 pixels, but its lens"):
        load(tmp_path)
