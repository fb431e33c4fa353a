# SPDX-License-Identifier: Apache-2.0
"""How long the viewer takes to light its splats anew.

python -m benchmarks.recolor [--count 300000]

An untrained field costs what a trained one does.
"""

if __name__ == "__main__":  # before the imports: they would happen twice
    from internal import process

    process.restart_tuned()

import argparse
import statistics
import time

import numpy as np

from benchmarks import workload
from internal.configs import load_config
from internal.coord import Unbounded
from internal.enhancements.look import Look
from internal.export.splats import Splats
from internal.models import Model
from internal.training.step import initial_state
from internal.viewer.lit_splats import Baked, recolorer

CONFIGS = "configs/llnerf_best.gin", "configs/llnerf_fast.gin"
LOOKS = 9


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300_000)
    baked = Baked(splats(parser.parse_args().count), Look(), step=0)
    space = Unbounded(np.float32(0.1), np.float32(4.0))
    rows = []
    for name in CONFIGS:
        config = load_config([name], [])
        model = Model(config.model)
        params = initial_state(config, model).params
        started = time.perf_counter()
        recolor = recolorer(model, params, space, np.zeros((1, 3)), baked)
        recolor(Look())
        first = time.perf_counter() - started
        seconds = []
        for number in range(LOOKS):
            started = time.perf_counter()
            recolor(Look(exposure=0.1 * number))
            seconds.append(time.perf_counter() - started)
        rows.append((name, f"{first:.1f}", f"{statistics.median(seconds):.3f}"))
    print(workload.markdown(("field", "first look, s", "each further look, s"), rows))


def splats(count: int) -> Splats:
    """Gray ones, anywhere."""
    points = np.random.default_rng(0).uniform(-0.9, 0.9, (count, 3))
    return Splats(
        points.astype(np.float32),
        np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        np.full((count, 3), -5.0, np.float32),
        np.zeros(count, np.float32),
        np.zeros((count, 1, 3), np.float32),
    )


if __name__ == "__main__":
    main()
