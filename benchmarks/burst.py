# SPDX-License-Identifier: Apache-2.0
"""Whether averaging a burst helps: cameras found in darkened photos of a scene.

A burst is simulated: several captures of each photo, different in noise alone, whose
linear light is averaged before ``prepare`` makes its copy for poses.

python -m benchmarks.burst LOM/chair OUT --light 0.125 --frames 1 4
"""

import argparse
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float

from benchmarks import workload
from internal import color
from internal.files import image_io
from internal.night.capture import CaptureModel, capture, view_key
from internal.prepare import attempts, mapping
from internal.prepare.brighten import copy_size
from internal.prepare.matching import Copy
from internal.scene import readers
from internal.scene.pose_comparison import compare_poses
from internal.scene.readers.base import SceneFiles

HEADERS = ("frames", "copies", "placed", "rotation, degrees", "centre, %")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data_dir", type=Path, help="scene with poses to compare with")
    parser.add_argument("out", type=Path)
    parser.add_argument("--light", type=float, required=True, help="of the photos'")
    parser.add_argument("--frames", type=int, nargs="+", required=True)
    flags = parser.parse_args()
    files = readers.read_files(flags.data_dir, "auto", "")
    model = CaptureModel(exposure=flags.light, channel_gains=(1.0, 1.0, 1.0))
    rows = [
        find_cameras(files, model, frames, flags.out / f"frames{frames}")
        for frames in flags.frames
    ]
    print(workload.markdown(HEADERS, rows))


def find_cameras(
    files: SceneFiles, model: CaptureModel, frames: int, work: Path
) -> tuple[str, ...]:
    """Tries the first way alone; a row of the table."""
    copies = [
        Copy(*copy_size(lens.width, lens.height), "one", 0.0) for lens in files.lenses
    ]
    ways = attempts.WAYS[:1]

    def read(view: int) -> Float[np.ndarray, "_height _width 3"]:
        return burst_mean(files.image_paths[view], model, view, frames)

    best = attempts.try_ways(ways, copies, read, work)[0]
    label = (f"{frames}", best.way.name, f"{best.registered} of {len(copies)}")
    if not best.models:
        return (*label, "", "")
    found = best.models[0]
    reference = files.camtoworlds[list(found.views)]
    difference = compare_poses(mapping.camera_poses(found), reference)
    turned, moved = np.median(difference.rotations), np.median(difference.centres)
    return (*label, f"{turned:.2f}", f"{100.0 * moved:.2f}")


def burst_mean(
    path: Path, model: CaptureModel, view: int, frames: int
) -> Float[np.ndarray, "_height _width 3"]:
    """sRGB of the mean light of captures of one picture."""
    light = color.srgb_to_linear(image_io.read_srgb(path))
    keys = jax.random.split(view_key(model, view), frames)
    captured = [color.srgb_to_linear(capture(light, model, k) / 255.0) for k in keys]
    return np.asarray(color.linear_to_srgb(np.mean(captured, axis=0)))


if __name__ == "__main__":
    main()
