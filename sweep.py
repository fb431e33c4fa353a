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

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from internal import configs
from internal.comparison.scored_run import scored_run
from internal.configs import Config
from internal.errors import UserError
from internal.files import atomic, image_io
from internal.files.listing import flat_pngs
from internal.launching import launch
from internal.pages import contact_sheet, pages, report, tables
from internal.pages.pages import Table
from internal.scoring import evaluation

Settings = tuple[list[str], list[str]]  # gin files, then bindings
PICTURES = ("input", "enhanced", "v", "r", "truth")


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
        write_comparison(folder, done)
    return launch.report_failures(runs)


def check_variants(variants: Sequence[tuple[str, Settings]]) -> None:
    """Refuses, before the first training, what would fail or be trained twice.

    Raises:
        UserError: a variant's settings are wrong, or two have one name or the same
            settings.
    """
    seen: dict[Config, str] = {}
    names: set[str] = set()
    for name, (files, bindings) in variants:
        if name in names:
            raise UserError(f"variant {name!r}: two are called so; rename one")
        names.add(name)
        try:
            config = configs.load_config(files, bindings)
        except UserError as error:
            raise UserError(f"variant {name!r}: {error}") from error
        config = dataclasses.replace(config, checkpoint_dir="")
        twin = seen.setdefault(config, name)
        if twin != name:
            raise UserError(
                f"variant {name!r}: its settings are those of {twin!r}, so both would "
                "train the same; take one of them out"
            )


def parse_variant(text: str) -> tuple[str, Settings]:
    """(name, (gin files, bindings)) of a variant in the command's words."""
    if text.endswith(".gin"):
        return Path(text).stem, ([text], [])
    name, colon, bindings = text.partition(":")
    if not colon or "/" in name or name.strip() in ("", ".", ".."):
        raise UserError(
            f"variant {text!r}: expected a .gin file or 'NAME: BINDING; BINDING'"
        )
    return name.strip(), ([], [binding.strip() for binding in bindings.split(";")])


def write_comparison(folder: Path, names: list[str]) -> None:
    """Writes table.md, table.csv (mean scores) and sheet.png (the first test view)."""
    results = {
        name: atomic.read_json(folder / name / "eval" / "metrics.json", "eval.py")
        for name in names
    }
    scores = {name: result["mean"] for name, result in results.items()}
    columns = [
        (picture, metric)
        for picture in ("enhanced", "dark")
        for metric in evaluation.DEFINITIONS
        if any(metric in row.get(picture, {}) for row in scores.values())
    ]
    headers = ("variant", *(f"{picture} {metric}" for picture, metric in columns))
    rows = tuple(
        (
            name,
            *(
                f"{row[picture][metric]:.3f}" if metric in row.get(picture, {}) else ""
                for picture, metric in columns
            ),
        )
        for name, row in scores.items()
    )
    table = tables.as_text(Table("", "", headers, rows))
    atomic.write_text(folder / "table.md", table + "\n")
    tables.write_csv(folder / "table.csv", [headers, *rows])

    view = flat_pngs(list(results[names[0]]["views"]))[0]
    files = [[folder / n / "eval" / p / view for p in PICTURES] for n in names]
    blank = image_io.read_srgb(files[0][0]) * 0.0
    pictures = [
        [image_io.read_srgb(file) if file.is_file() else blank for file in row]
        for row in files
    ]
    sheet = contact_sheet.contact_sheet(pictures, names, PICTURES)
    image_io.write(folder / "sheet.png", sheet)
    page = write_page(folder, names, Table("Scores", "Test views.", headers, rows))
    print(f"{table}\n{folder / 'table.md'}\n{folder / 'sheet.png'}\n{page}")


def write_page(folder: Path, names: list[str], scores: Table) -> Path:
    """Writes index.html: scores, any two pictures of a view, how variants trained."""
    evaluated = {name: folder / name / "eval" for name in names}
    media = {
        picture: report.pictures_in(folder, evaluated[names[0]] / picture)
        for picture in ("input", "truth")
    }
    for name, pictures in evaluated.items():
        for part in ("enhanced", *report.parts_in(pictures)):
            media[f"{name}: {part}"] = report.pictures_in(folder, pictures / part)
    return pages.write_index(
        folder,
        "Comparison of variants",
        "One scene, one change of the configuration per variant.",
        [
            scores,
            report.compare_outputs(media, f"{names[0]}: enhanced"),
            pages.Section("First test view", "", (("sheet.png", "all variants"),)),
            *report.training_curves(
                "Training", {name: folder / name for name in names}
            ),
            report.links_to_models("Models", folder, evaluated),
            report.this_command(),
        ],
    )


if __name__ == "__main__":
    script.run(main)
