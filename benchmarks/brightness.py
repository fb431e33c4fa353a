# SPDX-License-Identifier: Apache-2.0
"""One configuration at every light: a scene with 1, 1/2 and 1/4 of its light (again
rounded to 8 bits), and its normal-light photos.

python -m benchmarks.brightness DATA_DIR OUT [--factor 4] [--steps 1500]
"""

import argparse
from pathlib import Path

import numpy as np

from benchmarks import workload
from internal.color import linear_to_srgb, srgb_to_linear
from internal.files import image_io
from internal.scene import readers

LIGHTS = (1.0, 0.5, 0.25)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data_dir", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--factor", type=int, default=4)
    parser.add_argument("--steps", type=int, default=1500)
    flags = parser.parse_args()
    folders = {f"{light:g} of the light": darker(flags, light) for light in LIGHTS}
    folders["normal light"] = (flags.data_dir / "high").resolve()
    rows = []
    for label, images in folders.items():
        run = flags.out / label.replace(" ", "_").replace("/", "_")
        scores = train(flags, images, run)
        dark, gain = scores["dark"], scores.get("gain_to_mean", {})
        cells = [dark["psnr"], dark["ssim"], gain["psnr"], gain["ssim"]]
        rows.append((label, *(f"{cell:.3f}" for cell in cells)))
    headers = ("photos", "PSNR", "SSIM", "one gain, PSNR", "one gain, SSIM")
    print(workload.markdown(headers, rows))


def darker(flags: argparse.Namespace, light: float) -> Path:
    """The scene's input photos with a part of their light, in a folder of PNGs."""
    folder = (flags.out / f"photos_{light:g}").resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for path in readers.read_files(flags.data_dir, "auto", "").image_paths:
        linear = light * srgb_to_linear(image_io.read_srgb(path))
        image_io.write(folder / f"{path.stem}.png", np.asarray(linear_to_srgb(linear)))
    return folder


def train(flags: argparse.Namespace, images: Path, run: Path) -> dict:
    """Mean scores of the test views after a training on ``images``."""
    bindings = (
        f"Config.data_dir = {str(flags.data_dir)!r}",
        f"Config.images_dir = {str(images)!r}",
        f"Config.factor = {flags.factor}",
        f"Train.max_steps = {flags.steps}",
        f"Train.enhance_start = {round(0.85 * flags.steps)}",
    )
    return workload.scores(run, workload.FAST, bindings)["mean"]


if __name__ == "__main__":
    main()
