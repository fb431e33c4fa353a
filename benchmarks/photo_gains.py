# SPDX-License-Identifier: Apache-2.0
"""Whether exposures.json helps: trainings with and without it, on photos as they are
and on photos of random exposure.

python -m benchmarks.photo_gains LOM/buu OUT

Photos to train on get up to a stop more or less light; test views keep theirs.
"""

import argparse
from pathlib import Path

import numpy as np
from jaxtyping import Float

from benchmarks import workload
from internal import color
from internal.files import image_io
from internal.prepare.pipeline import Inputs, prepare
from internal.prepare.scene_files import HOLDOUT
from internal.scene import readers
from internal.scene.gains import GAINS_FILE, load_gains
from internal.scene.pairing import find_truth_folder
from internal.scene.readers.base import SceneFiles

SHORT = (
    "Config.factor = 4",
    "Train.max_steps = 600",
    "Train.enhance_start = 500",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data_dir", type=Path, help="scene with normal-light truth")
    parser.add_argument("out", type=Path)
    flags = parser.parse_args()
    files = readers.read_files(flags.data_dir, "auto", "")
    truth = find_truth_folder(flags.data_dir, files.image_paths[0].parent)
    rows = []
    for spread in (1.0, 0.0):
        own = flags.out / f"stops{spread:g}"
        stops = random_stops(len(files.names), spread)
        if not (own / "photos").exists():
            write_photos(files, stops, own / "photos")
        prepare(Inputs(own / "photos", None, truth), own / "scene", overwrite=False)
        error = gain_error(own / "scene", stops)
        for wanted in (False, True):
            bindings = [
                *SHORT,
                f"Config.data_dir = {str(own / 'scene')!r}",
                f"Config.photo_gains = {wanted}",
            ]
            run = own / f"gains_{wanted}"
            mean = workload.scores(run, workload.FAST, bindings)["mean"]
            cells = workload.score_cells(mean)
            rows.append(
                (f"{spread:g}", "used" if wanted else "", f"{error:.3f}", *cells)
            )
    headers = ("stops", GAINS_FILE, "error, stops", *workload.SCORE_HEADERS)
    print(workload.markdown(headers, rows))


def random_stops(views: int, spread: float) -> Float[np.ndarray, " {views}"]:
    """Exposures of the views, of mean 0; 0 for those that ``prepare`` holds out."""
    stops = np.random.default_rng(0).uniform(-spread, spread, views)
    is_trained = np.arange(views) % HOLDOUT > 0
    return np.where(is_trained, stops - stops[is_trained].mean(), 0.0)


def write_photos(
    files: SceneFiles, stops: Float[np.ndarray, " views"], folder: Path
) -> None:
    """Writes each photo with so much more light, as 8-bit PNG."""
    folder.mkdir(parents=True)
    for path, more in zip(files.image_paths, stops.tolist(), strict=True):
        linear = np.asarray(color.srgb_to_linear(image_io.read_srgb(path)))
        srgb = color.quantize(color.linear_to_srgb(linear * 2.0**more))
        image_io.write(folder / f"{path.stem}.png", srgb)


def gain_error(scene: Path, stops: Float[np.ndarray, " views"]) -> float:
    """Largest difference of the estimated exposures from the right ones, stops."""
    paths = readers.read_files(scene, "auto", "").image_paths
    assert len(paths) == len(stops), "a photo has no pose"
    gains = load_gains(scene, paths)
    return float(np.abs(np.log2(gains).mean(axis=-1) - stops).max())


if __name__ == "__main__":
    main()
