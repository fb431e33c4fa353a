# SPDX-License-Identifier: Apache-2.0
"""Trains and scores variants of a configuration on one scene, and compares them.

python sweep.py --gin_configs=configs/llnerf_fast.gin --scene my_scene \
    --run outputs/ablation --variants configs/ablations/*.gin "g=0.2: Gamma.gray = 0.2"

A variant is a gin file, or a label, a colon and bindings with ; between them. Each
trains in a folder of its name in that of --run, on top of the flags; the flags alone
are the variant "full". Writes index.html, table.md, table.csv and sheet.png. Run again,
it does what is missing. A variant that fails costs its own row only. --jobs 4 trains
four at a time, --cluster slurm each in a job of its own.
"""

from internal import flags, script

if __name__ == "__main__":  # before the imports below, which take seconds
    script.begin(flags.sweep(__doc__), computes=False)

from collections.abc import Sequence
from pathlib import Path

from internal import configs
from internal.comparison.scored_run import scored_run
from internal.comparison.variant_results import write_results
from internal.comparison.variants import check_variants, parse_variant
from internal.errors import UserError
from internal.launching import launch


def main(argv: Sequence[str]) -> int:
    """Runs what is missing, then writes the table and the sheet."""
    args = flags.sweep(__doc__).parse_args(argv)
    named = configs.bound("Config.checkpoint_dir", args.gin_configs, args.gin_bindings)
    if not named:
        raise UserError("no folder for the results is named; give one: --run outputs/x")
    folder = Path(named)
    variants = [
        (name, ([*args.gin_configs, *files], [*args.gin_bindings, *bindings]))
        for name, (files, bindings) in [
            ("full", ([], [])), *map(parse_variant, args.variants)
        ]
    ]  # fmt: skip
    check_variants(variants)
    runs = [
        scored_run(name, folder / name, files, bindings)
        for name, (files, bindings) in variants
    ]
    for _ in launch.carry_out(runs, launch.place_for(args, folder)):
        pass
    done = [run.name for run in runs if run.is_done()]
    if done:
        write_results(folder, done)
    return launch.report_failures(runs)


if __name__ == "__main__":
    script.run(main)
