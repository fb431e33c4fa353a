# SPDX-License-Identifier: Apache-2.0
"""Pictures on disk are the pictures in memory."""

import numpy as np
import pytest

from internal.files.picture_store import PictureStore, gigabytes, hold


@pytest.fixture
def pictures():
    rng = np.random.default_rng(0)
    sizes = ((4, 5), (7, 3), (2, 2), (6, 6))
    return [rng.integers(0, 65536, (*s, 3), dtype=np.uint16) for s in sizes]


def test_few_stay_in_memory_and_many_go_to_disk_unchanged(pictures):
    assert isinstance(hold(iter(pictures), 1.0), tuple)
    stored = hold(iter(pictures), 150e-9)  # the first fits, the second does not
    assert isinstance(stored, PictureStore)
    assert len(stored) == len(pictures)
    for picture, read in zip(pictures, stored, strict=True):
        np.testing.assert_array_equal(read, picture)
    assert gigabytes(stored) == gigabytes(tuple(pictures))


def test_single_pixels_are_those_of_their_pictures(pictures):
    view = np.array([[0, 1], [3, 2]])
    x, y = np.array([[4, 2], [5, 0]]), np.array([[3, 6], [0, 1]])
    found = PictureStore(pictures).pixels(view, x, y)
    for index in np.ndindex(2, 2):
        expected = pictures[view[index]][y[index], x[index]]
        np.testing.assert_array_equal(found[index], expected)
