# SPDX-License-Identifier: Apache-2.0
"""Exposures of photos that a COLMAP model has points of, without a file that states
them."""

import numpy as np
import pytest

from internal.color import srgb_to_linear
from internal.files import image_io
from internal.scene import exposures
from internal.scene.colmap import project
from internal.scene.config import SceneConfig
from internal.scene.exposures import Sighted, find_sighted, measure_gains
from internal.scene.gains import KEPT_FILE
from internal.scene.scene import Scene, load_scene
from tests.scene_writers import (
    World,
    facing_world,
    flat_picture,
    write_colmap,
    write_model,
    write_nerfstudio,
)

WORLD = facing_world(5)
LEVELS = np.array([10.0, 20.0, 14.0, 9.0, 30.0])  # of 255, of a scene of one grey


def load(folder, kept_in=(), **settings) -> Scene:
    config = SceneConfig(str(folder), holdout=0, **settings)
    return load_scene(config, "train", folders=kept_in)


def write_flat(folder) -> None:
    for name, level in zip(WORLD.names, LEVELS, strict=True):
        image_io.write(folder / name, flat_picture(level))


def expected_gains() -> np.ndarray:
    light = np.asarray(srgb_to_linear(LEVELS / 255.0))
    return light / np.exp(np.log(light).mean())


@pytest.mark.parametrize("binary", [True, False])
def test_photos_of_one_scene_are_brought_to_one_exposure(tmp_path, binary, capsys):
    write_colmap(tmp_path, WORLD, binary=binary, tracked=True)
    write_flat(tmp_path / "images")
    scene = load(tmp_path)
    assert scene.view_names == tuple(WORLD.names)
    np.testing.assert_allclose(scene.gains.T, [expected_gains()] * 3, rtol=2e-3)
    assert "exposures: differ, -0.89 to +1.36" in capsys.readouterr().out
    np.testing.assert_array_equal(load(tmp_path, photo_gains=False).gains, 1.0)


def test_points_are_where_the_model_saw_them(tmp_path):
    write_colmap(tmp_path, WORLD, tracked=True)
    pose = WORLD.camtoworlds[3]
    pixels = project(WORLD.lens, (WORLD.points - pose[:, 3]) @ pose[:, :3])
    size = (WORLD.lens.width, WORLD.lens.height)
    inside = ((pixels >= 0.0) & (pixels < size)).all(axis=-1)
    (seen,) = find_sighted(tmp_path, [WORLD.names[3]]).values()
    np.testing.assert_allclose(seen.places * size, pixels[inside], atol=1e-6)


def test_a_model_beside_other_poses_tells_exposures_too(tmp_path):
    write_nerfstudio(tmp_path, WORLD)
    write_model(tmp_path / "sparse" / "0", WORLD, tracked=True)
    write_flat(tmp_path / "images")
    np.testing.assert_allclose(load(tmp_path).gains[:, 0], expected_gains(), rtol=2e-3)


def test_a_broken_model_beside_poses_with_points_of_their_own_is_warned_of(
    tmp_path, capsys
):
    rows = "\n".join(" ".join(map(str, point)) for point in WORLD.points)
    head = "ply\nformat ascii 1.0\nelement vertex 400\n"
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    (tmp_path / "points.ply").write_text(f"{head}{axes}end_header\n{rows}\n")
    write_nerfstudio(tmp_path, WORLD, ply_file_path="points.ply")
    model = write_model(tmp_path / "sparse" / "0", WORLD, tracked=True) / "0"
    (model / "images.bin").write_bytes(b"\1" * 20)
    np.testing.assert_array_equal(load(tmp_path).gains, 1.0)
    assert "taken as equally exposed" in capsys.readouterr().out


@pytest.mark.parametrize("change", ["nothing", "photo", "sightings", "torn"])
def test_exposures_are_measured_once_of_these_photos_and_sightings(
    tmp_path, monkeypatch, change
):
    write_colmap(tmp_path, WORLD, tracked=True)
    write_flat(tmp_path / "images")
    before = load(tmp_path, [tmp_path / "images" / WORLD.names[0], tmp_path]).gains
    counted = []
    monkeypatch.setattr(
        exposures,
        "measure_gains",
        lambda *given: counted.append(1) or measure_gains(*given),
    )
    kept = tmp_path / KEPT_FILE
    if change == "photo":
        image_io.write(tmp_path / "images" / WORLD.names[0], flat_picture(99.0))
    elif change == "sightings":
        moved = World(WORLD.camtoworlds, WORLD.points * 1.0001)
        write_model(tmp_path / "sparse/0", moved, tracked=True)
    elif change == "torn":
        kept.write_bytes(kept.read_bytes()[:100])
    gains = [before, *(load(tmp_path, [tmp_path]).gains for _ in range(2))]
    assert len(counted) == (change != "nothing")
    assert np.array_equal(gains[0], gains[1]) == (change != "photo")
    np.testing.assert_array_equal(gains[1], gains[2])


def test_equal_photos_keep_every_bit_of_their_light(tmp_path, capsys):
    write_colmap(tmp_path, WORLD, tracked=True)
    for name in WORLD.names:
        image_io.write(tmp_path / "images" / name, flat_picture(12.0))
    np.testing.assert_array_equal(load(tmp_path).gains, 1.0)
    assert "exposures: equal (measured" in capsys.readouterr().out


def test_tracks_that_are_none_change_nothing():
    """Light that differs at each sighting of a point is no exposure."""
    rng = np.random.default_rng(0)
    pictures = [
        np.kron(rng.uniform(0.05, 0.9, (6, 8, 1)), np.ones((10, 10, 3))) * share
        for share in (0.3, 1.0, 0.5)
    ]
    sighted = {
        view: Sighted(np.arange(200), rng.uniform(0.0, 1.0, (200, 2)))
        for view in range(3)
    }
    found = measure_gains(sighted, lambda view: pictures[view], 3)
    assert np.abs(found.measured_stops).max() > 0.5
    np.testing.assert_array_equal(found.gains, 1.0)
