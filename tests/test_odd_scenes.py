# SPDX-License-Identifier: Apache-2.0
"""What other tools' pose files say in other words or wrongly: read right or refused."""

import dataclasses
import math
import re
import shutil

import numpy as np
import pytest

from internal.cameras import Lens
from internal.errors import UserError
from internal.files import image_io, ply
from internal.scene.config import SceneConfig
from internal.scene.loading import fit_lenses
from internal.scene.pose_checks import check_lenses
from internal.scene.readers import read_files, transforms_pictures
from internal.scene.scene import load_scene
from tests.scene_writers import (
    edit_json,
    flat_picture,
    llff_rows,
    random_rotation,
    surrounding_world,
    write_blender,
    write_colmap,
    write_llff,
    write_model,
    write_nerfstudio,
    write_pictures,
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


@pytest.mark.parametrize(
    ("sizes", "is_said"),
    [
        ([(24, 18), (24, 18)], False),
        ([(24, 18), (48, 36)], False),
        ([(24, 18), (24, 24)], False),  # cropped above and below: of one width
        ([(24, 18), (18, 24)], True),
    ],
)
def test_one_angle_for_pictures_of_several_shapes_is_said(
    sizes, is_said, tmp_path, capsys
):
    world = surrounding_world(6)
    write_nerfstudio(tmp_path, world)

    def change(content):
        for key in ("fl_x", "fl_y", "cx", "cy", "w", "h"):
            del content[key]
        content["camera_angle_x"] = 2.0 * math.atan(0.6)

    edit_json(tmp_path / "transforms.json", change)
    for view, name in enumerate(world.names):
        image_io.write(tmp_path / "images" / name, flat_picture(9, *sizes[view % 2]))
    lenses = read_files(tmp_path, "auto", "").lenses
    focals = [lens.params[0] / lens.width for lens in lenses]
    assert focals == pytest.approx([20 / 24] * 6)
    assert ("one camera_angle_x for pictures" in capsys.readouterr().out) == is_said


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
        ("transform_matrix_end", [[1.0]], "has transform_matrix_end"),
        ("s1", 0.02, "s1 of .* no such term"),
        ("w", True, "w of .* is True; expected a finite number"),
        ("ply_file_path", ["a.ply"], "ply_file_path is .* expected a path"),
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


@pytest.mark.parametrize("model", [{"is_fisheye": True}, {"camera_model": "OPENCV"}])
@pytest.mark.parametrize("key", "k1 k2 k3 k4 k5 k6 p1 p2".split())
def test_no_distortion_term_is_passed_over(model, key, tmp_path):
    write_nerfstudio(tmp_path, surrounding_world(6), **model, **{key: 0.02})
    try:
        lens = read_files(tmp_path, "auto", "").lenses[0]
    except UserError as error:
        assert f"{key} of 00.png is 0.02; this program has no such term" in str(error)
    else:
        assert 0.02 in lens.params[4:]


@pytest.mark.parametrize("key", ["file_path", "mask_path", "ply_file_path"])
@pytest.mark.parametrize(
    "value", ["", ".", "/", "..", "a" * 300, "a/" * 1000, "a\0b", "\ud800", "~/a.png"]
)
def test_a_path_that_no_disk_takes_is_no_file(key, value, tmp_path, capsys):
    write_nerfstudio(tmp_path, surrounding_world(6))

    def change(content):
        content["frames"][0][key] = value

    edit_json(tmp_path / "transforms.json", change)
    if key == "ply_file_path" and value == "\ud800":
        return  # in a warning, which only a script's own output can write
    if value and key != "ply_file_path":
        with pytest.raises(UserError, match=r"(image|mask) not found"):
            read_files(tmp_path, "auto", "")
    elif key == "file_path":
        with pytest.raises(UserError, match='frame 0 has no "file_path"'):
            read_files(tmp_path, "auto", "")
    else:
        assert len(read_files(tmp_path, "auto", "").names) == 6
        assert ("ply_file_path not used" in capsys.readouterr().out) == bool(value)


def test_names_that_are_none_in_a_split_are_named(tmp_path, capsys):
    write_nerfstudio(
        tmp_path, surrounding_world(6), test_filenames=["", "/", "images/01.png"]
    )
    assert read_files(tmp_path, "auto", "").test_names == {"01.png"}
    assert "test_filenames name what is no frame: ., /" in capsys.readouterr().out


def test_views_of_two_lists_and_of_none_are_named(tmp_path, capsys):
    lists = {
        "train_filenames": ["00.png", "01.png", "02.png"],
        "val_filenames": ["03.png"],
        "test_filenames": ["01.png", "04.png"],
    }
    write_nerfstudio(tmp_path, surrounding_world(6), **lists)
    files = read_files(tmp_path, "auto", "")
    assert files.names == ("00.png", "01.png", "02.png", "04.png")
    assert files.test_names == {"01.png", "04.png"}
    said = capsys.readouterr().out
    assert "1 views are in two of its lists of filenames: held out" in said
    assert "its lists of filenames name: 03.png, 05.png left out" in said


def test_a_key_of_two_values_is_refused(tmp_path):
    write_nerfstudio(tmp_path, surrounding_world(6))
    path = tmp_path / "transforms.json"
    whole = path.read_text()
    path.write_text('{"fl_x": 20.0,' + whole[1:])
    read_files(tmp_path, "auto", "")
    path.write_text('{"fl_x": 99.0,' + whole[1:])
    with pytest.raises(UserError, match="'fl_x' is there twice, with two values"):
        read_files(tmp_path, "auto", "")


def test_lines_of_a_model_without_those_of_observations_are_refused(tmp_path):
    """An image takes two lines; two blanks in its name make its first like a second."""
    write_colmap(tmp_path, surrounding_world(6), binary=False)
    path = tmp_path / "sparse/0/images.txt"
    lines = [line for line in path.read_text().split("\n") if line.strip()]
    for blanks in ("", "a b "):
        named = [re.sub(r"(\d+\.png)", rf"{blanks}\1", line) for line in lines]
        path.write_text("\n".join(named))
        with pytest.raises(UserError, match="no line of x, y and point"):
            read_files(tmp_path, "auto", "")


def test_of_a_binary_model_and_a_text_it_is_said_which_is_read(tmp_path, capsys):
    write_colmap(tmp_path, surrounding_world(6))
    write_model(tmp_path / "sparse/0", surrounding_world(4), binary=False)
    assert len(read_files(tmp_path, "auto", "").names) == 6
    assert "a model in .bin and one in .txt: .bin is read" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("size", "is_whole"),
    [
        *(((400, 300), True), ((399, 299), True), ((50, 38), True), ((25, 19), True)),
        *(((400, 296), False), ((396, 300), False), ((197, 150), False)),
        *(((800, 600), True), ((800, 594), False)),
    ],
)
def test_cropped_photos_are_refused_and_rounded_sizes_are_not(size, is_whole, tmp_path):
    lens = Lens("PINHOLE", 400, 300, (300.0, 300.0, 200.0, 150.0))
    world = dataclasses.replace(surrounding_world(4), lens=lens)
    write_colmap(tmp_path, world)
    for name in world.names:
        image_io.write(tmp_path / "images" / name, flat_picture(9, *size))
    files = read_files(tmp_path, "auto", "")
    if is_whole:
        fitted = fit_lenses(files, 1)[0]
        assert (fitted.width, fitted.height) == size
    else:
        with pytest.raises(UserError, match="another shape"):
            fit_lenses(files, 1)


