# SPDX-License-Identifier: Apache-2.0
"""Runs a list of methods on a list of scenes and writes one table.

python compare.py LOM/buu LOM/chair --out outputs/comparison \
    --gin_bindings="Config.factor = 2"

Methods are the entries of photos.toml and models.toml in configs/methods, or of the
lists that --methods names: photos enhanced one by one, and models trained on photos.
Scenes need no truth, but have no scores without it. Writes index.html, table.md,
table.csv, table.tex and a folder of figures per scene. Run again, it does what is
missing: add a method or a scene, and the rest stays. A training that fails costs its
own rows only. --jobs 4 trains four at a time, --cluster slurm each in a job of its own.
"""

from internal import flags, script

if __name__ == "__main__":  # before the imports below, which take seconds
    script.begin(flags.compare(__doc__), computes=False)

from collections.abc import Sequence

from internal.comparison import figures, jobs, result_page, score_tables
from internal.comparison.methods import methods_for, read_methods
from internal.launching import launch


def main(argv: Sequence[str]) -> int:
    """Does the work that is missing, then writes tables, figures and the page."""
    args = flags.compare(__doc__).parse_args(argv)
    place = launch.place_for(args, args.out)
    methods = read_methods(args.methods)
    chosen = {scene: methods_for(methods, scene) for scene in args.scenes}
    todo = list(map(jobs.dark_photos, chosen))
    for scene, listed in chosen.items():
        todo += [jobs.job_of(scene, method) for method in listed]
    jobs.check_settings(todo, args.gin_bindings)
    jobs.open_comparison(args.out, args.scenes, args.gin_bindings)

    # Trainings come last: the rest of the table is there within minutes.
    todo = list(dict.fromkeys(todo))
    photos = [job for job in todo if not job.train]
    for index, job in enumerate(photos):
        print(f"== {index + 1} of {len(photos)}: {job}", flush=True)
        jobs.score_photos(args.out, job, args.gin_bindings)
        score_tables.write_tables(args.out, jobs.read_results(args.out, chosen))
    runs = [
        jobs.training(args.out, job, args.gin_bindings) for job in todo if job.train
    ]
    for _ in launch.carry_out(runs, place):
        score_tables.write_tables(args.out, jobs.read_results(args.out, chosen))

    results = jobs.read_results(args.out, chosen)
    drawn = [
        path
        for scene in chosen
        for path in figures.write_figures(
            args.out, scene, results[jobs.scene_name(scene)]
        )
    ]
    print(score_tables.write_tables(args.out, results))
    print(result_page.write_page(args.out, results, drawn))
    return launch.report_failures(runs)


if __name__ == "__main__":
    script.run(main)
