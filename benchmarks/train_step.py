# SPDX-License-Identifier: Apache-2.0
"""Rays per second of training: the paper's model and the fast field, in turns.

python -m benchmarks.train_step DATA_DIR [--rounds 3] [--factor 1]

configs/llnerf.gin has the sizes of the authors' release (1024 pixels, each with two
neighbours, 256 samples per ray, 8x256 MLP) and stands for its work.
"""

if __name__ == "__main__":  # before the imports: they would happen twice
    from internal import process

    process.restart_tuned()

import argparse
import statistics

from benchmarks import workload

RELEASE_PIXELS, RELEASE_RAYS = 18.7, 56.0  # per second, the release itself, 2 cores


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data_dir")
    parser.add_argument("--factor", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=3)
    flags = parser.parse_args()
    factor = f"Config.factor = {flags.factor}"
    fast = workload.load(flags.data_dir, [workload.FAST], [factor])
    fast_memory = workload.peak_memory()
    faithful = workload.load(flags.data_dir, [workload.FAITHFUL], [factor])

    def median_of_fast() -> float:
        return statistics.median(fast.run() for _ in range(50))

    seconds = workload.interleaved([faithful.run, median_of_fast], flags.rounds)
    rows = []
    names = ("llnerf.gin", "llnerf_fast.gin")
    memories = (workload.peak_memory(), fast_memory)
    for name, work, time, memory in zip(
        names, (faithful, fast), seconds, memories, strict=True
    ):
        rays = work.rays / time
        # The release's patches are three rays, supervised by one pixel.
        rows.append(
            (
                name,
                f"{time:.3f}",
                f"{rays:,.0f}",
                f"{rays / RELEASE_RAYS:,.1f}",
                f"{rays / RELEASE_PIXELS:,.0f}",
                f"{work.compile_seconds:.1f}",
                f"{memory:.2f}",
            )
        )
    headers = (
        "config",
        "s / step",
        "rays / s",
        "over the release, rays",
        "over the release, supervised pixels",
        "compile, s",
        "peak memory so far, GB",
    )
    print(workload.markdown(headers, rows))
    print(f"fast over faithful, side by side: {seconds_ratio(faithful, fast, seconds)}")


def seconds_ratio(
    faithful: workload.Workload, fast: workload.Workload, seconds: list[float]
) -> str:
    """Rays per second of one over the other."""
    ratio = (fast.rays / seconds[1]) / (faithful.rays / seconds[0])
    return f"{ratio:,.0f} x in rays per second"


if __name__ == "__main__":
    main()