@pytest.mark.parametrize(
    ("params", "words"),
    [
        ((0.83, 0.83, 12.0, 9.0), "expected pixels"),
        ((20.0, 20.0, 50.0, 30.0), "inside the picture"),
        ((20.0, 20.0, 12.0, -9.0), "inside the picture"),
    ],
)
def test_lenses_in_no_pixels_are_refused_of_every_format(params, words, tmp_path):
    world = dataclasses.replace(
        surrounding_world(4), lens=Lens("PINHOLE", 24, 18, params)
    )
    write_colmap(tmp_path, world)
    with pytest.raises(UserError, match=words):
        check_lenses(read_files(tmp_path, "auto", ""))


@pytest.mark.parametrize(
    ("principal", "is_said"),
    [((6.0, 4.5), True), ((20.0, 15.0), True), ((12.5, 9.0), False), ((6, 9), False)],
)
def test_the_pixels_of_another_size_are_warned_of(principal, is_said, tmp_path, capsys):
    cx, cy = principal
    write_nerfstudio(tmp_path, surrounding_world(6))
    edit_json(tmp_path / "transforms.json", lambda c: c.update(cx=cx, cy=cy))
    check_lenses(read_files(tmp_path, "auto", ""))
    assert ("expected pixels of the stated size" in capsys.readouterr().out) == is_said


@pytest.mark.parametrize("write", [write_nerfstudio, write_llff])
def test_a_picture_of_impossible_size_is_refused_at_once(write, tmp_path):
    lens = Lens("PINHOLE", 10**8, 10**8, (1e8, 1e8, 5e7, 5e7))
    write(tmp_path, dataclasses.replace(surrounding_world(4), lens=lens))
    with pytest.raises(UserError, match="expected at most 131072 pixels a side"):
        check_lenses(read_files(tmp_path, "auto", ""))


