# SPDX-License-Identifier: Apache-2.0
"""A video as photos: sharp frames, each a step of motion on from the last.

The video is read twice: once to compare its frames, once for those chosen.
"""

import shutil
from pathlib import Path

import numpy as np

from internal import color, progress
from internal.errors import UserError
from internal.files import image_io
from internal.files.atomic import PARTIAL
from internal.files.video import read_video
from internal.prepare import frame_choice
from internal.prepare.brighten import Recipe, make_copy
from internal.prepare.frame_choice import HEIGHT, WIDTH
from internal.prepare.statistics import sharpness

SHARPNESS_SIDE = 640  # pixels of the longer side that sharpness is measured on
# Noise of single pixels would count as detail, in blurred frames as in sharp ones.
RECIPE = Recipe(brighten=True, blur=1.0)


def extract_frames(video: Path, folder: Path) -> None:
    """Writes chosen frames as PNG files named by their numbers in the video, unless an
    earlier run wrote them; says what was chosen.

    Raises:
        UserError: the video cannot be read, or the disk is full.
    """
    if folder.is_dir():
        return
    copies, sharp = [], []
    with progress.bar(0, f"comparing frames of {video.name}", "frame") as shown:
        for frame in read_video(video):
            grey = _brightened(frame.quick())
            sharp.append(sharpness(grey[..., 0]))
            small = image_io.resize_area(grey, WIDTH, HEIGHT)
            copies.append(color.to_uint8(small[..., 0]))
            shown.update()
    if not copies:
        raise UserError(f"{video}: a video without a frame; expected some seconds")
    choice = frame_choice.choose(copies, sharp)
    print(f"{video}: {choice.describe()}", flush=True)
    partial = folder.with_name(f"{PARTIAL}{folder.name}")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    wanted = set(choice.chosen)
    with progress.bar(len(wanted), "writing frames", "frame") as shown:
        for number, frame in enumerate(read_video(video)):
            if number in wanted:
                bits = 16 if frame.is_deep() else 8
                image_io.write(partial / f"{number:05}.png", frame.srgb(), bits=bits)
                shown.update()
    partial.rename(folder)


def _brightened(coded: np.ndarray) -> np.ndarray:
    """A grey copy [height, width, 1] in which the dark can be compared."""
    height, width, _ = coded.shape
    factor = min(1.0, SHARPNESS_SIDE / max(width, height))
    srgb = coded.astype(np.float32) / 255.0
    if factor < 1.0:
        size = max(round(factor * width), 1), max(round(factor * height), 1)
        srgb = image_io.resize_area(srgb, *size)
    return make_copy(srgb, RECIPE)
