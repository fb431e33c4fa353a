# SPDX-License-Identifier: Apache-2.0
"""What other tools' pose files say in other words or wrongly: read right or refused."""

import math

import numpy as np
import pytest

from internal.errors import UserError
from internal.files import ply
from internal.scene.config import SceneConfig
from internal.scene.readers import read_files
from internal.scene.scene import load_scene
from tests.scene_writers import (
    edit_json,
    surrounding_world,
    write_colmap,
    write_model,
    write_nerfstudio,
)


@pytest.mark.parametrize(
    ("own", "frames_own", "focal"),
    [
        ({"camera_angle_x": 2 * math.atan(0.6)}, {}, (20.0, 20.0)),  # says the same
        ({"fl_x": None, "fl_y": None, "x_fov": 60.0}, {}, (20.785, 20.785)),
        ({}, {"camera_angle_x": 2 * math.atan(0.3)}, (40.0, 40.0)),
        ({"camera_angle_x": 0.3, "fl_x": None}, {"fl_x": 30.0}, (30.0, 20.0)),
    ],
)
def test_focal_lengths_however_they_are_stated(own, frames_own, focal, tmp_path):
    write_nerfstudio(tmp_path, surrounding_world(6))

    def change(content):
        content.update(own)
        for key in [key for key, value in content.items() if value is None]:
            del content[key]
        for frame in content["frames"]:
            frame.update(frames_own)

    edit_json(tmp_path / "transforms.json", change)
    lens = read_files(tmp_path, "auto", "").lenses[0]
    assert lens.params[:2] == pytest.approx(focal, abs=1e-3)


def test_distortion_terms_of_nerfstudios_list(tmp_path):
    terms = [0.1, 0.02, 0.003, 0.0, 0.01, 0.02]  # k1 k2 k3 k4 p1 p2
    write_nerfstudio(tmp_path, surrounding_world(6), distortion_params=terms)
    lens = read_files(tmp_path, "auto", "").lenses[0]
    assert lens.model == "FULL_OPENCV"  # fx fy cx cy k1 k2 p1 p2 k3 ...
    assert lens.params[4:9] == (0.1, 0.02, 0.01, 0.02, 0.003)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("camera_angle_x", 0.3, "two focal lengths for .*: fl_x says 20 but"),
        ("x_fov", 200.0, "x_fov is 200"),
        ("fl_x", 0.83, "focal length .* expected pixels"),  # part of the width
        ("cx", 0.5, "cx of .* is 0.5, of 24 pixels"),
        ("cy", 18.0, "cy of .* inside the picture"),
        ("cx", -3.0, "cx of"),
        ("distortion_params", [0.1], "distortion_params of .* expected k1, k2"),
        ("ftheta_p0", 0.0, "has ftheta_p0"),
        ("from_mitsuba", True, "has from_mitsuba"),
    ],
)
def test_lenses_that_contradict_themselves_are_refused(key, value, words, tmp_path):
    write_nerfstudio(tmp_path, surrounding_world(6))
    edit_json(
        tmp_path / "transforms.json", lambda content: content.update({key: value})
    )
    with pytest.raises(UserError, match=words):
        read_files(tmp_path, "auto", "")


@pytest.mark.parametrize(
    "spelling", ["./images/{}.png", "images\\{}.png", "images/{}", "{}.png", "{}"]
)
def test_a_split_names_frames_in_any_spelling(spelling, tmp_path, capsys):
    lists = {
        "train_filenames": [spelling.format(f"{view:02}") for view in range(2, 6)],
        "test_filenames": [spelling.format("00"), "images/77.png"],
    }
    write_nerfstudio(tmp_path, surrounding_world(6), **lists)
    files = read_files(tmp_path, "auto", "")
    assert files.names == ("00.png", "02.png", "03.png", "04.png", "05.png")
    assert files.test_names == {"00.png"}
    assert (
        "test_filenames name what is no frame: images/77.png" in capsys.readouterr().out
    )


def test_a_colmap_scene_holds_out_what_its_test_txt_lists(tmp_path, capsys):
    write_colmap(tmp_path, surrounding_world(6))
    split = tmp_path / "sparse/0/test.txt"
    split.write_text("01.png\nimages/03.jpg\n99.png\n\n")
    assert read_files(tmp_path, "auto", "").test_names == {"01.png", "03.png"}
    assert "99.png" in capsys.readouterr().out
    split.write_text("none.png\n")
    with pytest.raises(UserError, match=r"test\.txt: names no view"):
        read_files(tmp_path, "auto", "")


def with_opencv_axes(content):
    for frame in content["frames"]:
        matrix = np.array(frame["transform_matrix"]) * (1.0, -1.0, -1.0, 1.0)
        frame["transform_matrix"] = matrix.tolist()


@pytest.mark.parametrize("points", ["a model", "a cloud"])
def test_poses_with_the_axes_of_opencv_are_refused_where_points_tell(points, tmp_path):
    world = surrounding_world(6)
    write_nerfstudio(tmp_path, world, ply_file_path="cloud.ply")
    if points == "a model":
        write_model(tmp_path / "sparse/0", world)
    else:
        ply.write(tmp_path / "cloud.ply", dict(zip("xyz", world.points.T, strict=True)))
    load_scene(SceneConfig(str(tmp_path)), "train")
    edit_json(tmp_path / "transforms.json", with_opencv_axes)
    with pytest.raises(UserError, match="negate the second and third column"):
        load_scene(SceneConfig(str(tmp_path)), "train")
