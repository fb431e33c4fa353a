# SPDX-License-Identifier: Apache-2.0
"""Splats: the rasterizer against a naive one, the files against their formats."""

import dataclasses
import json
import struct

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from internal.errors import UserError
from internal.export import bake, rasterizer, splat_files
from internal.export.splats import (
    SH0,
    SH1,
    Pinhole,
    Splats,
    carry_over,
    project_splats,
    rotations,
)
from internal.poses import Similarity

CAMERA = Pinhole(
    np.asarray(
        [[1, 0, 0, 0.1], [0, 0, -1, -0.2], [0, 1, 0, 0.3]], np.float32
    ),  # looks along +y
    np.asarray([30.0, 28.0], np.float32),
    np.asarray([14.0, 9.5], np.float32),
    np.float32(0.2),
    27,
    19,
)


def some_splats(count=60, degree=1, seed=0):
    """Splats of all shapes before the camera, a few behind it and beside it."""
    rng = np.random.default_rng(seed)
    local = rng.uniform([-1.2, -1.0, -4.0], [1.2, 1.0, 0.5], (count, 3))
    rotation, origin = CAMERA.camtoworld[:, :3], CAMERA.camtoworld[:, 3]
    quaternions = rng.normal(size=(count, 4))
    quaternions /= np.linalg.norm(quaternions, axis=-1, keepdims=True)
    harmonics = rng.normal(scale=0.5, size=(count, (degree + 1) ** 2, 3))
    return Splats(
        np.asarray(local @ rotation.T + origin, np.float32),
        np.asarray(quaternions, np.float32),
        np.asarray(rng.uniform(-4.0, -1.5, (count, 3)), np.float32),
        np.asarray(rng.normal(size=count), np.float32),
        np.asarray(harmonics, np.float32),
    )


def naive_render(splats, camera):
    """Each pixel on its own, every splat on its own, double precision."""
    rotation, origin = np.float64(camera.camtoworld[:, :3]), camera.camtoworld[:, 3]
    fx, fy = camera.focal
    local = (splats.points - origin) @ rotation
    picture = np.zeros((camera.height, camera.width, 3))
    left = np.ones((camera.height, camera.width))
    for i in np.argsort(-local[:, 2]):
        x, y, depth = local[i, 0], local[i, 1], -local[i, 2]
        if depth <= camera.near:
            continue
        w, a, b, c = splats.quaternions[i]
        turn = 2.0 * np.array(
            [
                [0.5 - b * b - c * c, a * b - w * c, a * c + w * b],
                [a * b + w * c, 0.5 - a * a - c * c, b * c - w * a],
                [a * c - w * b, b * c + w * a, 0.5 - a * a - b * b],
            ]
        )
        axes = rotation.T @ turn @ np.diag(np.exp(splats.log_scales[i]))
        reach = [1.3 * 0.5 * camera.width / fx, 1.3 * 0.5 * camera.height / fy]
        u, v = np.clip([x / depth, -y / depth], np.negative(reach), reach)
        flatten = np.array([[fx, 0, fx * u], [0, -fy, fy * v]]) / depth @ axes
        inverse = np.linalg.inv(flatten @ flatten.T + 0.3 * np.eye(2))
        mean = camera.center + camera.focal * [x / depth, -y / depth]
        opacity = 1.0 / (1.0 + np.exp(-splats.opacity_logits[i]))
        dx, dy, dz = (splats.points[i] - origin) / np.linalg.norm(local[i])
        basis = np.array([SH0, -SH1 * dy, SH1 * dz, -SH1 * dx])
        k = splats.harmonics.shape[1]
        srgb = np.maximum(0.5 + basis[:k] @ splats.harmonics[i], 0.0)
        for row in range(camera.height):
            for column in range(camera.width):
                apart = np.array([column + 0.5, row + 0.5]) - mean
                squared = apart @ inverse @ apart
                alpha = min(opacity * np.exp(-0.5 * squared), 0.99)
                if squared <= 9.0 and alpha >= 1 / 255:
                    picture[row, column] += left[row, column] * alpha * srgb
                    left[row, column] *= 1.0 - alpha
    return picture, left


