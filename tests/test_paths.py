# SPDX-License-Identifier: Apache-2.0
"""Laws of camera trajectories."""

import itertools
import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from internal.errors import UserError
from internal.poses import focus_point
from internal.rendering import paths

NEAR, FAR = 2.0, 20.0
SUBJECT = np.array([4.0, 5.0, 6.0])
SOMEWHERE = np.array([5.0, -3.0, 1.0])


def _forward_facing(seed: int = 0) -> np.ndarray:
    """A 5 x 4 wall of cameras that look down -z, jittered, turned and moved, in an
    order that has nothing to do with where they are."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(-2.0, 2.0, 5), np.linspace(-1.0, 1.0, 4))
    grid = np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=-1)
    positions = grid + rng.normal(0.0, 0.05, grid.shape)
    rotations = Rotation.from_rotvec(rng.normal(0.0, 0.03, grid.shape))
    frame = Rotation.from_rotvec([0.4, 2.0, -0.7])
    camtoworlds = _poses(frame * rotations, frame.apply(positions) + SOMEWHERE)
    return rng.permutation(camtoworlds)


def _ring(n: int = 24) -> np.ndarray:
    """Cameras 3 units around and 1 above ``SUBJECT``, looking at it; z is up."""
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    back = np.stack([3.0 * np.cos(angle), 3.0 * np.sin(angle), 1.0 + 0.0 * angle], -1)
    positions = back + SUBJECT
    back /= np.linalg.norm(back, axis=-1, keepdims=True)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    return np.stack([right, np.cross(back, right), back, positions], axis=-1)


def _arc(turned: int = 3, way: int = 1) -> np.ndarray:
    """Half of the ring, in no order; of so many cameras one lies on its side: on the
    left or, with ``way`` -1, on the right."""
    arc = np.random.default_rng(0).permutation(_ring(48)[:24])
    sides = arc[::turned]
    right, up = way * sides[:, :, 0], way * sides[:, :, 1]
    arc[::turned] = np.stack([-up, right, sides[:, :, 2], sides[:, :, 3]], axis=-1)
    return arc


def _poses(rotations: Rotation, positions: np.ndarray) -> np.ndarray:
    return np.concatenate([rotations.as_matrix(), positions[..., None]], axis=-1)


def _steps(camtoworlds: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(camtoworlds[:, :, 3], axis=0), axis=-1)


PATHS = {
    "spiral": lambda n: paths.spiral(_forward_facing(), NEAR, FAR, n),
    "ellipse": lambda n: paths.ellipse(_ring(), n),
    "around": lambda n: paths.around(_arc(), n),
    "tour": lambda n: paths.tour(_arc(), n),
    "along_views": lambda n: paths.along_views(_forward_facing(), n),
    "along_ring": lambda n: paths.along_views(_ring(), n),
}


@pytest.mark.parametrize("name", PATHS)
def test_rotations_are_rotations(name):
    rotations = PATHS[name](50)[:, :, :3]
    products = rotations @ rotations.transpose(0, 2, 1)
    identity = np.broadcast_to(np.eye(3), products.shape)
    np.testing.assert_allclose(products, identity, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)


@pytest.mark.parametrize("name", PATHS)
@pytest.mark.parametrize("n", [1, 7, 60])
def test_number_of_poses(name, n):
    assert PATHS[name](n).shape == (n, 3, 4)


@pytest.mark.parametrize("name", ["spiral", "ellipse"])
def test_loops_close_without_a_jump_or_a_repeated_pose(name):
    path = PATHS[name](60)
    steps = _steps(np.concatenate([path, path[:1]]))
    assert steps.min() > 0.2 * np.median(steps)
    assert steps[-1] < 2.0 * np.median(steps)


@pytest.mark.parametrize("seed", range(4))
def test_spiral_stays_within_the_box_of_the_views(seed):
    views = _forward_facing(seed)
    axes = paths.spiral(views, NEAR, FAR, 1)[0, :, :3]
    inside = views[:, :, 3] @ axes
    path = paths.spiral(views, NEAR, FAR, 100)[:, :, 3] @ axes
    slack = 0.05 * np.ptp(inside, axis=0).max()
    assert (path >= inside.min(axis=0) - slack).all()
    assert (path <= inside.max(axis=0) + slack).all()
    # It uses the room that it has.
    assert (np.ptp(path, axis=0) > 0.5 * np.ptp(inside, axis=0))[:2].all()


def test_spiral_looks_at_one_point_between_near_and_far():
    views = _forward_facing()
    path = paths.spiral(views, NEAR, FAR, 40)
    focus = focus_point(path)
    back = path[:, :, 3] - focus
    depths = np.linalg.norm(back, axis=-1)
    np.testing.assert_allclose(back / depths[:, None], path[:, :, 2], atol=1e-6)
    assert (path[:, :, 2] @ views[:, :, 2].mean(axis=0) > 0.0).all()
    # The mean of 1 / 2 and 1 / 20 with weights 0.25 and 0.75 is 1 / 6.1538.
    distance = np.linalg.norm(focus - views[:, :, 3].mean(axis=0))
    assert distance == pytest.approx(6.1538, abs=1e-3)


def test_spiral_of_scale_zero_stays_at_the_mean_position():
    views = _forward_facing()
    path = paths.spiral(views, NEAR, FAR, 10, radius_scale=0.0)
    mean = views[:, :, 3].mean(axis=0)
    np.testing.assert_allclose(path[:, :, 3], np.broadcast_to(mean, (10, 3)))


def test_focus_point_of_a_ring_is_its_subject_and_of_a_row_is_finite():
    np.testing.assert_allclose(focus_point(_ring()), SUBJECT, atol=1e-9)
    frame = Rotation.from_rotvec([[0.4, 2.0, -0.7]] * 3)
    row = _poses(frame, np.diag([1.0, 2.0, 0.0]))
    mean = row[:, :, 3].mean(axis=0)
    np.testing.assert_allclose(focus_point(row), mean, atol=1e-9)


def test_ellipse_goes_around_the_subject_at_the_views_height_and_looks_at_it():
    path = paths.ellipse(_ring(), 40)
    offsets = path[:, :, 3] - SUBJECT
    np.testing.assert_allclose(offsets[:, 2], 1.0)
    np.testing.assert_allclose(np.linalg.norm(offsets[:, :2], axis=-1), 3.0, rtol=0.05)
    lengths = np.linalg.norm(offsets, axis=-1, keepdims=True)
    np.testing.assert_allclose(offsets / lengths, path[:, :, 2], atol=1e-9)
    np.testing.assert_allclose(path[:, 2, 0], 0.0, atol=1e-9)  # level horizon


def test_ellipse_has_even_speed():
    squeezed = _ring()
    squeezed[:, 0, 3] = 4.0 + 0.3 * (squeezed[:, 0, 3] - 4.0)
    steps = _steps(paths.ellipse(squeezed, 200))
    assert steps.max() < 1.05 * steps.min()


def test_along_views_passes_every_view():
    views = _forward_facing()
    path = paths.along_views(views, 4000)
    apart = np.abs(views[:, None] - path[None]).max(axis=(2, 3)).min(axis=1)
    assert apart.max() < 0.02


@pytest.mark.parametrize("seed", range(4))
def test_along_views_has_no_jumps(seed):
    # Neighbours on the wall are 1 or 2/3 apart: an order with jumps crosses it.
    views = _forward_facing(seed)
    order = views[paths._visiting_order(paths._distances(views))]
    assert _steps(order).max() < 1.5
    assert _steps(order).sum() < 1.25 * (len(views) - 1) * 2.0 / 3.0 + 2.0


@pytest.mark.parametrize("seed", range(4))
def test_walking_any_stretch_of_the_order_backwards_is_no_shorter(seed):
    rng = np.random.default_rng(seed)
    scattered = _poses(Rotation.random(12, rng=rng), rng.normal(size=(12, 3)))
    distances = paths._distances(scattered)
    order = paths._visiting_order(distances)

    def length(tour):
        return distances[tour[:-1], tour[1:]].sum()

    for start, end in itertools.combinations(range(12), 2):
        stretch = order[start : end + 1][::-1]
        other = np.concatenate([order[:start], stretch, order[end + 1 :]])
        assert length(other) >= length(order) - 1e-9


def test_along_views_walks_a_ring_in_turn():
    shuffled = np.random.default_rng(1).permutation(_ring(24))
    path = paths.along_views(shuffled, 300)
    assert _steps(path).max() < 1.5 * np.median(_steps(path))


def test_along_views_of_one_view_or_equal_views_stands_still():
    view = _ring()[:1]
    for views in (view, np.repeat(view, 3, axis=0)):
        np.testing.assert_array_equal(
            paths.along_views(views, 5), np.repeat(view, 5, axis=0)
        )


def test_along_views_ignores_a_view_that_is_there_twice():
    views = _ring(6)
    twice = np.concatenate([views, views[2:3]])
    assert np.isfinite(paths.along_views(twice, 50)).all()


def test_json_round_trip(tmp_path):
    path = tmp_path / "path.json"
    camtoworlds = _forward_facing()
    paths.write_poses(path, camtoworlds, 24)
    np.testing.assert_array_equal(paths.read_poses(path), camtoworlds)
    assert json.loads(path.read_text())["fps"] == 24
    assert [file.name for file in tmp_path.iterdir()] == ["path.json"]


def test_json_from_nerfstudio(tmp_path):
    path = tmp_path / "path.json"
    # Row by row: camera at (1, 2, 3), turned 90 degrees about y.
    matrix = [0, 0, 1, 1, 0, 1, 0, 2, -1, 0, 0, 3, 0, 0, 0, 1]
    entry = {"camera_to_world": matrix, "fov": 50.0, "aspect": 1.5}
    exported = {"camera_type": "perspective", "camera_path": [entry], "fps": 24}
    path.write_text(json.dumps(exported))
    expected = [[[0, 0, 1, 1], [0, 1, 0, 2], [-1, 0, 0, 3]]]
    np.testing.assert_array_equal(paths.read_poses(path), expected)


IDENTITY = np.eye(4).ravel().tolist()
MIRROR = np.diag([1.0, 1.0, -1.0, 1.0]).ravel().tolist()
SCALED = np.diag([2.0, 2.0, 2.0, 1.0]).ravel().tolist()


@pytest.mark.parametrize(
    "text",
    {
        "not JSON": "camera_path:",
        "empty file": "",
        "other keys": '{"frames": []}',
        "a list": "[]",
        "empty path": '{"camera_path": []}',
        "path of numbers": '{"camera_path": [1, 2]}',
        "path is an object": '{"camera_path": {"a": 1}}',
        "15 numbers": json.dumps({"camera_path": [{"camera_to_world": IDENTITY[1:]}]}),
        "words": json.dumps({"camera_path": [{"camera_to_world": ["a"] * 16}]}),
        "NaN": json.dumps({"camera_path": [{"camera_to_world": [np.nan] * 16}]}),
        "mirror": json.dumps({"camera_path": [{"camera_to_world": MIRROR}]}),
        "scale": json.dumps({"camera_path": [{"camera_to_world": SCALED}]}),
    }.values(),
)
def test_bad_json_names_the_file_and_what_was_expected(tmp_path, text):
    path = tmp_path / "bad.json"
    path.write_text(text)
    with pytest.raises(UserError, match=r"bad\.json: .*row-major 4x4") as caught:
        paths.read_poses(path)
    assert "\n" not in str(caught.value)


def test_missing_json_is_the_users_error(tmp_path):
    with pytest.raises(UserError, match=r"none\.json"):
        paths.read_poses(tmp_path / "none.json")


def test_views_that_go_all_the_way_around_are_followed_by_an_ellipse():
    np.testing.assert_array_equal(paths.around(_ring(), 30), paths.ellipse(_ring(), 30))


def test_views_that_go_halfway_around_are_never_left():
    """Where an ellipse would stand 6 units from the nearest view."""
    views = _arc()
    path = paths.around(views, 60)
    apart = np.linalg.norm(path[:, None, :, 3] - views[None, :, :, 3], axis=-1)
    assert apart.min(axis=1).max() < 0.4
    distance = np.linalg.norm(path[:, :, 3] - SUBJECT, axis=-1)
    np.testing.assert_allclose(distance, np.sqrt(10.0), rtol=0.02)


@pytest.mark.parametrize("turned", [1, 3])
@pytest.mark.parametrize("way", [1, -1])
def test_a_tour_looks_at_the_subject_and_stays_upright(turned, way):
    path = paths.tour(_arc(turned, way), 60)
    to_subject = SUBJECT - path[:, :, 3]
    to_subject /= np.linalg.norm(to_subject, axis=-1, keepdims=True)
    np.testing.assert_allclose(-path[:, :, 2], to_subject, atol=1e-2)
    assert path[:, 2, 1].min() > 0.9  # the world's up is z, of quarter-turned views too


def test_an_ellipse_of_views_from_one_side_is_level():
    """Their mean up leans, their rights do not."""
    path = paths.ellipse(_ring(48)[:24], 30)
    assert np.ptp(path[:, 2, 3]) < 1e-6
