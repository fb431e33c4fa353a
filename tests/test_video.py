# SPDX-License-Identifier: Apache-2.0
"""Written videos open in any player and hold what was put in."""

import numpy as np
import pytest

from internal import extras
from internal.errors import UserError
from internal.files import video

av = pytest.importorskip("av")

ORANGE = (200, 100, 30)


def _frames(count: int, height: int, width: int):
    """Orange frames that get lighter; one at a time, as a renderer makes them."""
    for index in range(count):
        yield np.full((height, width, 3), ORANGE, np.uint8) + np.uint8(index // 2)


@pytest.mark.parametrize(
    "height, width, even_height, even_width",
    [(48, 64, 48, 64), (47, 64, 46, 64), (48, 63, 48, 62), (375, 501, 374, 500)],
)
def test_size_is_even_and_nothing_else_is_lost(
    tmp_path, height, width, even_height, even_width
):
    path = tmp_path / "path.mp4"
    video.write_video(_frames(5, height, width), path, 24)
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        codec = stream.codec_context
        assert (codec.height, codec.width) == (even_height, even_width)
        assert (codec.name, codec.pix_fmt) == ("h264", "yuv420p")
        assert stream.average_rate == 24
        assert len(list(container.decode(stream))) == 5


def test_colours_survive_as_bt709(tmp_path):
    path = tmp_path / "path.mp4"
    video.write_video(_frames(3, 32, 32), path, 30)
    with av.open(str(path)) as container:
        codec = container.streams.video[0].codec_context
        tags = codec.colorspace, codec.color_primaries, codec.color_trc
        frame = next(container.decode(video=0))
    assert tags == (1, 1, 1)  # ITU-T H.273 code of BT.709
    rgb = frame.reformat(format="rgb24", src_colorspace="ITU709").to_ndarray()
    np.testing.assert_allclose(rgb[16, 16].astype(float), ORANGE, atol=4)


def test_index_comes_first_so_that_browsers_start_at_once(tmp_path):
    path = tmp_path / "path.mp4"
    video.write_video(_frames(3, 32, 32), path, 30)
    content = path.read_bytes()
    assert 0 < content.find(b"moov") < content.find(b"mdat")


def test_nothing_is_left_of_a_video_that_failed(tmp_path):
    def frames():
        yield from _frames(100, 32, 32)  # more than the encoder holds back
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        video.write_video(frames(), tmp_path / "path.mp4", 30)
    assert list(tmp_path.iterdir()) == []


def test_missing_folder_is_the_users_error(tmp_path):
    path = tmp_path / "missing" / "path.mp4"
    with pytest.raises(UserError, match=r"path\.mp4: cannot write"):
        video.write_video(_frames(3, 32, 32), path, 30)


def test_missing_extra_is_the_users_error(tmp_path, monkeypatch):
    monkeypatch.setattr(extras, "has", lambda *_: False)
    with pytest.raises(UserError, match=r"pip install -e '\.\[video\]'"):
        video.write_video(_frames(1, 32, 32), tmp_path / "path.mp4", 30)