@pytest.mark.parametrize("degree", [0, 1])
def test_the_rasterizer_draws_what_a_naive_one_draws(degree):
    splats = some_splats(degree=degree)
    picture, left = rasterizer.rasterize(splats, CAMERA)
    expected, expected_left = naive_render(splats, CAMERA)
    assert 0.1 < expected_left.mean() < 0.9
    np.testing.assert_allclose(picture, expected, atol=2e-3)
    np.testing.assert_allclose(left, expected_left, atol=2e-3)


def dense_loss(splats, weights):
    """The same picture by autodiff: all pixels times all splats in one array."""
    footprints = project_splats(splats, CAMERA)
    order = jnp.argsort(jax.lax.stop_gradient(footprints.depths))
    rows, columns = np.mgrid[: CAMERA.height, : CAMERA.width] + 0.5
    dx = columns.ravel()[:, None] - footprints.means[order, 0]
    dy = rows.ravel()[:, None] - footprints.means[order, 1]
    a, b, c = footprints.conics[order].T
    squared = a * dx * dx + 2.0 * b * dx * dy + c * dy * dy
    alpha = footprints.opacities[order] * jnp.exp(-0.5 * squared)
    seen = footprints.extents[order, 0] > 0.0
    drawn = (squared <= 9.0) & (alpha >= 1 / 255) & seen
    alpha = jnp.where(drawn, jnp.minimum(alpha, 0.99), 0.0)
    through = jnp.cumprod(1.0 - alpha, axis=-1) / (1.0 - alpha)
    return jnp.sum(weights * ((alpha * through) @ footprints.srgb[order]))


def test_gradients_are_those_of_autodiff():
    splats = jax.tree.map(jnp.asarray, some_splats(40))
    rng = np.random.default_rng(1)
    weights = np.asarray(rng.normal(size=(CAMERA.height, CAMERA.width, 3)), np.float32)
    expected = jax.jit(jax.grad(dense_loss))(splats, weights.reshape(-1, 3))
    found = rasterizer.gradient(splats, CAMERA, lambda picture: weights)
    for name in ("points", "log_scales", "opacity_logits", "harmonics"):
        a, b = getattr(found, name), getattr(expected, name)
        scale = float(jnp.abs(b).max())
        np.testing.assert_allclose(a / scale, b / scale, atol=2e-3, err_msg=name)


def reflected(splats):
    """NumPy arrays of what a renderer needs of splats, in any order of fields."""
    return {name: np.asarray(value) for name, value in vars(splats).items()}


@pytest.mark.parametrize("degree", [0, 1])
def test_a_ply_of_splats_is_read_back_bit_for_bit(tmp_path, degree):
    splats = some_splats(degree=degree)
    splat_files.write_ply(tmp_path / "s.ply", splats)
    again = splat_files.read_ply(tmp_path / "s.ply")
    jax.tree.map(np.testing.assert_array_equal, reflected(again), reflected(splats))


def test_a_ply_has_the_properties_of_the_3dgs_files(tmp_path):
    """x y z nx ny nz f_dc_* f_rest_* opacity scale_* rot_*, all float, and f_rest
    channel by channel: the first three of nine are red."""
    splats = some_splats(5, degree=1)
    splat_files.write_ply(tmp_path / "s.ply", splats)
    header, _, body = (tmp_path / "s.ply").read_bytes().partition(b"end_header\n")
    lines = header.decode().splitlines()
    assert lines[:3] == ["ply", "format binary_little_endian 1.0", "element vertex 5"]
    names = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 "
    names += " ".join(f"f_rest_{i}" for i in range(9))
    names += " opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3"
    assert lines[3:] == [f"property float {name}" for name in names.split()]
    rows = np.frombuffer(body, "<f4").reshape(5, -1)
    np.testing.assert_array_equal(rows[:, 9:12], splats.harmonics[:, 1:, 0])
    np.testing.assert_array_equal(rows[:, -4:], splats.quaternions)


