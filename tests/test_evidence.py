# SPDX-License-Identifier: Apache-2.0
"""Laws of evidence, on a room of two planes: a wall at z = -4 and, before it, a panel.

Photos are taken from places (c, 0, 0). The wall's point (x, y, -4) is hidden from
one if the line to it meets the panel at z = -2, that is if |c + x| / 2 < WIDTH.
"""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from internal.cameras import Lens
from internal.coord import Unbounded
from internal.rendering import evidence
from internal.rendering.evidence import ALONE, BANDS, LEGEND, UNSEEN, Witnesses
from internal.scene import colmap
from internal.scene.masks import ALL
from internal.scene.noise import Noise
from internal.structs import Rendering

LENS = Lens("PINHOLE", 96, 72, (60.0, 60.0, 48.0, 36.0))
WIDTH = 0.5  # half of the panel's
FAR = 40.0
SPACE = Unbounded(np.float32(0.1), np.float32(FAR))
PLACES = (-0.3, 0.0, 0.3)
DARKEST, LIT = 1 / 255, 80 / 255  # of the wall: right and left of x = 0
ONE_LEVEL = (1 / (255 * 12.92)) ** 2  # variance of a level at black
NOISE = Noise((ONE_LEVEL, ONE_LEVEL, ONE_LEVEL), (0.0, 0.0, 0.0))


def stand(x, yaw=0.0):
    """A camera at (x, 0, 0) that looks along -z, turned to the right by ``yaw``."""
    c, s = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    return np.column_stack([rotation, [x, 0.0, 0.0]])


def render(camtoworld, wall=-4.0):
    """What a camera sees, and where on the wall."""
    directions = colmap.lens_directions(LENS) @ camtoworld[:, :3].T
    origin = camtoworld[:, 3]
    on_panel = (-2.0 - origin[2]) / directions[:, 2]
    hidden = np.abs(origin[0] + on_panel * directions[:, 0]) < WIDTH
    depth = np.where(hidden, on_panel, (wall - origin[2]) / directions[:, 2])
    points = origin + depth[:, None] * directions
    rgb = np.where(points[:, :1] < 0.0, LIT, DARKEST) * np.ones(3)
    shape = LENS.height, LENS.width, -1
    rendering = Rendering(rgb.reshape(shape), depth.reshape(shape))
    return rendering, points.reshape(shape), hidden.reshape(shape[:2])


def witnesses(places=PLACES, wall=-4.0, noise=NOISE, mask: np.ndarray = ALL):
    cameras = tuple(
        evidence.witness(SPACE, FAR, LENS, stand(x), render(stand(x), wall)[0], mask)
        for x in places
    )
    return Witnesses(SPACE, FAR, evidence.noise_variance(noise), cameras)


def color_of(band):
    return np.float32(band.rgb) / 255


def test_photos_are_counted_where_the_geometry_says():
    pose = stand(2.5, yaw=-0.45)
    rendering, points, on_panel = render(pose)
    found = witnesses().testify(LENS, pose, rendering)
    x, y = points[..., 0], points[..., 1]
    expected = np.zeros(x.shape, int)
    clear = ~on_panel
    for place in PLACES:
        at_panel = np.abs(place + x) / 2
        sees = (at_panel > WIDTH) & (np.abs(x - place) < 3.2) & (np.abs(y) < 2.4)
        expected += sees
        edges = (np.abs(x - place) - 3.2, np.abs(y) - 2.4, at_panel - WIDTH)
        clear &= np.min(np.abs(edges), axis=0) > 0.06
    assert clear.mean() > 0.3 and set(expected[clear]) >= {0, 1, 2, 3}
    np.testing.assert_array_equal(found.photos[clear], expected[clear])
    colors = evidence.false_colors(found)
    assert (colors[clear & (expected == 0)] == color_of(UNSEEN)).all()
    assert (colors[clear & (expected == 1)] == color_of(ALONE)).all()