@pytest.mark.parametrize(
    ("distance", "is_named"), [(300.0, False), (1e4, True), (1e30, True)]
)
def test_a_camera_far_from_all_others_is_named(distance, is_named, tmp_path, capsys):
    world = surrounding_world(6)
    moved = world.camtoworlds.copy()
    moved[2, :, 3] = distance
    far = dataclasses.replace(world, camtoworlds=moved)
    write_nerfstudio(tmp_path, far, near=1.0, far=9.0)
    load_scene(SceneConfig(str(tmp_path)), "train")
    assert ("02.png: more than 100 times" in capsys.readouterr().out) == is_named


@pytest.mark.parametrize(("level", "is_said"), [(2.0, True), (4.0, True), (9.0, False)])
def test_truth_that_is_no_brighter_than_its_photos_is_warned_of(
    level, is_said, tmp_path, capsys
):
    world = surrounding_world(6)
    write_colmap(tmp_path, world)
    write_pictures(tmp_path / "gt", world.names, level)
    load_scene(SceneConfig(str(tmp_path)), "test")
    assert ("truth is no brighter than" in capsys.readouterr().out) == is_said


@pytest.mark.parametrize("inside", ["images", "sparse/0"])
def test_a_folder_inside_a_scene_says_where_the_scene_is(inside, tmp_path):
    write_colmap(tmp_path, surrounding_world(6))
    with pytest.raises(UserError, match=f"; the scene is {tmp_path}$"):
        read_files(tmp_path / inside, "auto", "")
    with pytest.raises(UserError, match=r"images\.bin: a file; expected the folder"):
        read_files(tmp_path / "sparse/0/images.bin", "auto", "")


def test_a_folder_of_scenes_says_which_there_are(tmp_path):
    for name in ("a", "b"):
        write_nerfstudio(tmp_path / name, surrounding_world(6))
    with pytest.raises(UserError, match=rf"; scenes are {tmp_path}/a, {tmp_path}/b$"):
        read_files(tmp_path, "auto", "")


def test_gains_nested_beyond_reading_are_refused(tmp_path):
    write_colmap(tmp_path, surrounding_world(6))
    (tmp_path / "exposures.json").write_text("[" * 100_000)
    with pytest.raises(UserError, match="no gain for every photo"):
        load_scene(SceneConfig(str(tmp_path)), "train")


@pytest.mark.parametrize("is_sorted", [True, False])
def test_rows_in_another_order_than_a_model_beside_are_named(
    is_sorted, tmp_path, capsys
):
    world = surrounding_world(12)
    names = [f"{number}.png" for number in range(1, 13)]
    write_pictures(tmp_path / "images", names)
    write_model(tmp_path / "sparse/0", world, binary=False)
    path = tmp_path / "sparse/0/images.txt"
    path.write_text(re.sub(r"0?(\d+)\.png", renumbered, path.read_text()))
    order = sorted(range(12), key=names.__getitem__) if is_sorted else range(12)
    moved = world.moved(2.0, random_rotation(), np.ones(3))
    rows = llff_rows(moved, (1.0, 20.0))[list(order)]
    np.save(tmp_path / "poses_bounds.npy", rows)
    read_files(tmp_path, "auto", "")
    said = capsys.readouterr().out
    assert ("place them elsewhere than" in said) == (not is_sorted)


def renumbered(name: re.Match[str]) -> str:
    return f"{int(name[1]) + 1}.png"


@pytest.mark.parametrize("turned", [False, True])
def test_points_that_few_cameras_see_are_warned_of(turned, tmp_path, capsys):
    world = surrounding_world(6)
    write_nerfstudio(tmp_path, world, ply_file_path="cloud.ply")
    points = world.points * (1.0, -1.0, -1.0) if turned else world.points
    ply.write(tmp_path / "cloud.ply", dict(zip("xyz", points.T, strict=True)))
    load_scene(SceneConfig(str(tmp_path)), "train")
    assert ("3 of 5 cameras see fewer than 8 of" in capsys.readouterr().out) == turned


def test_frames_without_their_ending_list_a_folder_once(tmp_path, monkeypatch):
    write_blender(tmp_path, surrounding_world(6), test=(0, 1))
    for split in ("train", "test"):
        path = tmp_path / f"transforms_{split}.json"
        path.write_text(path.read_text().replace(".png", ""))
    listed = []
    by_stem = transforms_pictures._by_stem
    monkeypatch.setattr(
        transforms_pictures,
        "_by_stem",
        lambda folder: listed.append(folder) or by_stem(folder),
    )
    assert len(read_files(tmp_path, "auto", "").names) == 6
    assert listed == [tmp_path / "low"]


