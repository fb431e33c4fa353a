# SPDX-License-Identifier: Apache-2.0
"""Lens models: every pixel's ray comes back to its pixel; models read as written."""

import dataclasses
import math
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from internal.cameras import Lens
from internal.errors import UserError
from internal.scene import colmap
from tests.scene_writers import facing_world, write_model

W, H = 32, 24
ONE, TWO = (30.0, 15.5, 12.5), (30.0, 31.0, 15.5, 12.5)
LENSES = [
    Lens(model, W, H, params)
    for model, params in {
        "SIMPLE_PINHOLE": ONE,
        "PINHOLE": TWO,
        "SIMPLE_RADIAL": (*ONE, -0.1),
        "RADIAL": (*ONE, -0.1, 0.03),
        "OPENCV": (*TWO, 0.04, -0.2, -0.002, 0.001),
        "FULL_OPENCV": (*TWO, 0.1, -0.1, 0.001, 0.002, 0.01, 0.02, 0.01, 0.003),
        "FOV": (*TWO, 0.5),
        "SIMPLE_DIVISION": (*ONE, -0.1),
        "DIVISION": (*TWO, -0.1),
        "EUCM": (*TWO, 0.4, 1.1),
        "SIMPLE_FISHEYE": ONE,
        "FISHEYE": TWO,
        "SIMPLE_RADIAL_FISHEYE": (*ONE, 0.05),
        "RADIAL_FISHEYE": (*ONE, 0.05, -0.01),
        "OPENCV_FISHEYE": (*TWO, 0.05, -0.02, 0.01, -0.002),
        "THIN_PRISM_FISHEYE": (*TWO, 0.05, -0.02, 1e-3, 2e-3, 0.01, 0.0, 1e-3, 1e-3),
        "RAD_TAN_THIN_PRISM_FISHEYE": (*TWO, 0.03, *(0.01,) * 5, *(1e-3,) * 6),
        "EQUIRECTANGULAR": (float(W), float(H)),
    }.items()
]
every_lens = pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)


def pixel_centres(width: int, height: int) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1) + 0.5


def pycolmap_projection(lens: Lens, opengl: np.ndarray) -> np.ndarray:
    camera = pycolmap.Camera(
        model=lens.model, width=lens.width, height=lens.height, params=lens.params
    )
    pixels = camera.img_from_cam(opengl.astype(np.float64) * [1, -1, -1])
    assert pixels is not None
    return pixels


def test_every_model_of_colmap_is_covered():
    known = set(pycolmap.CameraModelId.__members__) - {"INVALID"}
    assert {lens.model for lens in LENSES} == known


@every_lens
def test_directions_project_to_pixel_centres(lens):
    directions = colmap.lens_directions(lens)
    assert directions.dtype == np.float32
    back = pycolmap_projection(lens, directions).reshape(H, W, 2)
    np.testing.assert_allclose(back, pixel_centres(W, H), atol=1e-3)


@every_lens
def test_directions_have_depth_one_unless_the_lens_sees_sideways(lens):
    directions = colmap.lens_directions(lens)
    if lens.model == "EQUIRECTANGULAR":
        np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1, atol=1e-6)
    else:
        np.testing.assert_array_equal(directions[:, 2], -1.0)


@every_lens
def test_scaled_lens_sees_the_same_directions_at_scaled_pixels(lens):
    """Also where the axes scale apart and the model has one focal length."""
    scaled = colmap.scale_lens(lens, 2 * W, 5 * H)
    assert (scaled.width, scaled.height) == (2 * W, 5 * H)
    directions = colmap.lens_directions(lens)
    seen = pycolmap_projection(scaled, directions).reshape(H, W, 2)
    np.testing.assert_allclose(seen, pixel_centres(W, H) * [2.0, 5.0], atol=5e-3)


