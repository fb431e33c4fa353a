# SPDX-License-Identifier: Apache-2.0
"""What a wall-clock budget buys: trains and scores once per budget.

python -m benchmarks.time_to_quality DATA_DIR OUT --minutes 1 2 5 10 [--factor 2] \
    [--gin_bindings "Config.images_dir = 'high'"]
"""

import argparse
from pathlib import Path

from benchmarks import workload


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data_dir")
    parser.add_argument("out", type=Path)
    parser.add_argument("--minutes", type=float, nargs="+", required=True)
    parser.add_argument("--factor", type=int, default=1)
    parser.add_argument("--gin_configs", default=workload.FAST)
    parser.add_argument("--gin_bindings", nargs="*", default=[])
    flags = parser.parse_args()
    rows = []
    for minutes in flags.minutes:
        run = flags.out / f"factor{flags.factor}_{minutes:g}min"
        bindings = [
            f"Config.data_dir = {flags.data_dir!r}",
            f"Config.factor = {flags.factor}",
            f"Config.max_minutes = {minutes}",
            *flags.gin_bindings,
        ]
        scores = workload.scores(run, flags.gin_configs, bindings)
        cells = workload.score_cells(scores["mean"])
        rows.append((f"{minutes:g}", scores["step"], *cells))
        headers = ("minutes", "steps", *workload.SCORE_HEADERS)
        print(workload.markdown(headers, rows), flush=True)


if __name__ == "__main__":
    main()