@pytest.mark.parametrize("is_copied", [True, False])
def test_copies_of_training_photos_among_test_views_are_named(
    is_copied, tmp_path, capsys
):
    world = surrounding_world(6)
    write_nerfstudio(tmp_path, world, test_filenames=["00.png"], near=1.0, far=9.0)
    (tmp_path / "images/00.png").rename(tmp_path / "images/copy.png")

    def change(content):
        content["test_filenames"] = ["images/copy.png"]
        content["frames"][-1]["file_path"] = "images/copy.png"
        if is_copied:
            content["frames"][-1]["transform_matrix"] = content["frames"][0][
                "transform_matrix"
            ]

    edit_json(tmp_path / "transforms.json", change)
    load_scene(SceneConfig(str(tmp_path)), "train")
    said = "1 of 1 test views have the very pose of a training view: copy.png"
    assert (said in capsys.readouterr().out) == is_copied


@pytest.mark.parametrize(
    ("shared", "own", "words"),
    [
        ({}, {"w": 12, "h": 9}, "w of .*00.png is 12, but its fl_x is the file's"),
        ({}, {"w": 12, "h": 9, "fl_x": 10.0, "fl_y": 10.0, "cx": 6.0, "cy": 4.0}, ""),
        ({}, {"w": 24, "h": 18}, ""),
        ({"w": None, "h": None}, {}, "one fl_x for pictures of several sizes"),
        ({"w": None, "h": None}, {"fl_x": 10.0, "fl_y": 10.0, "cx": 6.0, "cy": 4}, ""),
        ({"w": None, "h": None, "fl_x": None, "fl_y": None}, {"x_fov": 50.0}, ""),
    ],
)
def test_a_focal_length_in_pixels_is_of_one_size(shared, own, words, tmp_path):
    world = surrounding_world(6)
    write_nerfstudio(tmp_path, world)

    def change(content):
        content.update({"cx": None, "cy": None, "x_fov": 60.0} if shared else {})
        content.update(shared)
        for key in [key for key, value in content.items() if value is None]:
            del content[key]
        if "fl_x" in content:
            content.pop("x_fov", None)
        content["frames"][-1].update(own)

    edit_json(tmp_path / "transforms.json", change)
    image_io.write(tmp_path / "images/00.png", flat_picture(9, 12, 9))
    if words:
        with pytest.raises(UserError, match=words):
            read_files(tmp_path, "auto", "")
    else:
        fit_lenses(read_files(tmp_path, "auto", ""), 1)


@pytest.mark.parametrize("has_own", [True, False])
def test_a_copied_scene_that_lists_the_first_ones_photos_says_so(
    has_own, tmp_path, capsys
):
    world = surrounding_world(6)
    write_nerfstudio(tmp_path / "first", world)
    write_nerfstudio(tmp_path / "copy", world)
    json_path = tmp_path / "copy/transforms.json"
    folder = f'"{tmp_path / "first/images"}/'
    json_path.write_text(json_path.read_text().replace('"images/', folder))
    if not has_own:
        shutil.rmtree(tmp_path / "copy/images")
    paths = read_files(tmp_path / "copy", "auto", "").image_paths
    assert paths[0] == tmp_path / "first/images/00.png"
    said = capsys.readouterr().out
    assert ("6 of 6 pictures are taken from elsewhere" in said) == has_own


def test_black_photos_and_copies_are_named(tmp_path, capsys):
    world = surrounding_world(8)
    write_colmap(tmp_path, world)
    load_scene(SceneConfig(str(tmp_path)), "train")
    assert "WARNING" not in capsys.readouterr().out
    for name in ("02.png", "05.png"):
        image_io.write(tmp_path / "images" / name, flat_picture(0.0))
    shutil.copy(tmp_path / "images/03.png", tmp_path / "images/06.png")
    load_scene(SceneConfig(str(tmp_path)), "train")
    said = capsys.readouterr().out
    assert "all black: 02.png, 05.png: remove these views" in said
    assert "under poses of their own: 06.png of 03.png: give each" in said


def test_where_no_test_view_is_left_it_is_said_that_others_are_held_out(
    tmp_path, capsys
):
    write_blender(tmp_path, surrounding_world(6), test=(0, 1))
    for name, is_all in (("00.png", False), ("01.png", True)):
        (tmp_path / "low" / name).unlink()
        files = read_files(tmp_path, "auto", "")
        assert (files.test_names is None) == is_all
        said = capsys.readouterr().out
        assert ("none is left, so others are held out" in said) == is_all
