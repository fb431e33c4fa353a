# SPDX-License-Identifier: Apache-2.0
"""How well the tone curve's metering finds back the light of darkened normal photos.

python -m benchmarks.darkened FOLDER [FOLDER ...] [--levels 5 20 80]

A folder holds normal-light photos of one scene, which the capture model darkens to 1/5,
1/20, ... of their light. Photos shrunk in linear light stand in for the field, which
averages what many photos saw; metering sees all of a scene's, without truth.
"""

import argparse
from pathlib import Path

import numpy as np

from benchmarks import workload
from benchmarks.tone import Variant, light, meter
from internal.color import linear_to_srgb, photo_to_linear
from internal.files import image_io
from internal.night.capture import CaptureModel, capture, view_key
from internal.rendering.pictures import Picture
from internal.scoring import metrics
from internal.scoring.baselines import gain_to_mean

SHRINK = 4  # times smaller on each side: noise is that of 16 photos
PHOTOS = 6  # of a scene
HEADERS = (
    "scene", "light", "saturation", "brightness / truth's, stops",
    "PSNR of the curve", "and exposure-matched", "one gain to mean 0.5",
    "one gain, chosen with the truth",
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--levels", nargs="+", type=int, default=[5, 20, 80])
    flags = parser.parse_args()
    rows = []
    for folder in flags.folders:
        files = sorted(filter(image_io.is_image, folder.iterdir()))
        chosen = files[:: max(len(files) // PHOTOS, 1)]
        photos = [photo_to_linear(image_io.read_srgb(file)) for file in chosen]
        truth = [np.asarray(linear_to_srgb(shrunk(photo))) for photo in photos]
        for level in flags.levels:
            camera = CaptureModel(exposure=1 / level)
            dark = [darkened(photo, camera, i) for i, photo in enumerate(photos)]
            rows.append((folder.parent.name, f"1/{level}", *scores(dark, truth)))
    print(workload.markdown(HEADERS, rows))


def darkened(linear_rgb: Picture, camera: CaptureModel, view: int) -> Picture:
    """The dark photo, shrunk; sRGB."""
    photo = np.asarray(capture(linear_rgb, camera, view_key(camera, view))) / 255.0
    return np.asarray(linear_to_srgb(shrunk(photo_to_linear(photo))))


def shrunk(linear_rgb: Picture) -> Picture:
    """Smaller by ``SHRINK``, means in linear light."""
    height, width = (size // SHRINK * SHRINK for size in linear_rgb.shape[:2])
    blocks = linear_rgb[:height, :width].reshape(
        height // SHRINK, SHRINK, width // SHRINK, SHRINK, 3
    )
    return blocks.mean(axis=(1, 3))


def scores(dark: list[Picture], truth: list[Picture]) -> list[str]:
    """The cells of a scene at one level: means over its photos."""
    pixels = np.concatenate([x.reshape(-1, 3) for x in dark])
    shipped = Variant()
    found = meter(shipped, pixels)
    lit = [np.asarray(light(shipped, *found, x)) for x in dark]
    gained = [np.asarray(gain_to_mean(x)) for x in dark]
    best = [metrics.exposure_matched(x, y) for x, y in zip(dark, truth, strict=True)]
    means = [photo_to_linear(np.stack(x)).mean() for x in (lit, truth)]
    mean = [
        np.mean([metrics.psnr(a, b) for a, b in zip(pictures, truth, strict=True)])
        for pictures in (lit, gained, best)
    ]
    matched = np.mean(
        [metrics.psnr_exposure_matched(a, b) for a, b in zip(lit, truth, strict=True)]
    )
    return [
        f"{found[-1]:.2f}",
        f"{np.log2(means[0] / means[1]):+.2f}",
        f"{mean[0]:.1f}",
        f"{matched:.1f}",
        *(f"{value:.1f}" for value in mean[1:]),
    ]


if __name__ == "__main__":
    main()
