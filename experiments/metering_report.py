# SPDX-License-Identifier: Apache-2.0
"""What the frozen metering makes of pictures it was not fitted to.

python -m experiments.metering_report pairs OUT_FOLDER   # each pair, from other pairs
python -m experiments.metering_report lom
python -m experiments.metering_report darkened           # fern, mug and can

Each prints Markdown. One exposure per scene, pictures developed in 2-D. Candidates are
those ``python -m experiments.metering fit`` froze; none may be chosen by these tables.
"""

import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
from benchmarks.darkened import shrunk
from benchmarks.tone import Variant, light, meter
from internal.baselines import gain_to_mean
from internal.capture import CaptureModel, capture, view_key
from jaxtyping import Float

from benchmarks.workload import markdown
from experiments import captures, colour
from experiments.metering import FROZEN, LEFT_OUT, SHIPPED, STOPS
from internal import image_io, metrics
from internal.color import linear_to_srgb, photo_to_linear, quantize
from internal.enhancements.metering import developed, prior_of
from internal.enhancements.metering import meter as metered

PHOTOS = 8  # of a scene
FEW = 3  # of one that is to be darkened
SSIM_EVERY = 4  # of them: it is slow
STRIDE = 8  # pixels between metered ones
LEVELS = (30, 8, 4, 2)
CANDIDATES = (
    "same mean for all",
    "kernel, ordinary photos only",
    SHIPPED,
    "kernel, pairs 1",
    "Naka-Rushton, n 1.3",
    "n 1.1, k 3",
    "straight line",
)

LOOKS = {"saturation 0.9": colour.saturated(0.9), "on luminance": colour.luminance}

Picture = Float[np.ndarray, "height width 3"]


@dataclasses.dataclass(frozen=True)
class Scene:
    name: str
    dark: list[Picture]
    truth: list[Picture]

    def pixels(self, pictures: list[Picture]) -> Float[np.ndarray, "n 3"]:
        return np.concatenate([x[::STRIDE, ::STRIDE].reshape(-1, 3) for x in pictures])


