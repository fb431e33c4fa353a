# SPDX-License-Identifier: Apache-2.0
"""Cameras, depths, points and splits that are not of one frame and unit are told."""

import dataclasses

import numpy as np
import pytest

from internal.errors import UserError
from internal.prepare.checking import misplaced
from internal.scene import colmap
from internal.scene.config import SceneConfig
from internal.scene.plausible import cloud_fault
from internal.scene.readers import read_files
from internal.scene.scene import load_scene
from tests.scene_writers import (
    edit_json,
    facing_world,
    frame_entries,
    random_rotation,
    surrounding_world,
    write_blender,
    write_colmap,
    write_nerfstudio,
)

WORLDS = [surrounding_world(8), facing_world(8)]
NOWHERE = np.zeros(3)


def said_of(folder, capsys) -> str:
    load_scene(SceneConfig(str(folder)), "train")
    return capsys.readouterr().out


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("unit", [1e-3, 0.5, 2.0, 1e3])
def test_depths_in_another_unit_than_the_poses_are_told(world, unit, tmp_path, capsys):
    """Half and double are no units, and may be meant."""
    moved = world.moved(unit, random_rotation(), np.ones(3))
    write_nerfstudio(tmp_path, moved, near=2.5, far=8.0)
    if unit == 1e3:
        with pytest.raises(UserError, match="no two see the same thing"):
            said_of(tmp_path, capsys)
    else:
        is_told = "expected depths in the units of the poses" in said_of(
            tmp_path, capsys
        )
        assert is_told == (unit == 1e-3)


def test_cameras_far_from_the_origin_of_a_map_are_not_at_one_place(tmp_path, capsys):
    moved = WORLDS[0].moved(1.0, np.eye(3), np.array([4e6, 5e5, 5e6]))
    write_nerfstudio(tmp_path, moved, near=1.0, far=9.0)
    assert "stand at one place" not in said_of(tmp_path, capsys)


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize(
    ("scale", "rotation", "shift"),
    [
        (1.0, np.eye(3), NOWHERE),
        (20.0, np.eye(3), NOWHERE),
        (1.0, np.eye(3), np.array([30.0, 0.0, 0.0])),
    ],
)
def test_test_cameras_in_another_frame_are_told(
    world, scale, rotation, shift, tmp_path, capsys
):
    held_out = (1, 4)
    write_blender(tmp_path, world, test=held_out)
    entries = frame_entries(world.moved(scale, rotation, shift), "high")
    frames = [entries[view] for view in held_out]
    depths = {"near": 1.0, "far": 9.0}
    edit_json(tmp_path / "transforms_train.json", lambda c: c.update(depths))
    edit_json(
        tmp_path / "transforms_test.json", lambda c: c.update(frames=frames, **depths)
    )
    is_told = "test cameras stand or look elsewhere" in said_of(tmp_path, capsys)
    assert is_told == (scale != 1.0 or shift.any())


@pytest.mark.parametrize("scale", [0.1, 2.0])
def test_what_test_cameras_look_at_tells_their_frame_too(scale, tmp_path, capsys):
    world = surrounding_world(8)
    write_blender(tmp_path, world, test=(0, 3, 6))
    entries = frame_entries(world.moved(scale, np.eye(3), NOWHERE), "high")
    edit_json(
        tmp_path / "transforms_test.json",
        lambda content: content.update(frames=[entries[view] for view in (0, 3, 6)]),
    )
    assert "test cameras stand or look elsewhere" in said_of(tmp_path, capsys)


@pytest.mark.parametrize(
    ("change", "is_told"),
    [
        (np.eye(3), False),
        (np.diag([1.0, -1.0, -1.0]), True),
        (random_rotation(), True),
        (0.5 * np.eye(3), True),
        (1000.0 * np.eye(3), True),
    ],
)
def test_a_cloud_that_is_not_where_the_photos_show_things_is_told(
    change, is_told, tmp_path
):
    """Walls about the origin, which cameras all around see whatever their turn."""
    rng = np.random.default_rng(0)
    walls = rng.uniform(-1.0, 1.0, (2000, 3))
    walls[np.arange(2000), np.arange(2000) % 3] = -1.0
    world = surrounding_world(8).moved(1.0, np.eye(3), -np.array([1.0, 2.0, 3.0]))
    write_colmap(tmp_path, dataclasses.replace(world, points=walls[:1000] @ change))
    files = read_files(tmp_path, "auto", "")
    found = walls[1000:] + rng.normal(0.0, 0.01, (1000, 3))
    assert bool(cloud_fault(files, found)) == is_told
    part = files.points[files.points[:, 0] < 0.0]
    if not is_told:
        assert not cloud_fault(dataclasses.replace(files, points=part), found)
        assert not cloud_fault(files, found[found[:, 0] < 0.0])


def test_a_photo_that_does_not_fit_its_pose_is_named():
    world = facing_world(8)
    local = [(world.points - c[:, 3]) @ c[:, :3] for c in world.camtoworlds]
    seen = np.stack([colmap.project(world.lens, points) for points in local], axis=1)
    inside = ((seen > 0) & (seen < [world.lens.width, world.lens.height])).all((1, 2))
    pixels = {(i, j): seen[inside][:, [i, j]] for i in range(8) for j in range(i)}
    lenses = [world.lens] * 8
    assert misplaced(world.camtoworlds, lenses, pixels, 0.1) == []
    moved = world.camtoworlds.copy()
    moved[3, :, 3] *= 10.0
    assert misplaced(moved, lenses, pixels, 0.1) == [3]
