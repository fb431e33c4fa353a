# SPDX-License-Identifier: Apache-2.0
"""A video as photos: the sharpest frame of each interval."""

import shutil
from pathlib import Path

import numpy as np

from internal import progress
from internal.errors import UserError
from internal.files import image_io
from internal.files.atomic import PARTIAL
from internal.files.video import Frame, read_video
from internal.prepare.statistics import sharpness

INTERVAL = 0.5  # seconds
SHARPNESS_WIDTH = 640  # pixels that sharpness is measured on, about


def extract_frames(video: Path, folder: Path) -> None:
    """Writes PNG files named by interval, unless an earlier run wrote them.

    Raises:
        UserError: the video cannot be read, or the disk is full.
    """
    if folder.is_dir():
        return
    partial = folder.with_name(f"{PARTIAL}{folder.name}")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    best, best_sharpness, interval = None, -1.0, 0
    with progress.bar(0, f"reading {video.name}", "frame") as shown:
        for frame in read_video(video):
            if int(frame.time / INTERVAL) != interval:
                _write(best, partial, interval)
                best, best_sharpness = None, -1.0
                interval = int(frame.time / INTERVAL)
            quick = frame.quick()
            step = max(1, quick.shape[1] // SHARPNESS_WIDTH)
            sharp = sharpness(quick[::step, ::step, 1].astype(np.float32) / 255.0)
            if sharp > best_sharpness:
                best, best_sharpness = frame, sharp
            shown.update()
    if best is None:
        raise UserError(f"{video}: a video without a frame; expected some seconds")
    _write(best, partial, interval)
    partial.rename(folder)


def _write(frame: Frame | None, folder: Path, interval: int) -> None:
    if frame is not None:
        bits = 16 if frame.is_deep() else 8
        image_io.write(folder / f"{interval:05}.png", frame.srgb(), bits=bits)
