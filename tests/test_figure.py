# SPDX-License-Identifier: Apache-2.0
"""Laws of figures with crops."""

import numpy as np
import pytest

from internal.pages import figure
from internal.pages.figure import Crop


def _flat(value: float, height: int = 60, width: int = 80) -> np.ndarray:
    return np.full((height, width, 3), value, np.float32)


def _count(picture: np.ndarray, value) -> int:
    return int((picture == np.float32(value)).all(axis=-1).sum())


def test_found_crops_are_the_detail_and_the_darkest_of_the_rest():
    picture = _flat(0.5, height=64)
    picture[0:16:2, 60:80] = 1.0  # top right: stripes
    picture[48:64, 0:20] = 0.4  # bottom left: dark
    detailed, dark = figure.find_crops(picture)
    assert detailed == Crop(60, 0, 20, 16)
    assert dark == Crop(0, 48, 20, 16)


def test_found_crops_do_not_overlap_and_fit():
    noise = np.random.default_rng(0).uniform(0, 1, (37, 53, 3)).astype(np.float32)
    first, second = figure.find_crops(noise)
    covered = np.zeros_like(noise)
    for crop in (first, second):
        assert crop.fits(noise)
        crop.of(covered)[:] += 1
    assert covered.max() == 1


@pytest.mark.parametrize(
    "crop", [Crop(-1, 0, 5, 5), Crop(70, 0, 11, 5), Crop(0, 58, 5, 3), Crop(0, 0, 0, 5)]
)
def test_a_crop_outside_does_not_fit(crop):
    assert not crop.fits(_flat(0.5))


def test_a_crop_is_enlarged_by_a_whole_factor_below_its_picture():
    picture = _flat(0.25)
    picture[10:13, 20:24] = 0.75
    # 80 pixels become 320, by 4. A crop of 20 fills them by 16; of 48 by 6, not 6.67.
    for width, factor in ((20, 16), (48, 6)):
        drawn = figure.figure([("a", picture)], [Crop(15, 5, width, 10)], 1)
        assert _count(drawn, 0.75) == (4 * 4 + factor * factor) * 12


def test_a_crop_too_large_for_its_share_is_cut_and_not_spilt():
    crops = [Crop(0, 0, 80, 60), Crop(0, 0, 8, 6)]
    drawn = figure.figure([("", _flat(0.25))], crops, 1)
    one = figure.figure([("", _flat(0.25))], crops[1:], 1)
    assert drawn.shape[1] == one.shape[1]
    assert _count(drawn, figure.FRAME_COLORS[1]) > 0


def test_frames_tell_where_crops_come_from_on_the_first_picture_only():
    crops = [Crop(0, 0, 40, 20)]
    one = figure.figure([("", _flat(0.25))], crops, 2)
    two = figure.figure([("", _flat(0.25)), ("", _flat(0.5))], crops, 2)
    # Two pixels wide, around 160 x 80 on the picture and 320 x 160 below it.
    on_picture, on_crop = 2 * (2 * 160 + 2 * 76), 2 * (2 * 320 + 2 * 156)
    color = figure.FRAME_COLORS[0]
    assert _count(one, color) == on_picture + on_crop
    assert _count(two, color) == on_picture + 2 * on_crop


def test_rows_are_filled_up_and_all_pictures_are_shown():
    pictures = [(str(i), _flat((i + 1) / 8)) for i in range(5)]
    drawn = figure.figure(pictures, [], 2)
    rows = figure.figure(pictures[:2], [], 2)
    assert drawn.shape == (3 * rows.shape[0], *rows.shape[1:])
    for _, picture in pictures:
        assert _count(drawn, picture[0, 0]) == 16 * 60 * 80
