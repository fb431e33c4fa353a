# SPDX-License-Identifier: Apache-2.0
"""H.264 videos that any player opens, through PyAV (the only module that imports it).

The optional extra ``video`` brings PyAV with its own FFmpeg. Frames are
``[height, width, 3]`` uint8 sRGB, row 0 at the top.
"""

import importlib.util
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8

from internal.errors import UserError
from internal.files.atomic import writing

if TYPE_CHECKING:
    import av

CRF = 17  # constant quality of x264 at which few eyes find a difference
BT709 = "colorprim=bt709:transfer=bt709:colormatrix=bt709"


def available() -> bool:
    """Whether the extra ``video`` is installed."""
    return importlib.util.find_spec("av") is not None


def write_video(
    frames: Iterable[UInt8[np.ndarray, "height width 3"]], path: Path, fps: int
) -> None:
    """Encodes frames as they come into an MP4: yuv420p, BT.709, index in front.

    Players need even sizes (4:2:0), so an odd last row or column is cropped. The
    file appears under its name only when it is whole.

    Args:
        frames: at least one, all of one size, at least 2 x 2 pixels.
        path: ends in ``.mp4``; its folder exists.
        fps: frames per second.

    Raises:
        UserError: PyAV is missing, the folder cannot be written or the disk is
            full.
    """
    if not available():
        raise UserError(f"{path}: videos need PyAV: run pip install -e '.[video]'")
    with writing(path) as partial:
        _encode(frames, partial, fps)


def read_video(
    path: Path,
) -> Iterator[tuple[float, UInt8[np.ndarray, "height width 3"]]]:
    """Yields the time in seconds and the picture, upright, of each frame.

    Raises:
        UserError: PyAV is missing, or the file is no video that it can read.
    """
    if not available():
        raise UserError(f"{path}: videos need PyAV: run pip install -e '.[video]'")
    import av
    from av.error import FFmpegError

    try:
        with av.open(str(path)) as container:
            for frame in container.decode(video=0):
                picture = frame.to_ndarray(format="rgb24")
                yield frame.time or 0.0, np.rot90(picture, round(frame.rotation / 90))
    except (FFmpegError, IndexError) as error:
        raise UserError(
            f"{path}: not a readable video ({error}); expected MP4, MOV, MKV, ...: "
            "copy the file again, or give a folder of photos"
        ) from error


def _encode(
    frames: Iterable[UInt8[np.ndarray, "height width 3"]], path: Path, fps: int
) -> None:
    import av

    pictures = map(_even, frames)
    first = next(pictures)
    with av.open(str(path), "w", options={"movflags": "+faststart"}) as container:
        stream = container.add_stream("libx264", rate=fps)
        stream.height, stream.width = first.shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": str(CRF), "x264-params": BT709}
        container.mux(stream.encode(_to_yuv(first)))
        for picture in pictures:
            container.mux(stream.encode(_to_yuv(picture)))
        container.mux(stream.encode())


def _even(
    frame: UInt8[np.ndarray, "height width 3"],
) -> UInt8[np.ndarray, "even_height even_width 3"]:
    height, width = frame.shape[0] // 2 * 2, frame.shape[1] // 2 * 2
    return np.ascontiguousarray(frame[:height, :width])


def _to_yuv(frame: UInt8[np.ndarray, "height width 3"]) -> "av.VideoFrame":
    import av

    rgb = av.VideoFrame.from_ndarray(frame, format="rgb24")
    return rgb.reformat(format="yuv420p", dst_colorspace="ITU709")
