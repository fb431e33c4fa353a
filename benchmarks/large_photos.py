# SPDX-License-Identifier: Apache-2.0
"""Peak memory and time of prepare.py on generated dark photos of 12 megapixels.

python -m benchmarks.large_photos OUT

Interrupted, the same command goes on; the peak is then of what was left to do.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from jaxtyping import Float

from benchmarks import workload
from internal import image, image_io, progress

PHOTOS = 200
WIDTH, HEIGHT, FOCAL = 4000, 3000, 3800.0
TEXELS = 4096  # along a wall
WALL = 4.0  # its length; three walls meet in the origin
EXPOSURE = 0.05
BLOCK = 2  # pixels of one colour: copies for poses are smaller than that
NOISE = 2e-4  # of linear light


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    flags = parser.parse_args()
    write_photos(flags.out / "photos")
    code = (
        "import sys, prepare; from benchmarks import workload;"
        "prepare.main(sys.argv[1:]); print(workload.peak_memory())"
    )
    arguments = [str(flags.out / name) for name in ("photos", "scene")]
    started = time.perf_counter()
    output = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    ).stdout
    seconds = time.perf_counter() - started
    peak = float(output.splitlines()[-1])
    print(output)
    headers = ("photos of 12 megapixels", "peak memory of prepare.py, GB", "seconds")
    print(workload.markdown(headers, [(PHOTOS, f"{peak:.2f}", f"{seconds:.0f}")]))


def write_photos(folder: Path) -> None:
    """Writes JPEG photos of a corner of a room, as one walks around in it."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(0)
    walls = np.stack([_texture(rng) for _ in range(3)])
    noise = rng.normal(0.0, NOISE, (HEIGHT, WIDTH)).astype(np.float32)
    for view in progress.track(range(PHOTOS), PHOTOS, "rendering", "photo"):
        path = folder / f"{view:04}.jpg"
        if not path.is_file():
            turn = (0.15 + 0.7 * view / PHOTOS) * np.pi / 2
            height = 1.4 + 0.4 * np.sin(0.3 * view)
            centre = np.array([3.8 * np.cos(turn), height, 3.8 * np.sin(turn)])
            light = _render(walls, centre) + np.roll(noise, 997 * view)[..., None]
            srgb = image.linear_to_srgb(np.clip(light, 0.0, 1.0))
            image_io.write(path, np.asarray(srgb))


def _texture(rng: np.random.Generator) -> Float[np.ndarray, "texels texels"]:
    """Grey blots of all sizes, in [0, 1]."""
    blots = np.zeros((TEXELS, TEXELS), np.float32)
    for size in (512, 128, 32, 8, 2):
        coarse = rng.normal(size=(TEXELS // size,) * 2).astype(np.float32)
        blots += coarse.repeat(size, axis=0).repeat(size, axis=1)
    return np.clip(0.5 + 0.25 * blots, 0.02, 1.0)


def _render(
    walls: Float[np.ndarray, "walls texels texels"], centre: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "height width 3"]:
    """Linear light of a view into the corner, in blocks of BLOCK pixels."""
    back = centre - [0.6, 0.8, 0.6]
    back = back / np.linalg.norm(back)
    right = np.cross([0.0, 1.0, 0.0], back)
    right = right / np.linalg.norm(right)
    x = (np.arange(0, WIDTH, BLOCK) - WIDTH / 2) / FOCAL
    y = (HEIGHT / 2 - np.arange(0, HEIGHT, BLOCK)) / FOCAL
    rays = x[:, None] * right + y[:, None, None] * np.cross(back, right) - back
    distances = np.float32(-centre) / np.minimum(rays.astype(np.float32), -1e-6)
    wall = distances.argmin(axis=-1)
    points = centre + rays * distances.min(axis=-1)[..., None]
    texel = (points * (TEXELS / WALL)).astype(np.int64) % TEXELS
    # On wall a, along the axes a + 1 and a + 2.
    u = np.take_along_axis(texel, ((wall + 1) % 3)[..., None], axis=-1)[..., 0]
    v = np.take_along_axis(texel, ((wall + 2) % 3)[..., None], axis=-1)[..., 0]
    light = EXPOSURE * walls[wall, u, v] * (0.7 + 0.1 * wall)
    grey = light.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1).astype(np.float32)
    return grey[..., None] * np.array([1.0, 0.8, 0.6], np.float32)


if __name__ == "__main__":
    main()
