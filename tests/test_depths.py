# SPDX-License-Identifier: Apache-2.0
"""A scene whose files say nothing of its depth gets it from its photos."""

import dataclasses

import numpy as np
import pytest

from internal.cameras import Lens
from internal.cli import load_split
from internal.configs import load_config
from internal.errors import UserError
from internal.files import ply
from internal.prepare import attempts, depths
from internal.scene import colmap, readers
from tests.scene_writers import (
    World,
    edit_json,
    facing_world,
    frame_entries,
    intrinsics,
    surrounding_world,
    write_json,
    write_nerfstudio,
)
from tests.textured_room import FOCAL, HEIGHT, WIDTH, room_cameras, write_room

VIEWS = 7
ROOM_LENS = Lens("PINHOLE", WIDTH, HEIGHT, (FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2))
WORLD = surrounding_world()


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Dark photos of a room and a transforms.json with poses alone."""
    folder = tmp_path_factory.mktemp("room")
    write_room(folder / "images", VIEWS)
    world = World(room_cameras(VIEWS), np.empty((0, 3)), ROOM_LENS)
    content = {**intrinsics(ROOM_LENS), "frames": frame_entries(world, "images")}
    write_json(folder / "transforms.json", content)
    return folder


def read(folder):
    return readers.read_files(folder, "auto", "")


def load(folder, *bindings):
    named = f"Config.data_dir = {str(folder)!r}"
    return load_split(load_config([], [named, *bindings]), "train")


def test_points_lie_on_the_walls_and_are_found_once(room, tmp_path, capsys):
    files = read(room)
    views = range(1, VIEWS)
    points = depths.find_points(files, views, [room / "transforms.json", tmp_path])
    assert len(points) > 12 * len(views)
    off_wall = np.abs(points).min(axis=-1)  # the walls are x = 0, y = 0 and z = 0
    assert np.median(off_wall) < 0.01 and np.percentile(off_wall, 90) < 0.1
    assert f"kept in {tmp_path}" in capsys.readouterr().out  # a file is no folder
    again = depths.find_points(files, views, [room / "none", tmp_path])
    np.testing.assert_array_equal(again, points)
    assert f"kept in {tmp_path / depths.POINTS_FILE}\n" in capsys.readouterr().out


@pytest.mark.parametrize("change", ["pose", "photo", "views", "torn"])
def test_points_are_kept_for_these_photos_and_poses_alone(
    tmp_path, monkeypatch, change
):
    found = []
    monkeypatch.setattr(
        depths, "_triangulated", lambda *_: found.append(1) or WORLD.points
    )
    files, views = read(write_nerfstudio(tmp_path, WORLD)), [0, 1, 2]
    for _ in range(2):
        depths.find_points(files, views, [tmp_path])
    assert len(found) == 1
    if change == "pose":
        files = dataclasses.replace(files, camtoworlds=files.camtoworlds + 1e-3)
    elif change == "photo":
        files.image_paths[1].write_bytes(files.image_paths[3].read_bytes())
    elif change == "views":
        views = [0, 1, 3]
    else:
        kept = tmp_path / depths.POINTS_FILE
        kept.write_bytes(kept.read_bytes()[:100])
    depths.find_points(files, views, [tmp_path])
    assert len(found) == 2


def test_the_scene_is_as_deep_as_its_points(room, capsys):
    scene = load(room)
    assert "points found in the photos" in capsys.readouterr().out
    assert 2.0 < scene.near < 4.5 < scene.far < 8.0  # 4 units from the corner
    (room / depths.POINTS_FILE).unlink()


def test_photos_that_show_nothing_leave_it_to_the_cameras(tmp_path, capsys):
    load(write_nerfstudio(tmp_path, WORLD))
    printed = capsys.readouterr().out
    assert "too few to say how deep" in printed
    assert printed.count(" points\n") >= len(depths.WAYS)
    assert "guessed from the cameras" in printed


@pytest.mark.parametrize(
    ("custom", "change"),
    [
        (lambda pose: colmap.other_axes(pose), "their second and third column negated"),
        (lambda pose: invert(pose), "the matrices inverted; "),
        (
            lambda pose: invert(colmap.other_axes(pose)),
            "the matrices inverted and those columns negated",
        ),
    ],
    ids=["OpenCV", "world to camera", "OpenCV, world to camera"],
)
def test_poses_of_another_custom_are_refused(room, custom, change):
    files = read(room)
    told = np.array([custom(pose) for pose in files.camtoworlds])
    files = dataclasses.replace(files, camtoworlds=told)
    with pytest.raises(UserError, match=f"transforms.json: .* with {change}"):
        depths.find_points(files, range(VIEWS), [])


def invert(pose):
    return np.linalg.inv(np.vstack([pose, [0, 0, 0, 1]]))[:3]


@pytest.mark.parametrize("given", ["both", "near in the file", "cloud"])
def test_photos_are_not_asked_where_something_else_knows(
    tmp_path, monkeypatch, capsys, given
):
    monkeypatch.setattr(attempts, "make_copies", None)
    world = facing_world()
    write_nerfstudio(tmp_path, world)
    bindings = ["Config.near = 1.0", "Config.far = 9.0"] if given == "both" else []
    stated = {"near": 1.0, "far": 9.0} if given == "near in the file" else {}
    if given == "cloud":
        ply.write(tmp_path / "cloud.ply", dict(zip("xyz", world.points.T, strict=True)))
        stated = {"ply_file_path": "cloud.ply"}
    edit_json(tmp_path / "transforms.json", lambda c: c.update(stated))
    scene = load(tmp_path, *bindings)
    if given == "cloud":
        assert "from 400 points of cloud.ply" in capsys.readouterr().out
        assert 2.5 < scene.near < 3.1 and 5.8 < scene.far < 6.8
    else:
        assert (scene.near, scene.far) == (1.0, 9.0)
