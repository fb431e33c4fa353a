# SPDX-License-Identifier: Apache-2.0
"""The cameras of a video, for every kind of path."""

import dataclasses

import numpy as np
import pytest

from internal.configs import RenderConfig
from internal.coord import Unbounded
from internal.errors import UserError
from internal.rendering import paths
from internal.rendering.trajectory import path_cameras
from internal.scene.config import SceneConfig
from internal.scene.scene import load_scene
from tests.scene_writers import facing_world, write_colmap

RENDER = RenderConfig(frames=5)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    write_colmap(folder, facing_world())
    return load_scene(SceneConfig(str(folder)), "train")


@pytest.mark.parametrize("path", ["auto", "spiral", "ellipse", "around", "views"])
def test_a_path_has_its_frames_and_the_lens_of_the_scene(scene, path):
    cameras = path_cameras(scene, dataclasses.replace(RENDER, path=path))
    assert len(cameras) == 5
    assert cameras.camtoworlds.dtype == np.float32
    assert set(cameras.widths) == {scene.lenses[0].width}
    np.testing.assert_array_equal(cameras.directions, scene.cameras.directions)


def test_a_file_holds_poses_in_the_frame_of_the_pose_file(scene, tmp_path):
    world_from_model = scene.model_from_world.inverse()
    model_poses = np.asarray(scene.cameras.camtoworlds, np.float64)
    file = tmp_path / "path.json"
    paths.write_poses(file, world_from_model.poses(model_poses), fps=24)
    cameras = path_cameras(scene, dataclasses.replace(RENDER, path=str(file)))
    np.testing.assert_allclose(cameras.camtoworlds, model_poses, atol=1e-5)


def test_an_unknown_path_is_named(scene):
    with pytest.raises(UserError, match="zigzag"):
        path_cameras(scene, dataclasses.replace(RENDER, path="zigzag"))


def test_auto_is_a_spiral_only_for_views_that_face_one_way(scene):
    def positions(path, space=scene.space):
        render = dataclasses.replace(RENDER, path=path)
        return path_cameras(dataclasses.replace(scene, space=space), render).camtoworlds

    np.testing.assert_array_equal(positions("auto"), positions("spiral"))
    around = Unbounded(np.float32(0.5), np.float32(9.0))
    np.testing.assert_array_equal(positions("auto", around), positions("around"))