@pytest.mark.parametrize(
    "damage", [lambda b: b[:-1], lambda b: b"PK" + b, lambda b: b""]
)
def test_a_damaged_ply_is_named(tmp_path, damage):
    path = tmp_path / "s.ply"
    splat_files.write_ply(path, some_splats())
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(UserError, match=r"s\.ply"):
        splat_files.read_ply(path)


def read_glb(path):
    """The document of a GLB and its primitive's attributes, by the glTF 2.0 rules."""
    content = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", content)
    assert (magic, version, length) == (b"glTF", 2, len(content))
    size, kind = struct.unpack_from("<I4s", content, 12)
    assert kind == b"JSON" and size % 4 == 0
    document = json.loads(content[20 : 20 + size])
    binary_size, kind = struct.unpack_from("<I4s", content, 20 + size)
    assert kind == b"BIN\0" and 28 + size + binary_size == length
    binary = content[28 + size :]
    assert document["buffers"] == [{"byteLength": binary_size}]
    arrays = {}
    (primitive,) = document["meshes"][0]["primitives"]
    for name, index in primitive["attributes"].items():
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        assert accessor["componentType"] == 5126 and view["byteOffset"] % 4 == 0
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        assert view["byteLength"] == 4 * width * accessor["count"]
        data = np.frombuffer(
            binary, "<f4", width * accessor["count"], view["byteOffset"]
        )
        arrays[name] = data.reshape(-1, width)
    return document, primitive, arrays


@pytest.mark.parametrize("degree", [0, 1])
def test_a_glb_of_splats_follows_khr_gaussian_splatting(tmp_path, degree):
    """The ratified extension: scales and opacities linear, quaternions x y z w, all of
    a degree's harmonics or none, kernel and colour space stated, mode POINTS."""
    splats = some_splats(degree=degree)
    splat_files.write_glb(tmp_path / "s.glb", splats)
    document, primitive, arrays = read_glb(tmp_path / "s.glb")
    assert document["extensionsUsed"] == ["KHR_gaussian_splatting"]
    assert "extensionsRequired" not in document  # others show points
    assert primitive["mode"] == 0
    assert primitive["extensions"]["KHR_gaussian_splatting"] == {
        "kernel": "ellipse",
        "colorSpace": "srgb_rec709_display",
        "projection": "perspective",
        "sortingMethod": "cameraDistance",
    }
    own = "KHR_gaussian_splatting:"
    np.testing.assert_array_equal(arrays["POSITION"], splats.points)
    position = document["accessors"][primitive["attributes"]["POSITION"]]
    np.testing.assert_array_equal(position["min"], splats.points.min(axis=0))
    np.testing.assert_array_equal(position["max"], splats.points.max(axis=0))
    np.testing.assert_allclose(arrays[own + "SCALE"], np.exp(splats.log_scales), 1e-6)
    opacities = 1.0 / (1.0 + np.exp(-splats.opacity_logits[:, None]))
    np.testing.assert_allclose(arrays[own + "OPACITY"], opacities, 1e-6)
    turned = arrays[own + "ROTATION"][:, [3, 0, 1, 2]]
    np.testing.assert_allclose(turned, splats.quaternions, atol=1e-6)
    harmonics = [own + "SH_DEGREE_0_COEF_0"]
    harmonics += [f"{own}SH_DEGREE_1_COEF_{i}" for i in range(3 * degree)]
    assert {name for name in arrays if "SH_" in name} == set(harmonics)
    for place, name in enumerate(harmonics):
        np.testing.assert_allclose(arrays[name], splats.harmonics[:, place], 1e-6)


