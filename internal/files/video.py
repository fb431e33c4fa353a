# SPDX-License-Identifier: Apache-2.0
"""H.264 videos that any player opens, through PyAV (the only module that imports it).

The optional extra ``video`` brings PyAV with its own FFmpeg. Written frames are
``[height, width, 3]`` uint8 sRGB, row 0 at the top. What is read is brought to sRGB
from what the video states (``color_profile``); BT.709 is shown as sRGB is.
"""

import dataclasses
from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, UInt8

from internal import extras
from internal.errors import UserError
from internal.files.atomic import writing
from internal.files.color_profile import Encoding, from_codes, to_srgb

if TYPE_CHECKING:
    import av
    from av.container import InputContainer

CRF = 17  # constant quality of x264 at which few eyes find a difference
ROUNDED = 0.01  # of a pixel's width: sizes that are even state no other shape
CUT_OFF = 0.1  # of the stated length, or a second: a file copied in part
# Codes of H.273; players take large videos that state nothing as BT.709.
UNSTATED, BT709_MATRIX, SD_HEIGHT = 2, 1, 576
BT709 = "colorprim=bt709:transfer=bt709:colormatrix=bt709"


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
    extras.need("video", "av", to=f"{path}: a video")
    with writing(path) as partial:
        _encode(frames, partial, fps)


@dataclasses.dataclass(frozen=True)
class Still:
    """One picture of a video, upright, which is brought to sRGB when asked."""

    time: float  # seconds
    _decoded: "av.VideoFrame"
    _aspect: float  # of its pixels: width over height, 1 for square ones
    _encoding: Encoding | None
    _turns: int  # quarters, counterclockwise

    def quick(self) -> UInt8[np.ndarray, "h w 3"]:
        """Its values in 8 bits as the video codes them: fit to compare frames."""
        return np.rot90(self._rgb("rgb24"), self._turns)

    def is_deep(self) -> bool:
        """Whether it has more than 8 bits, or loses some when brought to sRGB."""
        bits = max(component.bits for component in self._decoded.format.components)
        return bits > 8 or self._encoding is not None

    def srgb(self) -> Float[np.ndarray, "h w 3"]:
        """The picture in [0, 1], of the depth that the video has."""
        if not self.is_deep():
            return self.quick().astype(np.float32) / 255.0
        stored = self._rgb("rgb48le").astype(np.float32) / 65535.0
        return np.rot90(to_srgb(stored, self._encoding), self._turns)

    def _rgb(self, layout: str) -> np.ndarray:
        frame = self._decoded
        matrix = frame.colorspace
        if matrix == UNSTATED and frame.height > SD_HEIGHT:
            matrix = BT709_MATRIX
        width = round(frame.width * self._aspect)
        squared = frame.reformat(width, format=layout, src_colorspace=matrix)
        return squared.to_ndarray()


def read_video(path: Path) -> Iterator[Still]:
    """Yields each frame; videos of HDR and of wide gamut are said to be so.

    Raises:
        UserError: PyAV is missing, or the file is no video that it can read.
    """
    extras.need("video", "av", to=f"{path}: a video")
    import av
    from av.error import FFmpegError

    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            encoding, aspect, time = None, 1.0, 0.0
            for index, frame in enumerate(container.decode(video=0)):
                if index == 0:  # what only the frames state is known now
                    encoding = _encoding(path, stream.codec_context)
                    aspect = _pixel_aspect(path, stream.sample_aspect_ratio)
                turns, time = round(frame.rotation / 90), frame.time or 0.0
                yield Still(time, frame, aspect, encoding, turns)
            stated = _seconds(container)
    except (FFmpegError, IndexError) as error:
        raise UserError(
            f"{path}: not a readable video ({_reason(error)}); expected MP4, MOV, MKV, "
            "...: copy the file again, or give a folder of photos"
        ) from error
    if stated - time > max(1.0, CUT_OFF * stated):
        raise UserError(
            f"{path}: ends after {time:.1f} of {stated:.1f} seconds; copy it again"
        )


def _reason(error: Exception) -> str:
    return "no pictures in it" if isinstance(error, IndexError) else str(error)


def _seconds(container: "InputContainer") -> float:
    """The stated length: the pictures' own if there is one, else with the sound."""
    stream = container.streams.video[0]
    if stream.duration and stream.time_base:
        return float(stream.duration * stream.time_base)
    return (container.duration or 0) / 1e6


def _pixel_aspect(path: Path, stated: Fraction | None) -> float:
    """Width over height of a video's pixels; lenses here have square ones."""
    aspect = float(stated or 1)
    if abs(aspect - 1.0) <= ROUNDED:
        return 1.0
    print(f"{path}: pixels {aspect:.3g} times as wide as high, made square", flush=True)
    return aspect


def _encoding(path: Path, codec: "av.VideoCodecContext") -> Encoding | None:
    encoding = from_codes(int(codec.color_primaries), int(codec.color_trc))
    if encoding:
        print(f"{path}: {encoding.name}, brought to sRGB", flush=True)
    return encoding


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
