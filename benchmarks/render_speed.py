# SPDX-License-Identifier: Apache-2.0
"""Rays per second of rendering with the fast field: enhanced colour alone, and all.

python -m benchmarks.render_speed DATA_DIR [--factor 2]

An untrained field costs what a trained one does: nothing is skipped.
"""

if __name__ == "__main__":  # before the imports: they would happen twice
    from internal import process

    process.restart_tuned()

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from benchmarks import workload
from internal import configs, parallel
from internal.cameras import Rays
from internal.coord import Space
from internal.enhancements.look import LightEdit
from internal.models import Model
from internal.rendering.renderer import Renderer
from internal.scene.config import SceneConfig
from internal.scene.scene import load_scene
from internal.structs import LitRendering
from internal.training.step import initial_state

REPEATS = 7


class Enhanced(Model):
    """The enhanced colour alone; the compiler drops what only the rest needs."""

    def __call__(self, rays: Rays, space: Space, edit: LightEdit) -> Any:
        rendering = super().__call__(rays, space, edit)
        assert isinstance(rendering, LitRendering)
        return jnp.asarray(rendering.enhanced)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data_dir", type=Path)
    parser.add_argument("--factor", type=int, default=2)
    parser.add_argument("--gin_configs", default=workload.FAST)
    flags = parser.parse_args()
    config = configs.load_config([flags.gin_configs], [])
    scene = load_scene(SceneConfig(str(flags.data_dir), factor=flags.factor), "test")
    mesh = parallel.data_mesh(1, jax.devices()[:1])
    params = initial_state(config, Model(config.model)).params
    lens = scene.lenses[0]
    rays = lens.width * lens.height
    rows, calls = [], []
    for model in (Enhanced(config.model), Model(config.model)):
        renderer = Renderer(
            model, scene.cameras, scene.space, mesh, config.render.chunk
        )
        calls.append(timed(renderer, params))
        rows.append([calls[-1]()])  # the first call compiles
    medians = workload.interleaved(calls, REPEATS)
    for row, label, seconds in zip(
        rows, ("enhanced", "all outputs"), medians, strict=True
    ):
        (compiling,) = row
        row[:] = [label, f"{rays / seconds:,.0f}", f"{seconds:.3f}", f"{compiling:.1f}"]
    size = f"s per {lens.width}x{lens.height} view"
    print(workload.markdown(("what", "rays / s", size, "first call, s"), rows))


def timed(renderer: Renderer, params: dict) -> Callable[[], float]:
    """Seconds of rendering the first view."""

    def run() -> float:
        started = time.perf_counter()
        jax.block_until_ready(renderer.view(params, 0))
        return time.perf_counter() - started

    return run


if __name__ == "__main__":
    main()