def test_splats_in_another_frame_look_the_same_from_the_same_place():
    splats = some_splats()
    rotation = Rotation.from_rotvec([0.5, -0.8, 0.3]).as_matrix()
    similarity = Similarity(2.5, rotation, np.array([1.0, -2.0, 0.5]))
    (moved,) = similarity.poses(np.asarray(CAMERA.camtoworld)[None])
    camera = dataclasses.replace(
        CAMERA, camtoworld=np.asarray(moved, np.float32), near=np.float32(0.5)
    )
    expected, _ = rasterizer.rasterize(splats, CAMERA)
    found, _ = rasterizer.rasterize(carry_over(splats, similarity), camera)
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_a_disc_lies_in_its_surface():
    rng = np.random.default_rng(0)
    outwards = rng.normal(size=(30, 3))
    outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
    outwards[:2] = [[0, 0, -1], [0, 0, 0]]  # straight away, and unknown
    splats = bake.first_splats(outwards, np.ones(30), np.ones((30, 3)), outwards, 0.9)
    axes = np.asarray(rotations(jnp.asarray(splats.quaternions)))
    along = np.abs((axes[:, :, 2] * outwards).sum(axis=-1))
    np.testing.assert_allclose(along, np.linalg.norm(outwards, axis=-1), atol=1e-5)
    thickness = np.exp(splats.log_scales[:, 2])
    np.testing.assert_allclose(thickness[[0, 1]], [bake.FLATNESS, 1.0], rtol=1e-6)


@pytest.mark.parametrize("width", [0.3, 1.0, 3.0])
def test_first_splats_make_a_surface_opaque_and_no_more(width):
    """One splat per cell before a camera at distance 1 whose pixels are 0.01 wide."""
    camera = Pinhole(
        np.eye(3, 4, dtype=np.float32),
        np.full(2, 100.0, np.float32),
        np.full(2, 8.0, np.float32),
        np.float32(0.1),
        16,
        16,
    )
    steps = np.arange(-0.16, 0.16, 0.01 * width)
    points = np.stack(np.meshgrid(steps, steps, [-1.0]), axis=-1).reshape(-1, 3)
    facing = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    sizes = np.full(len(points), bake.OVERLAP * 0.01 * width)
    opacity = bake.first_opacity(width)
    splats = bake.first_splats(points, sizes, np.ones_like(points), facing, opacity)
    _, left = rasterizer.rasterize(splats, camera)
    assert 0.005 < left.mean() < 0.1


def wall(count, width=1.0):
    """Surfels on a square, each a millionth wide."""
    rng = np.random.default_rng(0)
    points = np.pad(rng.uniform(0.0, width, (count, 2)), ((0, 0), (0, 1)))
    axes = np.full(count, 2)
    return bake.Surfels(points, np.full(count, 1e-3), rng.random((count, 3)), axes)


@pytest.mark.parametrize("count", [1, 50, 700, 5000])
def test_thinning_keeps_to_its_count_and_to_the_surface(count):
    surfels = wall(4000)
    thin, width = bake.thin_out(surfels, count)
    assert 0.5 * count <= len(thin.points) <= count or len(thin.points) == 4000
    np.testing.assert_array_equal(thin.points[:, 2], 0.0)
    if len(thin.points) < 4000:
        # One splat per occupied cell of the square.
        assert (1.0 / (width * 1e-3)) ** 2 == pytest.approx(len(thin.points), rel=0.5)
    np.testing.assert_allclose(thin.footprints, 1e-3)


def test_fitting_comes_nearer_to_the_pictures_and_touches_what_it_may():
    truth = some_splats(30, degree=0)
    target = bake.Target(CAMERA, rasterizer.rasterize(truth, CAMERA)[0])
    first = dataclasses.replace(truth, harmonics=np.zeros_like(truth.harmonics))

    def error(splats):
        return np.mean((rasterizer.rasterize(splats, CAMERA)[0] - target.srgb) ** 2)

    *_, last = bake.fit_splats(first, [target], 25, {"harmonics": 0.2})
    assert error(last) < 0.1 * error(first)
    np.testing.assert_array_equal(last.points, first.points)
    np.testing.assert_array_equal(last.opacity_logits, first.opacity_logits)
    shown = 0.5 + SH0 * np.asarray(last.harmonics)
    assert shown.min() >= -1e-5 and shown.max() <= 1.0 + 1e-5


def test_every_view_comes_up_before_any_comes_again():
    turns = bake.views_in_turn(np.random.default_rng(0), 5, 12)
    assert sorted(turns[:5]) == sorted(turns[5:10]) == list(range(5))
    assert len(turns) == 12
