# SPDX-License-Identifier: Apache-2.0
"""Pictures on disk are the pictures in memory, and a full disk is said to be one."""

import errno
import tempfile

import numpy as np
import pytest

from internal.errors import UserError
from internal.files.picture_store import PictureStore, gigabytes, hold
from internal.files.scratch import scratch_folder


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


def test_a_temporary_folder_that_takes_nothing_is_named(
    pictures, monkeypatch, tmp_path
):
    said = f"^{tmp_path}/scratch: .*set TMPDIR to"
    monkeypatch.setattr(tempfile, "tempdir", f"{tmp_path}/scratch")  # not there
    with pytest.raises(UserError, match=said):
        PictureStore(pictures)
    with pytest.raises(UserError, match=said), scratch_folder():
        pass
    (tmp_path / "scratch").mkdir()
    for error in (OSError(errno.ENOSPC, "full"), None):
        with pytest.raises(UserError, match=said), scratch_folder() as folder:
            raise error or UserError(f"{folder}/a.png: cannot write")
    assert not list((tmp_path / "scratch").iterdir())


def test_an_error_about_other_files_is_left_as_it_is(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    photo = tmp_path / "tmp.png"
    for error in (UserError(f"{photo}: broken"), OSError(errno.EIO, "", str(photo))):
        with pytest.raises(type(error)) as raised, scratch_folder():
            raise error
        assert raised.value is error
