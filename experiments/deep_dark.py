# SPDX-License-Identifier: Apache-2.0
"""What deep darkness leaves of colours, and how much of it ``unround`` finds again.

python -m experiments.deep_dark FERN/images_8 MUG/images CAN/images > table.md

Every picture (one of each folder) is darkened by the capture model to means of 30, 8, 4
and 2 of 255, ``PHOTOS`` times, each time at another place on the grid of JPEG blocks,
as other viewpoints would place it; then shrunk by 2 as for training. Their mean is what
a field of perfect geometry learns. It is brightened by the gain that undoes the
exposure and the colour cast, so that no metering counts, and scored against the truth.
"""

import argparse
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from benchmarks import workload
from internal.color import linear_to_srgb, srgb_to_linear
from internal.files import image_io
from internal.files.listing import list_pictures
from internal.night.capture import CaptureModel, capture, view_key
from internal.scene.unround import unround
from internal.scoring import metrics

Picture = Float[np.ndarray, "height width 3"]

MEANS = (30.0, 8.0, 4.0, 2.0)  # of 255
FORMATS = {"8 bits": 0, "JPEG 90": 90}  # quality; 0: none
WAYS: dict[str, Callable[[Picture], Picture]] = {
    "as stored": lambda photo: photo,
    "unrounded": unround,
}
PHOTOS = 6
BLOCK = 16  # pixels of a JPEG's unit with colours at half the size
LARGEST = (480, 640)
DARKEST = 0.2  # part of the pixels
HEADERS = (
    "picture", "mean", "stored as", "colours",
    "PSNR", "exposure-matched", "affine per channel", "SSIM",
    "RMSE of the darkest fifth", "and its bias, R, G, B",
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", type=Path, nargs="+")
    rows = []
    for folder in parser.parse_args().folders:
        names = list_pictures(folder)
        bright = image_io.read_srgb(folder / names[len(names) // 2])
        bright = bright[: LARGEST[0], : LARGEST[1]]
        for mean in MEANS:
            rows += [(folder.parent.name, *row) for row in compare(bright, mean)]
    print(workload.markdown(HEADERS, rows))


def compare(bright: Picture, mean: float) -> list[tuple[str, ...]]:
    """A row of the table for each format and way."""
    model = CaptureModel(exposure=exposure_for(bright, mean))
    gain = model.exposure * np.array(model.channel_gains)
    truth = half(bright)
    rows = []
    for name, quality in FORMATS.items():
        photos = [half(photo) for photo in darkened(bright, model, quality)]
        for way, treat in WAYS.items():
            learned = np.mean([treat(photo) for photo in photos], axis=0)
            light = np.asarray(srgb_to_linear(learned)) / gain
            lit = np.clip(np.asarray(linear_to_srgb(light)), 0.0, 1.0)
            rows.append((f"{mean:g}", name, way, *scores(lit, truth)))
    return rows


def exposure_for(bright: Picture, mean: float) -> float:
    """The exposure at which dark photos of a picture average ``mean`` of 255."""
    light = np.asarray(srgb_to_linear(bright[::4, ::4]))
    low, high = 1e-4, 1.0
    for _ in range(12):
        middle = float(np.sqrt(low * high))
        model = CaptureModel(exposure=middle)
        dark = capture(light, model, view_key(model, 0)).mean()
        low, high = (middle, high) if dark < mean else (low, middle)
    return low


def darkened(bright: Picture, model: CaptureModel, quality: int) -> Sequence[Picture]:
    """Photos of the same pixels, through JPEG files unless ``quality`` is 0."""
    light = np.asarray(srgb_to_linear(bright))
    places = np.random.default_rng(0).integers(0, BLOCK, (PHOTOS, 2))
    photos = [capture(light, model, view_key(model, n)) for n in range(PHOTOS)]
    if not quality:
        return [(photo / 255.0).astype(np.float32) for photo in photos]
    pairs = zip(photos, places.tolist(), strict=True)
    return [through_jpeg(photo, top, left, quality) for photo, (top, left) in pairs]


def through_jpeg(
    photo: UInt8[np.ndarray, "height width 3"], top: int, left: int, quality: int
) -> Picture:
    """The photo as a JPEG shows it whose blocks begin so far outside of it."""
    height, width, _ = photo.shape
    around = ((top, BLOCK - top), (left, BLOCK - left), (0, 0))
    larger = np.pad(photo, around, mode="edge") / np.float32(255)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "photo.jpg"
        image_io.write(path, larger, jpeg_quality=quality)
        return image_io.read_srgb(path)[top : top + height, left : left + width]


def half(picture: Picture) -> Picture:
    height, width, _ = picture.shape
    return image_io.resize_area(picture, width // 2, height // 2)


def scores(lit: Picture, truth: Picture) -> tuple[str, ...]:
    luma = truth.mean(axis=-1)
    errors = 255.0 * (lit - truth)[luma < np.quantile(luma, DARKEST)]
    matched = metrics.exposure_matched(lit, truth)
    corrected = metrics.color_corrected(lit, truth)
    return (
        *(f"{metrics.psnr(x, truth):.2f}" for x in (lit, matched, corrected)),
        f"{metrics.ssim(matched, truth):.3f}",
        f"{np.sqrt(np.mean(errors**2)):.1f}",
        ", ".join(f"{x:+.1f}" for x in errors.mean(axis=0)),
    )


if __name__ == "__main__":
    main()
