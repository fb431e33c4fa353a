# SPDX-License-Identifier: Apache-2.0
"""Does it help to leave blurred photos out, as prepare.py does?

python -m experiments.blur CAN OUT > table.md

CAN is a COLMAP scene of steady photos. Every third one is taken at half size; a third
of these, no test view among them, are moved along a line of 2 to 5 % of their height,
in linear light, and all are darkened to a tenth. Sharpness is measured at the scene's
own matches. A plain fast NeRF is trained on all photos, without those that prepare.py
would leave out, and, as the bound, on the same photos had none been moved; its test
views are scored against steady ones. Run again, it does what is missing.

Sharpness in a capture of a can on a table: 0.30 to 0.48 of the 8 photos that were
moved, which are left out; 0.75 to 1.28 of the 16 steady ones.
"""

import argparse
import itertools
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pycolmap
from jaxtyping import Float
from scipy import ndimage

from benchmarks import workload
from internal import color
from internal.files import image_io
from internal.night.capture import CaptureModel, capture, view_key
from internal.prepare import attempts, scene_files, sharpness
from internal.prepare.brighten import make_copy
from internal.scene import colmap
from internal.scene.transforms_file import View, write_single

EVERY = 3  # photo
SIZE_FACTOR = 2
TEST_EVERY = 5  # of those taken
LENGTHS = (0.02, 0.05)  # of a photo's height
MODEL = CaptureModel(exposure=0.1)
CONFIG = "configs/nerf_fast.gin"
BINDINGS = ("Config.factor = 4", "Train.max_steps = 700")
SCORES = ("psnr", "ssim", "lpips")
HEADERS = ("trained on", "photos", "moved among them", "PSNR", "SSIM", "LPIPS")

Picture = Float[np.ndarray, "height width 3"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", type=Path)
    parser.add_argument("out", type=Path)
    args = parser.parse_args()
    model = colmap.read_model(args.scene / "sparse/0")
    names = sorted(model.names)[::EVERY]
    tested = set(names[::TEST_EVERY])
    moved = _choose([name for name in names if name not in tested], len(names) // 3)
    steady, blurred = {}, {}
    for view, name in enumerate(names):
        srgb = image_io.read_srgb(args.scene / "images" / name)
        height, width = (side // SIZE_FACTOR for side in srgb.shape[:2])
        light = color.srgb_to_linear(image_io.resize_area(srgb, width, height))
        steady[name] = _dark(np.asarray(light), view)
        blurred[name] = steady[name]
        if name in moved:
            blurred[name] = _dark(move(np.asarray(light), *moved[name]), view)
    copies = [make_copy(p, attempts.WAYS[0].recipe)[..., 0] for p in blurred.values()]
    pixels = _matches(args.scene, names, copies[0].shape)
    relative = sharpness.against_overlapping(
        lambda view: copies[view], len(names), pixels
    )
    harmful = sharpness.find_harmful(relative, pixels, range(len(names)))
    left_out = {names[view] for view in harmful} - tested
    for name, sharp in sorted(zip(names, relative, strict=True), key=lambda x: x[1]):
        length = f"moved by {100 * moved[name][0]:.1f} %" if name in moved else "steady"
        done = "left out" if name in left_out else "kept"
        print(f"{name}: {sharp:.2f}, {length}, {done}", file=sys.stderr)
    ways = {
        "all photos": blurred,
        "without what prepare.py leaves out": {
            name: dark for name, dark in blurred.items() if name not in left_out
        },
        "the same photos, none moved": steady,
    }
    rows = []
    for number, (way, pictures) in enumerate(ways.items()):
        scene = args.out / f"scene_{number}"
        _write_scene(scene, model, pictures, tested)
        scores = _train(scene, args.out / f"run_{number}", model)
        hit = 0 if pictures is steady else len(pictures.keys() & moved.keys())
        shown = [f"{scores[name]:.3f}" for name in SCORES if name in scores]
        rows.append((way, str(len(pictures) - len(tested)), str(hit), *shown))
    print(workload.markdown(HEADERS, rows))


def move(light: Picture, length: float, angle: float) -> Picture:
    """What a camera takes that moves along a line, ``length`` of the height in all."""
    reach = length * light.shape[0] / 2
    steps = np.linspace(-reach, reach, int(reach) + 3)
    shifts = [(s * np.sin(angle), s * np.cos(angle), 0.0) for s in steps]
    seen = [ndimage.shift(light, s, order=1, mode="nearest") for s in shifts]
    return np.asarray(np.mean(seen, axis=0, dtype=np.float32))


def _choose(names: list[str], count: int) -> dict[str, tuple[float, float]]:
    """The length and angle of the motion of some photos."""
    rng = np.random.default_rng(0)
    chosen = rng.choice(names, count, replace=False).tolist()
    return {n: (rng.uniform(*LENGTHS), rng.uniform(0.0, np.pi)) for n in chosen}


def _dark(light: Picture, view: int) -> Picture:
    levels = capture(light, MODEL, view_key(MODEL, view))
    return np.asarray(color.quantize(levels / 255.0))


def _matches(
    scene: Path, names: list[str], shape: tuple[int, ...]
) -> dict[tuple[int, int], np.ndarray]:
    """The pixels of points that pairs of views both see, from the scene's tracks."""
    found = pycolmap.Reconstruction(str(scene / "sparse/0"))
    seen = {}
    for image in found.images.values():
        if image.name in names:
            camera = found.camera(image.camera_id)
            scale = np.array(shape[::-1]) / [camera.width, camera.height]
            points = (p for p in image.points2D if p.has_point3D())
            seen[names.index(image.name)] = {p.point3D_id: p.xy * scale for p in points}
    return {
        (i, j): np.array([[seen[i][point], seen[j][point]] for point in sorted(both)])
        for i, j in itertools.combinations(sorted(seen), 2)
        if (both := seen[i].keys() & seen[j].keys())
    }


def _write_scene(
    folder: Path, model: colmap.Reconstruction, dark: Mapping[str, Picture], test: set
) -> None:
    (folder / "images").mkdir(parents=True, exist_ok=True)
    views, held_out = [], []
    for name, picture in dark.items():
        file = f"images/{Path(name).stem}.png"
        image_io.write(folder / file, picture)
        place = model.names.index(name)
        lens = scene_files.in_opencv_terms(model.lenses[place])
        views.append(View(file, lens, model.camtoworlds[place]))
        if name in test:
            held_out.append(file)
    write_single(folder, views, test=held_out)


def _train(scene: Path, run: Path, model: colmap.Reconstruction) -> dict[str, float]:
    """Scores of the test views against the dark photos."""
    centres = model.camtoworlds[:, None, :, 3]
    depths = ((centres - model.points) * model.camtoworlds[:, None, :, 2]).sum(-1)
    near, far = np.percentile(depths[depths > 0.0], (0.5, 99.5))
    own = (f"Config.near = {0.8 * near}", f"Config.far = {1.2 * far}")
    data = f"Config.data_dir = {str(scene)!r}"
    scores = workload.scores(run, CONFIG, [data, *own, *BINDINGS])
    return scores["mean"]["dark"]


if __name__ == "__main__":
    main()