def test_a_part_at_1_of_255_is_lifted_noise_and_a_lit_one_is_detail():
    pose = stand(0.1)
    rendering, points, on_panel = render(pose)
    found = witnesses().testify(LENS, pose, rendering)
    seen = ~on_panel & (found.photos == 3)
    dark, lit = seen & (points[..., 0] > 0), seen & (points[..., 0] < 0)
    assert dark.sum() > 100 and lit.sum() > 100
    colors = evidence.false_colors(found)
    assert (colors[dark] == color_of(BANDS[0])).all()
    assert (colors[lit] == color_of(BANDS[3])).all()
    np.testing.assert_allclose(found.levels[dark], 1.0, rtol=1e-5)


@pytest.mark.parametrize("size", [(72, 96), (18, 48), (360, 480)])
def test_a_masked_pixel_saw_nothing(size):
    """Masked in all photos: the lower left quarter of what they see of the wall."""
    mask = np.ones(size, bool)
    mask[size[0] // 2 :, : size[1] // 2] = False
    pose = stand(0.0)
    rendering, points, on_panel = render(pose)
    whole, part = (witnesses((0.0,) * 3, mask=m).testify(LENS, pose, rendering)
                   for m in (ALL, mask))  # fmt: skip
    hidden = (points[..., 0] < 0) & (points[..., 1] < 0)
    assert (whole.photos[~on_panel] == 3).all() and hidden.sum() > 1000
    np.testing.assert_array_equal(part.photos, np.where(hidden, 0, whole.photos))


def test_four_times_the_photos_or_half_the_noise_are_twice_the_steps():
    pose = stand(0.0)
    one, four = (witnesses((0.0,) * n).testify(LENS, pose, render(pose)[0])
                 for n in (1, 4))  # fmt: skip
    np.testing.assert_allclose(four.steps, 2 * one.steps)
    quiet = witnesses((0.0,))
    quiet = dataclasses.replace(quiet, noise_variance=quiet.noise_variance / 4)
    np.testing.assert_allclose(
        quiet.testify(LENS, pose, render(pose)[0]).steps, 2 * one.steps
    )


def test_photos_without_noise_still_round():
    # Rounding alone has variance 1/12, so level 1 is sqrt(12) of its deviations.
    silent = Noise((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    found = witnesses((0.0,), noise=silent).testify(
        LENS, stand(0.0), render(stand(0.0))[0]
    )
    np.testing.assert_allclose(found.steps[found.levels < 2], np.sqrt(12), rtol=0.1)


def test_where_a_ray_meets_nothing_photos_that_meet_nothing_there_are_counted():
    pose = stand(1.0)
    pose[2, 3] = 0.2 * FAR  # so far behind, "far" is elsewhere than for the photos
    rendering, _, on_panel = render(pose, wall=-1000.0)
    found = witnesses(wall=-1000.0).testify(LENS, pose, rendering)
    right = np.s_[8:-8, 76:82]
    assert not on_panel[right].any()
    assert (found.photos[right] == 3).all()
    closed = witnesses().testify(LENS, pose, rendering)
    assert (closed.photos[right] == 0).all()


def test_what_a_camera_outside_the_space_shows_was_seen_by_nobody():
    rendering, _, _ = render(stand(0.0))
    nowhere = dataclasses.replace(rendering, depth=np.full((72, 96, 1), np.nan))
    found = witnesses().testify(LENS, stand(0.0), nowhere)
    assert (found.photos == 0).all()


@given(st.integers(0, 9), st.floats(0.0, 1e4))
def test_every_pixel_has_one_colour_of_the_legend(photos, steps):
    found = evidence.Evidence(
        np.array([[photos]]), np.array([[1.0]]), np.array([[steps]])
    )
    (color,) = evidence.false_colors(found)[0]
    assert sum(np.array_equal(color, color_of(band)) for band in LEGEND) == 1


def test_the_legend_names_every_colour():
    text = evidence.legend_html()
    for band in LEGEND:
        assert f"rgb{band.rgb}" in text and band.meaning in text


@pytest.mark.parametrize("size", [(960, 720), (40, 30), (1, 5000)])
def test_a_photo_is_asked_in_a_small_picture_of_the_same_view(size):
    width, height = size
    lens = Lens("PINHOLE", width, height, (0.9 * width,) * 2 + (width / 2, height / 2))
    small = evidence.shrink(lens, 10_000)
    assert small.width * small.height <= 10_100
    assert small.params[0] / small.width == pytest.approx(0.9)
