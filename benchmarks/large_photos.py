# SPDX-License-Identifier: Apache-2.0
"""Peak memory and time of prepare.py on generated dark photos of 12 megapixels.

python -m benchmarks.large_photos OUT --photos 200

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
from internal import color, progress
from internal.files import image_io

PICTURES = 25  # different ones; beyond, each is used again
WIDTH, HEIGHT, FOCAL = 4000, 3000, 3800.0
TEXELS = 4096  # along a wall
WALL = 4.0  # its length; three walls meet in the origin
EXPOSURE = 0.05
BLOCK = 2  # pixels of one colour: copies for poses are smaller than that
TINT = np.array([1.0, 0.9, 0.8], np.float32)
NOISE = 2e-4  # of linear light


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--photos", type=int, required=True)
    flags = parser.parse_args()
    if not (flags.out / "photos").exists():
        write_photos(flags.out / "photos", flags.photos)
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
    print(workload.markdown(headers, [(flags.photos, f"{peak:.2f}", f"{seconds:.0f}")]))


def write_photos(folder: Path, photos: int) -> None:
    """Writes JPEG photos of a corner of a room, as one walks around in it.

    A picture that is used again gets some bytes behind it: the same file would be
    left out.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(0)
    walls = np.stack([_texture(rng) for _ in range(3)])
    count = min(photos, PICTURES)
    for view in progress.track(range(count), count, "rendering", "picture"):
        turn = (0.15 + 0.7 * view / count) * np.pi / 2
        height = 1.4 + 0.4 * np.sin(view)
        centre = np.array([3.8 * np.cos(turn), height, 3.8 * np.sin(turn)])
        light = _render(walls, centre)
        noisy = light + rng.normal(0.0, NOISE, light.shape)
        srgb = np.asarray(color.linear_to_srgb(np.clip(noisy, 0.0, 1.0)))
        large = srgb.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)
        path = folder / f"{view:03}.jpg"
        image_io.write(path, large[..., None] * TINT)
        for again in range(view + count, photos, count):
            again_path = folder / f"{again:03}.jpg"
            again_path.write_bytes(path.read_bytes() + bytes(again))


def _texture(rng: np.random.Generator) -> Float[np.ndarray, "texels texels"]:
    """Grey blots of all sizes, in [0, 1]."""
    blots = np.zeros((TEXELS, TEXELS), np.float32)
    for size in (512, 128, 32, 8, 2):
        coarse = rng.normal(size=(TEXELS // size,) * 2).astype(np.float32)
        blots += coarse.repeat(size, axis=0).repeat(size, axis=1)
    return np.clip(0.5 + 0.25 * blots, 0.02, 1.0)


def _render(
    walls: Float[np.ndarray, "walls texels texels"], centre: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "_rows _columns"]:
    """Linear light of a view into the corner, one value for each block of pixels."""
    back = centre - [0.6, 0.8, 0.6]
    back = back / np.linalg.norm(back)
    right = np.cross([0.0, 1.0, 0.0], back)
    right = right / np.linalg.norm(right)
    x = (np.arange(0, WIDTH, BLOCK, dtype=np.float32) - WIDTH / 2) / FOCAL
    y = (HEIGHT / 2 - np.arange(0, HEIGHT, BLOCK, dtype=np.float32))[:, None] / FOCAL
    up = np.cross(back, right)
    rays = [x * right[a] + y * up[a] - back[a] for a in range(3)]
    reach = [-centre[a] / np.minimum(rays[a], -1e-6) for a in range(3)]
    light = np.zeros((HEIGHT // BLOCK, WIDTH // BLOCK), np.float32)
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        hit = (reach[a] <= reach[b]) & (reach[a] <= reach[c])
        texels = [
            ((centre[e] + rays[e][hit] * reach[a][hit]) * (TEXELS / WALL)).astype(int)
            for e in (b, c)
        ]
        u, v = (texel % TEXELS for texel in texels)
        light[hit] = EXPOSURE * (0.7 + 0.1 * a) * walls[a][u, v]
    return light


if __name__ == "__main__":
    main()
