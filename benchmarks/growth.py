# SPDX-License-Identifier: Apache-2.0
"""How a step's time grows with rays, samples and cores (photos: benchmarks.memory).

python -m benchmarks.growth DATA_DIR [--factor 2]

Each row is a process of its own, so that cores and devices can be limited.
"""

if __name__ == "__main__":  # before the imports: they would happen twice
    from internal import process

    process.restart_tuned()

import argparse
import json
import os
import statistics
import subprocess
import sys

from benchmarks import workload

CASES = (  # label, cores, devices, bindings
    ("as shipped", 2, 1, ()),
    ("one core", 1, 1, ()),
    ("half the rays", 2, 1, ("Train.batch_size = 176",)),
    ("twice the rays", 2, 1, ("Train.batch_size = 704",)),
    ("half the samples", 2, 1, ("Model.num_samples = (24, 8)",)),
    ("twice the samples", 2, 1, ("Model.num_samples = (96, 32)",)),
    ("2 devices on the same cores", 2, 2, ()),
    ("4 devices on the same cores", 2, 4, ()),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data_dir")
    parser.add_argument("--factor", type=int, default=2)
    parser.add_argument("--case", type=int, default=-1, help=argparse.SUPPRESS)
    flags = parser.parse_args()
    if flags.case >= 0:
        measure(flags.data_dir, flags.factor, flags.case)
        return
    results = []
    for case in range(len(CASES)):
        command = [sys.executable, "-m", "benchmarks.growth", *sys.argv[1:]]
        command += ["--case", str(case)]
        environment = dict(os.environ, JAX_NUM_CPU_DEVICES=str(CASES[case][2]))
        output = subprocess.run(
            command, check=True, capture_output=True, text=True, env=environment
        ).stdout
        results.append(json.loads(output.splitlines()[-1]))
        print(f"{CASES[case][0]}: {results[-1]}", file=sys.stderr, flush=True)
    first = results[0]["seconds"]
    rows = [
        (
            label,
            f"{1e3 * result['seconds']:.1f}",
            f"{result['seconds'] / first:.2f}",
            f"{result['loss']:.6f}",
        )
        for (label, *_), result in zip(CASES, results, strict=True)
    ]
    print(workload.markdown(("case", "ms / step", "ratio", "loss at the end"), rows))


def measure(data_dir: str, factor: int, case: int) -> None:
    """One case: prints the median step time and the data loss after all steps."""
    _, cores, devices, bindings = CASES[case]
    os.sched_setaffinity(0, range(cores))
    work = workload.load(
        data_dir, [workload.FAST], [f"Config.factor = {factor}", *bindings], devices
    )
    seconds = [work.run() for _ in range(60)][10:]
    _, stats = work.step(work.state, *work.arguments)
    loss = float(stats.terms["data"])
    print(json.dumps({"seconds": statistics.median(seconds), "loss": loss}))


if __name__ == "__main__":
    main()
