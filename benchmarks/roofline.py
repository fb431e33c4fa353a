# SPDX-License-Identifier: Apache-2.0
"""Where a step of the fast field spends its time, and how far products are from peak.

python -m benchmarks.roofline DATA_DIR [--factor 1] [--enhanced]

Times of compiled operations are summed by the module they came from; the profiler
slows them down a little, so shares are what counts.
"""

if __name__ == "__main__":  # before the imports: they would happen twice
    from internal import process

    process.restart_tuned()

import argparse
import collections
import glob
import re
import tempfile
import time

import jax
import jax.numpy as jnp

from benchmarks import workload

STEPS = 10
# First match wins, on "operation name | where it came from".
PARTS = (
    ("table gradient (scatter)", r"scatter"),
    (
        "table gradient (its zeros)",
        r"broadcast_in_dim.*|.*_Encoding_0/broadcast_in_dim",
    ),
    ("optimiser", r"cond/branch|multiply_add_fusion"),
    ("proposal grids", r"/proposal/"),
    ("field grid", r"_Encoding_0"),
    ("MLP and heads", r"/field/|/enhancement/"),
    ("sampling, compositing, losses", r"jvp|march|light_up"),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data_dir")
    parser.add_argument("--factor", type=int, default=1)
    parser.add_argument("--enhanced", action="store_true", help="both phases")
    flags = parser.parse_args()
    bindings = [f"Config.factor = {flags.factor}"]
    bindings += ["Train.enhance_start = 0"] * flags.enhanced
    work = workload.load(flags.data_dir, [workload.FAST], bindings)
    for _ in range(STEPS):
        work.run()
    plain = min(work.run() for _ in range(STEPS))
    parts = by_part(profile(work), work.step.as_text())
    total = sum(parts.values())
    rows = [
        (name, f"{seconds * 1e3:.1f}", f"{100 * seconds / total:.0f} %")
        for name, seconds in parts.most_common()
    ]
    print(workload.markdown(("part", "ms of work", "share"), rows))
    print(f"\na step without the profiler: {1e3 * plain:.1f} ms")
    for m, k, n in ((2048, 2048, 2048), (work.rays * 16, 64, 64)):
        print(f"product {m} x {k} x {n}: {product_rate(m, k, n) / 1e9:.0f} GF/s")


def profile(work: workload.Workload) -> collections.Counter:
    """Seconds per step by compiled operation."""
    with tempfile.TemporaryDirectory() as folder:
        with jax.profiler.trace(folder):
            for _ in range(STEPS):
                work.run()
        (path,) = glob.glob(f"{folder}/**/*.xplane.pb", recursive=True)
        planes = jax.profiler.ProfileData.from_file(path).planes
        seconds: collections.Counter = collections.Counter()
        for plane in planes:
            for line in plane.lines:
                for event in line.events:
                    seconds[event.name] += event.duration_ns / 1e9 / STEPS
    return seconds


def by_part(seconds: collections.Counter, program: str) -> collections.Counter:
    """Sums operations by the first part of ``PARTS`` that their origin matches."""
    pattern = r'%?([\w.\-]+) = [^\n]*?metadata=\{[^}]*op_name="([^"]*)"'
    origins = dict(re.findall(pattern, program))
    operations = set(re.findall(r"%?([\w.\-]+) = ", program))
    parts: collections.Counter = collections.Counter()
    for name, spent in seconds.items():
        if name in operations:
            text = f"{name} | {origins.get(name, '')}"
            named = (part for part, matches in PARTS if re.search(matches, text))
            parts[next(named, "copies and other")] += spent
    return parts


def product_rate(m: int, k: int, n: int) -> float:
    """Floating-point operations per second of one matrix product."""
    multiply = jax.jit(jnp.dot)
    a, b = jnp.ones((m, k)), jnp.ones((k, n))
    multiply(a, b).block_until_ready()
    best = float("inf")
    for _ in range(10):
        started = time.perf_counter()
        multiply(a, b).block_until_ready()
        best = min(best, time.perf_counter() - started)
    return 2.0 * m * k * n / best


if __name__ == "__main__":
    main()
