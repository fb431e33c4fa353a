# SPDX-License-Identifier: Apache-2.0
"""Dark captures whose normal light is known: what metering is fitted to and tested on.

Pixels are ``[n, 3]`` 8-bit sRGB. ``real`` pairs are a camera's, all others are normal
photos darkened by the capture model. Photos lie in ``LLNERF_DATA``.
"""

import dataclasses
import math
import os
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from internal.color import photo_to_linear, to_uint8
from internal.files import image_io
from internal.night.capture import CaptureModel, capture, view_key

SAMPLES = 4096  # pixels of a photo
SEARCHED = 8  # every so many of them choose the exposure
LEVELS = (30, 8, 4, 2)  # sRGB means of dark captures, of 255
WELLS = (math.inf, 40_000.0, 10_000.0, 3_000.0)  # electrons at white
NEIGHBOURS = (1, 4)  # noisy pixels that a smaller photo averages
CASTS = ((1.0, 1.0, 1.0), (1.0, 0.94, 0.84))
SCENES = {"llff/fern/images_8": 2, "orbit/mug/images": 6, "orbit/can/images": 6}
WHITE = 254  # a pixel with all channels here shows at least this much light

Picture = Float[np.ndarray, "height width 3"]


@dataclasses.dataclass(frozen=True)
class Shot:
    """Aligned pixels of a dark capture and of its normal-light truth."""

    group: str  # "pairs", "ordinary" or "bright" (the bright ones of the pairs)
    picture: int  # captures of one picture share it
    level: int  # sRGB mean it was darkened to, of 255; 0: a camera's own
    dark: UInt8[np.ndarray, "n 3"]
    truth: UInt8[np.ndarray, "n 3"]


def data() -> Path:
    """The folder of captures."""
    default = Path(__file__).parents[2] / "shared/data"
    return Path(os.environ.get("LLNERF_DATA", default))


def pair_files() -> list[tuple[Path, Path]]:
    """Dark and bright files, in the order they were taken in."""
    low = sorted((data() / "photos/pairs/low").iterdir(), key=lambda x: int(x.stem))
    return [(file, data() / "photos/pairs/high" / file.name) for file in low]


def shots() -> list[Shot]:
    """All captures: the pairs, their bright photos at every level of darkness, and each
    ordinary photo at every other one."""
    found = []
    for picture, files in enumerate(pair_files()):
        rng = np.random.default_rng(picture)
        dark, truth = (to_uint8(image_io.read_srgb(file)) for file in files)
        some = _sample(rng, dark)
        pixels = dark.reshape(-1, 3)[some], truth.reshape(-1, 3)[some]
        found.append(Shot("pairs", picture, 0, *pixels))
        found += darkened("bright", picture, pixels[1], LEVELS, rng)
    ordinary = sorted((data() / "photos/normal").iterdir())
    for picture, file in enumerate(ordinary, len(pair_files())):
        rng = np.random.default_rng(picture)
        photo = to_uint8(image_io.read_srgb(file))
        truth = photo.reshape(-1, 3)[_sample(rng, photo)]
        found += darkened("ordinary", picture, truth, LEVELS[picture % 2 :: 2], rng)
    return found


def scene_shots() -> list[tuple[str, Shot]]:
    """Whole scenes at every level of darkness, pixels of all their photos together,
    as a training's metering sees them."""
    found = []
    for number, (name, every) in enumerate(SCENES.items()):
        rng = np.random.default_rng(number)
        photos = [
            to_uint8(image_io.read_srgb(file)).reshape(-1, 3)
            for file in sorted((data() / name).iterdir())[::every]
        ]
        truth = np.concatenate([x[rng.integers(len(x), size=3000)] for x in photos])
        for shot in darkened("scene", number, truth, LEVELS, rng):
            found.append((f"{name.split('/')[1]} {shot.level}", shot))
    return found


def darkened(
    group: str,
    picture: int,
    truth: UInt8[np.ndarray, "n 3"],
    levels: tuple[int, ...],
    rng: np.random.Generator,
) -> list[Shot]:
    """A photo at some levels, each with a noise, a cast and lamps of its own."""
    light = photo_to_linear(truth / 255.0)
    white = np.all(truth >= WHITE, axis=-1, keepdims=True)
    found = []
    for turn, level in enumerate(levels):
        lamps = np.where(white, light * 2.0 ** rng.uniform(0.0, 1.0), light)
        camera = CaptureModel(
            exposure=exposure_for(lamps, level),
            full_well=WELLS[rng.integers(len(WELLS))],
            channel_gains=CASTS[rng.integers(len(CASTS))],
            seed=picture,
        )
        dark = averaged(lamps, camera, turn, NEIGHBOURS[rng.integers(len(NEIGHBOURS))])
        found.append(Shot(group, picture, level, dark, truth))
    return found


def averaged(
    linear_rgb: Float[np.ndarray, "n 3"], camera: CaptureModel, view: int, count: int
) -> UInt8[np.ndarray, "n 3"]:
    """What a photo made smaller by averaging ``count`` noisy pixels each holds: noise
    clipped at black, whose mean is above it."""
    many = np.broadcast_to(linear_rgb, (count, *linear_rgb.shape))
    photo = capture(many, camera, view_key(camera, view))
    return to_uint8(np.mean(photo / 255.0, axis=0))


def exposure_for(linear_rgb: Float[np.ndarray, "*b 3"], level: float) -> float:
    """The exposure at which the sRGB mean is ``level`` of 255."""
    srgb = np.linspace(0.0, 1.0, 2048)
    table = photo_to_linear(srgb)
    some = linear_rgb.reshape(-1, 3)[::SEARCHED]
    low, high = -16.0, 1.0
    for _ in range(16):
        middle = (low + high) / 2.0
        too_dark = np.interp(some * 2.0**middle, table, srgb).mean() * 255.0 < level
        low, high = (middle, high) if too_dark else (low, middle)
    return 2.0**low


def _sample(rng: np.random.Generator, photo: UInt8[np.ndarray, "h w 3"]):
    count = photo.shape[0] * photo.shape[1]
    return np.resize(rng.permutation(count), SAMPLES)
