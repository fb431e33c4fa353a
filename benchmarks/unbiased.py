# SPDX-License-Identifier: Apache-2.0
"""Bias and error of the learned dark scene: the paper's data term against ours.

python -m benchmarks.unbiased night OUT [--cameras 10 30 60 60_noisy] [--steps 1500]
python -m benchmarks.unbiased real DATA_DIR OUT [--factor 2] [--steps 2000]

``night`` makes the synthetic scene as dark as 1/10, 1/30 and 1/60 and compares test
views with the light that fell in: as learned, and as the terms would have a field of
perfect geometry learn it (``--steps 0``: only that), from as many photos of each point.
``real`` compares them, after one gain to the truth's mean, with the truth where it is
darkest. A training that was done is not done again.
"""

import argparse
import functools
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float
from skimage.metrics import structural_similarity

from benchmarks import workload
from internal import cli, parallel
from internal.color import from_uint16, linear_to_srgb, srgb_to_linear
from internal.comparison import scored_run
from internal.night import dataset
from internal.night.capture import CaptureModel, capture, view_key
from internal.rendering.renderer import Renderer
from internal.scene.noise import NODES, estimate_noise, expectation
from internal.scene.scene import Scene
from internal.scoring import baselines
from internal.training.checkpoints import load_trained

TERMS = {"paper": "ideal", "unbiased": "noisy"}  # Losses.observation
DARKEST = 0.2  # part of the pixels
CAMERAS = {
    **{str(n): CaptureModel(exposure=1 / n) for n in (10, 30, 60)},
    "60_noisy": CaptureModel(exposure=1 / 60, full_well=2000.0, read_noise=5.0),
}
VIEWS, WIDTH, HEIGHT = 30, 160, 120
NIGHT_HEADERS = (
    "camera", "geometry", "data term",
    "bias R, G, B, levels", "of the darkest fifth", "10^-6 linear",
    "RMSE, levels", "of the darkest fifth", "10^-6 linear",
    "after the gain: bias, darkest fifth", "RMSE", "of the darkest fifth",
)  # fmt: skip
REAL_HEADERS = (
    "data term",
    "PSNR",
    "SSIM",
    "PSNR, darkest fifth",
    "SSIM",
    "bias R, G, B",
)
Pictures = Float[np.ndarray, "views height width 3"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    night = commands.add_parser("night")
    night.add_argument("out", type=Path)
    night.add_argument("--cameras", nargs="+", choices=CAMERAS, default=[*CAMERAS])
    night.add_argument("--steps", type=int, default=1500)
    real = commands.add_parser("real")
    real.add_argument("data_dir", type=Path)
    real.add_argument("out", type=Path)
    real.add_argument("--factor", type=int, default=2)
    real.add_argument("--steps", type=int, default=2000)
    flags = parser.parse_args()
    print(night_table(flags) if flags.command == "night" else real_table(flags))


def night_table(flags: argparse.Namespace) -> str:
    """Errors against the light that fell in, by camera, geometry and term."""
    rows = []
    for name in flags.cameras:
        camera = CAMERAS[name]
        light = test_light() * camera.exposure * np.array(camera.channel_gains)
        light = np.minimum(light, 1.0).astype(np.float32)
        pictures = {("perfect", x): y for x, y in perfect(camera).items()}
        folder = flags.out / f"night_{name}"
        for term in TERMS if flags.steps else ():
            dataset.write_scene(folder, camera, views=VIEWS, width=WIDTH, height=HEIGHT)
            run = flags.out / f"night_{name}_{term}"
            pictures["learned", term] = learned(folder, run, term, 1, flags.steps)[1]
        for (geometry, term), dark in pictures.items():
            cells = night_cells(dark, light, camera.exposure)
            rows.append((f"1/{name}".replace("_", ", "), geometry, term, *cells))
    return workload.markdown(NIGHT_HEADERS, rows)


def perfect(camera: CaptureModel) -> dict[str, Pictures]:
    """What each term learns of pixels that are seen once in every training photo.

    The paper's term the mean of their photos, ours the colour of which that mean is
    expected, by the noise that is found in these photos.
    """
    light = test_light()
    keys = [view_key(camera, view) for view in range(VIEWS - len(light))]
    photos = [capture(light, camera, key) / np.float32(255) for key in keys]
    found = estimate_noise([photo[v % len(light)] for v, photo in enumerate(photos)])
    mean = np.mean(photos, axis=0) * 255
    unbiased = np.empty_like(mean)
    for c, pair in enumerate(zip(found.floor, found.growth, strict=True)):
        unbiased[..., c] = np.interp(mean[..., c], expectation(*pair)[0], NODES)
    return {
        "paper": (mean / 255).astype(np.float32),
        "unbiased": unbiased.astype(np.float32),
    }


@functools.cache
def test_light() -> Pictures:
    """Linear light of the night scene's test views."""
    poses = dataset.make_cameras(VIEWS)[:: dataset.HOLDOUT]
    return dataset.render_views(poses, WIDTH, HEIGHT)


def night_cells(dark: Pictures, light: Pictures, exposure: float) -> list[str]:
    """Signed means and root mean squares of the errors of dark sRGB pictures."""
    linear = np.asarray(srgb_to_linear(dark))
    levels = 255 * (dark - np.asarray(linear_to_srgb(light)))
    lit = lit_up(linear, exposure) - lit_up(light, exposure)
    dim = darkest(light)
    return [
        bias(levels), bias(levels[dim]), bias(1e6 * (linear - light)[dim]),
        rms(levels), rms(levels[dim]), rms(1e6 * (linear - light)[dim]),
        bias(lit[dim]), rms(lit), rms(lit[dim]),
    ]  # fmt: skip


def lit_up(linear: Pictures, exposure: float) -> np.ndarray:
    """Levels after the gain that undoes the exposure."""
    return 255 * np.clip(np.asarray(linear_to_srgb(linear / exposure)), 0, 1)


def bias(errors: np.ndarray) -> str:
    """The mean of each channel."""
    means = errors.reshape(-1, 3).mean(axis=0)
    return ", ".join(f"{x:+.3g}" for x in means)


def rms(errors: np.ndarray) -> str:
    return f"{np.sqrt(np.mean(np.square(errors))):.3g}"


def real_table(flags: argparse.Namespace) -> str:
    """Scores of all pixels and of the darkest fifth of the truth, after one gain."""
    rows = []
    for term in TERMS:
        run = flags.out / term
        scene, dark = learned(flags.data_dir, run, term, flags.factor, flags.steps)
        truth = np.stack([from_uint16(picture) for picture in scene.truth.values()])
        pairs = list(zip(dark, truth, strict=True))
        lit = np.stack([baselines.gain_to_mean(x, float(y.mean())) for x, y in pairs])
        ssim = np.stack([similarity(x, y) for x, y in zip(lit, truth, strict=True)])
        dim = np.stack([darkest(y) for y in truth])
        cells = [psnr(lit - truth), f"{ssim.mean():.4f}"]
        cells += [psnr((lit - truth)[dim]), f"{ssim[dim].mean():.4f}"]
        rows.append((term, *cells, bias(255 * (lit - truth)[dim])))
    return workload.markdown(REAL_HEADERS, rows)


def psnr(errors: np.ndarray) -> str:
    return f"{-10 * np.log10(np.mean(np.square(errors))):.2f}"


def similarity(picture: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """SSIM of each pixel and channel, as ``metrics.ssim`` has it."""
    window = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    options = {"channel_axis": -1, "data_range": 1.0, "full": True}
    return structural_similarity(picture, truth, **window, **options)[1]


def darkest(pictures: Float[np.ndarray, "*b 3"]) -> np.ndarray:
    """Which pixels are of the darkest fifth, by the mean of their channels."""
    mean = pictures.mean(axis=-1)
    return mean <= np.quantile(mean, DARKEST)


def learned(
    data_dir: Path, run: Path, term: str, factor: int, steps: int
) -> tuple[Scene, Pictures]:
    """The test split and the dark pictures of its views, after a training."""
    bindings = [
        f"Config.data_dir = {str(data_dir)!r}",
        f"Config.factor = {factor}",
        f"Losses.observation = {TERMS[term]!r}",
        f"Train.max_steps = {steps}",
        f"Train.enhance_start = {steps - 100}",
    ]
    command = scored_run.command("train.py", run, [workload.FAST], bindings)
    code = subprocess.run(command).returncode
    if code:
        sys.exit(code)
    config = scored_run.config_of(run, [workload.FAST], bindings)
    mesh = parallel.data_mesh(jax.device_count())
    model, state = load_trained(config, mesh)
    scene = cli.load_split(config, "test")
    renderer = Renderer(model, scene.cameras, scene.space, mesh, config.render.chunk)
    views = range(len(scene.view_names))
    return scene, np.stack([renderer.view(state.params, v).rgb for v in views])


if __name__ == "__main__":
    main()