def some(files: list[Path], count: int) -> list[Path]:
    return files[:: max(len(files) // count, 1)][:count]


def lom() -> list[Scene]:
    scenes = []
    for name in ("buu", "chair", "shrub"):
        folder = captures.data() / "lom" / name
        files = [x for x in sorted((folder / "low").iterdir()) if image_io.is_image(x)]
        files = some([x for x in files if (folder / "high" / x.name).exists()], PHOTOS)
        dark = [image_io.read_srgb(x) for x in files]
        truth = [image_io.read_srgb(folder / "high" / x.name) for x in files]
        scenes.append(Scene(name, dark, truth))
    return scenes


def darkened() -> list[Scene]:
    """Normal-light scenes at every level; shrunk photos stand in for the field."""
    scenes = []
    for name in ("llff/fern/images_8", "orbit/mug", "orbit/can"):
        folder = captures.data() / name
        if (folder / "images").is_dir():
            folder = folder / "images"
        files = [x for x in sorted(folder.iterdir()) if image_io.is_image(x)]
        photos = [photo_to_linear(image_io.read_srgb(x)) for x in some(files, FEW)]
        truth = [quantize(linear_to_srgb(shrunk(x))) for x in photos]
        for level in LEVELS:
            exposure = captures.exposure_for(np.stack(photos)[:, ::4, ::4], level)
            camera = CaptureModel(exposure=exposure)
            dark = [seen(x, camera, i) for i, x in enumerate(photos)]
            scenes.append(Scene(f"{name.split('/')[1]}, mean {level}", dark, truth))
    return scenes


def seen(linear_rgb: Picture, camera: CaptureModel, view: int) -> Picture:
    photo = capture(linear_rgb, camera, view_key(camera, view)) / 255.0
    return np.asarray(linear_to_srgb(shrunk(photo_to_linear(photo))))


def best_stops(scene: Scene, contrast: float, shoulder: float) -> float:
    """The one exposure of least error over the scene, chosen with the truth."""
    light, truth = photo_to_linear(scene.pixels(scene.dark)), scene.pixels(scene.truth)
    curves = (developed(light, stops, contrast, shoulder) for stops in STOPS)
    return float(STOPS[np.argmin([np.mean((x - truth) ** 2) for x in curves])])


def scores(pictures: list[Picture], truth: list[Picture]) -> tuple[float, float]:
    pairs = list(zip(pictures, truth, strict=True))
    psnr = np.mean([metrics.psnr(*pair) for pair in pairs])
    sharp = [metrics.ssim(*pair) for pair in pairs[::SSIM_EVERY]]
    return float(psnr), float(np.mean(sharp))


def before(dark: list[Picture], pixels: Float[np.ndarray, "n 3"]):
    """The look shipped before, and its stops."""
    found = meter(Variant(), pixels)
    return [np.asarray(light(Variant(), *found, x)) for x in dark], found[2]


def whole(look: colour.Way, exposed: Picture) -> Picture:
    return look(exposed.reshape(-1, 3)).reshape(exposed.shape)


def report(scenes: list[Scene]) -> None:
    frozen = json.loads(FROZEN.read_text())
    priors = {name: prior_of(frozen[name]) for name in CANDIDATES}
    errors: dict[str, list[float]] = {}
    rows = []
    for scene in scenes:
        pixels = scene.pixels(scene.dark)
        curves = {(p.contrast, p.shoulder) for p in priors.values()}
        best = {curve: best_stops(scene, *curve) for curve in curves}
        old, stops = before(scene.dark, pixels)
        errors.setdefault("shipped before", []).append(stops - best[1.3, 1.0])
        cells = {
            "one gain to mean 0.5": [np.asarray(gain_to_mean(x)) for x in scene.dark]
        }
        cells["shipped before"] = old
        for name, prior in priors.items():
            exposure = metered(pixels, prior)
            curve = prior.contrast, prior.shoulder
            errors.setdefault(name, []).append(exposure.stops - best[curve])
            exposed = [photo_to_linear(x) * 2.0**exposure.stops for x in scene.dark]
            cells[name] = [developed(x, 0.0, *curve) for x in exposed]
            if name == SHIPPED:
                for way, look in LOOKS.items():
                    cells[f"{name}; {way}"] = [whole(look, x) for x in exposed]
        for name, pictures in cells.items():
            known = name.split(";")[0]
            error = f"{errors[known][-1]:+.2f}" if known in errors else ""
            psnr, ssim = scores(pictures, scene.truth)
            rows.append((scene.name, name, error, f"{psnr:.2f}", f"{ssim:.3f}"))
            print(rows[-1], flush=True)
    print(markdown(("scene", "rule", "error, stops", "PSNR", "SSIM"), rows))
    summary = []
    for name, error in errors.items():
        rms = np.sqrt(np.mean(np.square(error)))
        summary.append((name, f"{rms:.2f}", f"{np.abs(error).max():.2f}"))
    print(markdown(("rule", "RMS, stops", "worst"), summary))


def pairs(out: Path) -> None:
    left_out = json.loads(LEFT_OUT.read_text())
    prior = prior_of(left_out["prior"])
    table = []
    for files, stops in zip(captures.pair_files(), left_out["stops"], strict=True):
        dark, truth = (image_io.read_srgb(x) for x in files)
        old, _ = before([dark], dark[::2, ::2].reshape(-1, 3))
        new = developed(photo_to_linear(dark), stops, prior.contrast, prior.shoulder)
        looks = [np.asarray(gain_to_mean(dark)), old[0], new]
        table.append((files[0].stem, *(scores([x], [truth]) for x in looks)))
        strip = np.concatenate([*looks, truth], axis=1)
        image_io.write(out / f"{files[0].stem}.png", strip)
    print_pairs(table)


def print_pairs(table: list) -> None:
    table.sort(key=lambda x: x[3][0] - x[1][0])
    headers = ("pair", "gain to 0.5", "shipped before", "new")
    cells = [(n, *(f"{p:.2f} / {s:.3f}" for p, s in x)) for n, *x in table]
    means = [np.mean([x[i] for x in table], axis=0) for i in (1, 2, 3)]
    cells.insert(0, ("mean", *(f"{p:.2f} / {s:.3f}" for p, s in means)))
    print(markdown(headers, cells))
    for i, name in ((2, "shipped before"), (3, "new")):
        lost = [x[0] for x in table if x[i][1] < x[1][1]]
        dim = [x[0] for x in table if x[i][0] < x[1][0] - 0.3]
        print(
            f"{name}: SSIM below the gain's in {len(lost)}, PSNR in {len(dim)}: {dim}"
        )


if __name__ == "__main__":
    if sys.argv[1] == "pairs":
        Path(sys.argv[2]).mkdir(parents=True, exist_ok=True)
        pairs(Path(sys.argv[2]))
    else:
        report({"lom": lom, "darkened": darkened}[sys.argv[1]]())
