# SPDX-License-Identifier: Apache-2.0
"""Peak memory and time of training: a real scene, and generated ones of 100 and 500
photos that are larger than Config.max_image_memory and therefore stay on disk.

python -m benchmarks.memory DATA_DIR
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks import workload
from internal.cameras import Lens
from internal.files import image_io
from internal.scene.transforms_file import View, write_single

SIZE = (480, 640)  # height, width of a generated photo
LIMIT = 0.02  # GB of pictures that may lie in memory


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data_dir")
    flags = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        cases = [("real scene, full size", flags.data_dir, "4.0")]
        for photos in (100, 500):
            scene = Path(folder) / f"photos{photos}"
            write_scene(scene, photos)
            cases.append((f"{photos} photos, on disk", str(scene), str(LIMIT)))
        rows = []
        for index, (label, data_dir, limit) in enumerate(cases):
            run = Path(folder) / f"run{index}"
            peak = peak_of_training(data_dir, run, limit)
            last = (run / "metrics.jsonl").read_text().splitlines()[-1]
            rows.append((label, f"{peak:.2f}", f"{json.loads(last)['seconds']:.1f}"))
            print(rows[-1], file=sys.stderr, flush=True)
    headers = ("scene", "peak memory of train.py, GB", "300 steps, s")
    print(workload.markdown(headers, rows))


def peak_of_training(data_dir: str, run: Path, limit: str) -> float:
    """The most memory that 300 steps of training held, GB."""
    bindings = (
        f"Config.data_dir = {data_dir!r}",
        f"Config.checkpoint_dir = {str(run)!r}",
        f"Config.max_image_memory = {limit}",
        "Train.max_steps = 300",
        "Train.enhance_start = 200",
    )
    code = (
        "import sys, train; from benchmarks import workload;"
        "train.main(sys.argv[1:]); print(workload.peak_memory())"
    )
    arguments = [f"--gin_configs={workload.FAST}"]
    arguments += [f"--gin_bindings={binding}" for binding in bindings]
    command = [sys.executable, "-c", code, *arguments]
    output = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return float(output.stdout.splitlines()[-1])


def write_scene(folder: Path, photos: int) -> None:
    """Random dark photos on a circle around the origin, as transforms.json."""
    rng = np.random.default_rng(0)
    height, width = SIZE
    (folder / "images").mkdir(parents=True)
    lens = Lens("PINHOLE", width, height, (600.0, 600.0, width / 2, height / 2))
    views = []
    for index, angle in enumerate(np.linspace(0, 2 * np.pi, photos, endpoint=False)):
        name = f"images/{index:04d}.png"
        levels = rng.integers(0, 40, (height // 8, width // 8, 3)) / 255.0
        picture = np.kron(levels, np.ones((8, 8, 1))).astype(np.float32)
        image_io.write(folder / name, picture)
        cosine, sine = np.cos(angle), np.sin(angle)
        pose = np.eye(4)
        pose[:3, :3] = [[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]]
        pose[:3, 3] = 4.0 * pose[:3, 2]
        views.append(View(name, lens, pose[:3]))
    write_single(folder, views, bounds=(1.0, 10.0))


if __name__ == "__main__":
    main()
