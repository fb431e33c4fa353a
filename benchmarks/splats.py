# SPDX-License-Identifier: Apache-2.0
"""How much Gaussian splats look like the field they were baked from, at the test
views, which baking does not render, and how long baking takes.

python -m benchmarks.splats --run outputs/night [--counts 100000 300000]

Seconds are those of export.py's own steps for splats: rendering the views, placing,
fitting; compiling included.
"""

if __name__ == "__main__":  # before the imports: they would happen twice
    from internal import process

    process.restart_tuned()

import time
from typing import Any

import jax
import numpy as np

from internal import cli, flags, parallel
from internal.cameras import Cameras
from internal.export import folder as export_folder
from internal.export import rasterizer
from internal.export.bake import bake, targets_of
from internal.export.density import make_density
from internal.export.sightings import between_views, look_around, undistorted
from internal.rendering.renderer import Renderer
from internal.scoring.metrics import psnr
from internal.training.checkpoints import load_trained


def main() -> None:
    parser = flags.trained(__doc__)
    parser.add_argument("--counts", type=int, nargs="+", default=[100_000, 300_000])
    args = parser.parse_args()
    config = cli.start_trained(args)
    edit = config.render.edit()
    mesh = parallel.data_mesh(jax.device_count())
    model, state = load_trained(config, mesh)
    scene = undistorted(cli.load_split(config, "train"))
    held_out = undistorted(cli.load_split(config, "test"))
    resolution = export_folder.Wanted().resolution
    density = make_density(model, state.params, footprint=1.0 / resolution)
    renderer = Renderer(model, scene.cameras, scene.space, mesh, config.render.chunk)

    def render(camera: Cameras) -> Any:
        return renderer.picture(state.params, camera, edit)

    start = time.perf_counter()
    sightings = look_around(scene, render)
    between = look_around(between_views(scene), render)
    looking = time.perf_counter() - start
    unseen = look_around(held_out, render)

    for count in args.counts:
        start = time.perf_counter()
        baked = bake(scene, sightings, between, density, count, ("enhanced",))
        seconds = looking + time.perf_counter() - start
        splats = baked["enhanced"]
        scores = [
            [
                psnr(rasterizer.rasterize(splats, t.camera)[0].clip(0.0, 1.0), t.srgb)
                for t in targets_of(scene, views, "enhanced")
            ]
            for views in (sightings, unseen)
        ]
        own, test = (float(np.mean(score)) for score in scores)
        print(
            f"{scene.name}: {len(splats):,} splats, "
            f"{test:.2f} dB at {len(unseen)} test views, {own:.2f} dB at the photos', "
            f"{seconds:.0f} s ({looking:.0f} s of rendering)",
            flush=True,
        )


if __name__ == "__main__":
    main()
