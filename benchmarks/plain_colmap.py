# SPDX-License-Identifier: Apache-2.0
"""COLMAP by itself, all options as they come: the baseline of docs/your_photos.md.

python -m benchmarks.plain_colmap PHOTOS SCENE

PHOTOS are taken as they are, by one camera; SCENE has their right poses.
"""

import argparse
import tempfile
import time
from pathlib import Path

import pycolmap

from internal.scene.pose_comparison import compare_scenes


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("photos", type=Path)
    parser.add_argument("scene", type=Path)
    flags = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = Path(folder)
        started = time.perf_counter()
        placed = find_cameras(flags.photos, found)
        seconds = time.perf_counter() - started
        print(f"{placed} photos placed, {seconds:.0f} seconds")
        if placed:
            print(compare_scenes(found, flags.scene))


def find_cameras(photos: Path, folder: Path) -> int:
    """Writes the largest model into ``folder``, as a scene; its number of photos."""
    database = folder / "database.db"
    one_camera = pycolmap.CameraMode.SINGLE
    pycolmap.extract_features(database, photos, camera_mode=one_camera)
    pycolmap.match_exhaustive(database)
    models = pycolmap.incremental_mapping(database, photos, folder)
    if not models:
        return 0
    largest = max(models.values(), key=lambda model: model.num_reg_images())
    (folder / "images").symlink_to(photos.resolve())
    (folder / "sparse").mkdir()
    largest.write_binary(str(folder / "sparse"))
    return largest.num_reg_images()


if __name__ == "__main__":
    main()