def test_scaling_back_gives_the_same_lens():
    lens = LENSES[4]
    half = colmap.scale_lens(lens, W // 2, H // 2)
    assert colmap.scale_lens(lens, W, H) is lens
    np.testing.assert_allclose(colmap.scale_lens(half, W, H).params, lens.params)


def test_pinhole_directions_by_hand():
    """2x2 pixels, fx = 1, fy = 2: centres are half a pixel off the axis."""
    lens = Lens("PINHOLE", 2, 2, (1.0, 2.0, 1.0, 1.0))
    expected = [[x, y, -1.0] for y in (0.25, -0.25) for x in (-0.5, 0.5)]
    np.testing.assert_allclose(colmap.lens_directions(lens), expected)
    assert colmap.half_angle(lens) == pytest.approx(math.atan(math.hypot(0.5, 0.25)))
    assert colmap.focal_lengths(lens) == (1.0, 2.0)


def test_panorama_looks_forward_at_its_centre_and_back_at_its_edges():
    lens = Lens("EQUIRECTANGULAR", 64, 32, (64.0, 32.0))
    directions = colmap.lens_directions(lens).reshape(32, 64, 3)
    np.testing.assert_allclose(directions[16, 32], [0.05, -0.05, -1.0], atol=0.01)
    np.testing.assert_allclose(directions[16, 0], [-0.05, -0.05, 1.0], atol=0.01)
    assert directions[0, :, 1].min() > 0.99  # the top row looks up
    assert colmap.half_angle(lens) == math.pi
    assert colmap.focal_lengths(lens) == pytest.approx((64 / math.tau, 32 / math.pi))


@every_lens
def test_project_undoes_directions_at_any_distance(lens):
    points = 3.7 * colmap.lens_directions(lens).astype(np.float64)
    pixels = colmap.project(lens, points).reshape(H, W, 2)[1:-1, 1:-1]
    np.testing.assert_allclose(pixels, pixel_centres(W, H)[1:-1, 1:-1], atol=1e-3)


def test_project_hides_points_behind_and_where_distortion_folds_back():
    lens = Lens("OPENCV", W, H, (30.0, 30.0, 16.0, 12.0, 0.0, -0.3, 0.0, 0.0))
    points = np.array([[0.0, 0.0, 2.0], [1.35, 0.0, -1.0], [0.0, 0.0, -1.0]])
    folded = pycolmap_projection(lens, points[1:2])
    assert 0 < folded[0, 0] < W  # the polynomial alone puts it into the picture
    pixels = colmap.project(lens, points)
    assert np.isnan(pixels[:2]).all()
    np.testing.assert_allclose(pixels[2], [16.0, 12.0])
    assert colmap.project(lens, points[:0]).shape == (0, 2)


@pytest.mark.parametrize(
    ("model", "params", "message"),
    [
        ("CAMCORDER", ONE, "unknown model; COLMAP has .*PINHOLE"),
        ("PINHOLE", ONE, r"expected parameters \(fx, fy, cx, cy\)"),
        ("PINHOLE", (math.nan, *TWO[1:]), "must be finite"),
        ("PINHOLE", (30.0, math.inf, 1.0, 1.0), "must be finite"),
        ("PINHOLE", (0.0, *TWO[1:]), "focal lengths positive"),
        ("OPENCV", (*TWO, -3.0, 5.0, 0.1, 0.1), "have no direction"),
        ("SIMPLE_FISHEYE", (3.0, 16.0, 12.0), "have no direction"),
    ],
)
def test_broken_lenses_are_refused(model, params, message):
    with pytest.raises(UserError, match=message):
        colmap.lens_directions(Lens(model, W, H, params))


def test_empty_lens_is_refused():
    with pytest.raises(UserError, match="empty picture 0x24"):
        colmap.half_angle(Lens("PINHOLE", 0, H, TWO))


@pytest.mark.parametrize("binary", [True, False], ids=["bin", "txt"])
@pytest.mark.parametrize("folder", [*colmap.MODEL_ROOTS, "sparse/0", "colmap_sparse/3"])
def test_model_reads_as_written_sorted_by_name(tmp_path, folder, binary):
    world = dataclasses.replace(facing_world(), lens=LENSES[4])
    write_model(tmp_path / folder, world, binary)
    assert colmap.find_model(tmp_path) == tmp_path / folder
    model = colmap.read_model(tmp_path / folder)
    assert list(model.names) == world.names
    assert set(model.lenses) == {world.lens}
    np.testing.assert_allclose(model.camtoworlds, world.camtoworlds, atol=1e-12)
    points = [sorted(map(tuple, p.round(9))) for p in (model.points, world.points)]
    assert points[0] == points[1]


def test_synthetic_reconstruction_sees_its_own_points(tmp_path):
    """An oracle that shares no code with our writers: COLMAP's own observations."""
    pycolmap.set_random_seed(0)
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_frames_per_rig, options.num_points3D = 1, 4, 30
    synthetic = pycolmap.synthesize_dataset(options)
    synthetic.write_text(str(tmp_path))
    model = colmap.read_model(tmp_path)
    assert len(model.names) == synthetic.num_reg_images()
    image = synthetic.find_image_with_name(model.names[0])
    observed = image.get_observation_points2D()
    points = np.array([synthetic.point3D(p.point3D_id).xyz for p in observed])
    pose = model.camtoworlds[0]
    pixels = colmap.project(model.lenses[0], (points - pose[:, 3]) @ pose[:, :3])
    np.testing.assert_allclose(pixels, [p.xy for p in observed], atol=1e-6)


def test_incomplete_model_is_not_found(tmp_path):
    write_model(tmp_path / "sparse/0", facing_world())
    (tmp_path / "sparse/0/images.bin").unlink()
    assert colmap.find_model(tmp_path) is None
    with pytest.raises(UserError, match="not a readable COLMAP model"):
        colmap.read_model(tmp_path / "sparse/0")


def test_truncated_model_is_refused(tmp_path):
    write_model(tmp_path, facing_world())
    path = tmp_path / "images.bin"
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(UserError, match=r"not a readable COLMAP model \(.+export"):
        colmap.read_model(tmp_path)


def test_a_program_that_is_asked_to_end_prints_no_stack():
    code = "from internal.scene import colmap; import os; os.kill(os.getpid(), 15)"
    result = subprocess.run(
        [sys.executable, "-c", code],
        cwd=Path(__file__).parents[1],
        capture_output=True,
        text=True,
    )
    assert (result.returncode, result.stderr) == (-signal.SIGTERM, "")
