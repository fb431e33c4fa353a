# SPDX-License-Identifier: Apache-2.0
"""Laws of sharpness: of photos that show one texture, matched where they show it."""

import numpy as np
import pytest
from scipy import ndimage

from internal.prepare import sharpness

SIDE = 96
PLACES = np.random.default_rng(1).uniform(16, 80, (60, 2))


def texture(seed=0):
    noise = np.random.default_rng(seed).normal(size=(SIDE, SIDE))
    return np.asarray(0.5 + ndimage.gaussian_filter(noise, 1.5), np.float32)


def moved(copy, pixels, degrees):
    """Averaged along a line."""
    steps = np.linspace(-pixels / 2, pixels / 2, 33)
    angle = np.radians(degrees)
    shifts = [(s * np.sin(angle), s * np.cos(angle)) for s in steps]
    return np.mean([ndimage.shift(copy, s, order=1, mode="wrap") for s in shifts], 0)


def pairs(count, matches=60):
    ends = np.stack([PLACES[:matches]] * 2, axis=1)
    return {(i, j): ends for j in range(count) for i in range(j)}


def score(copies, found=None):
    found = pairs(len(copies)) if found is None else found
    return sharpness.against_overlapping(
        lambda view: np.asarray(copies[view], np.float32), len(copies), found
    )


def test_equal_photos_have_1_and_what_is_not_matched_has_no_score():
    found = score([texture()] * 3, pairs(2))
    np.testing.assert_allclose(found, [1.0, 1.0, np.nan], rtol=1e-3)
    few = pairs(2, sharpness.FEWEST_MATCHES - 1)
    assert np.isnan(score([texture()] * 2, few)).all()


@pytest.mark.parametrize("degrees", [0, 30, 90, 135])
def test_motion_in_any_direction_is_seen_and_more_of_it_more(degrees):
    copies = [texture()] * 3 + [moved(texture(), n, degrees) for n in (2, 5, 10)]
    found = score(copies)
    assert found[:3].min() > 0.98
    assert 1.0 > found[3] > found[4] > found[5]
    assert found[4] < sharpness.BLURRED and found[5] < sharpness.HARMFUL


def test_what_the_photos_show_elsewhere_does_not_count():
    """A sharp photo of a plain wall with the texture in its middle."""
    plain = np.full((SIDE, SIDE), 0.5)
    plain[8:88, 8:88] = texture()[8:88, 8:88]
    assert score([texture(), plain])[1] > 0.9


def test_harmful_photos_are_left_out_where_sharp_ones_show_the_same():
    relative = np.array([1.0, 0.95, 1.05, 0.5, 0.65, np.nan, 0.3])
    everyone = list(range(7))
    found = sharpness.find_harmful(relative, pairs(7), everyone)
    assert found == [6, 3]  # the most blurred first; 4 is only a little
    assert sharpness.find_harmful(relative, pairs(7), [0, 1, 3, 4]) == []
    alone = {pair: ends for pair, ends in pairs(7).items() if pair != (0, 3)}
    del alone[1, 3]
    assert sharpness.find_harmful(relative, alone, everyone) == [6]


def test_at_most_half_is_left_out():
    relative = np.array([1.0] * 3 + [0.1, 0.4, 0.3, 0.2, 0.5])
    assert sharpness.find_harmful(relative, pairs(8), list(range(8))) == [3, 6, 5, 4]
