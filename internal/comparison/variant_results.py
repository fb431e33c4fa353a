# SPDX-License-Identifier: Apache-2.0
"""What sweep.py writes: its variants in one table, one picture and one page."""

from pathlib import Path

from internal.files import atomic, image_io
from internal.files.listing import flat_pngs
from internal.pages import contact_sheet, pages, parts, tables
from internal.pages.pages import Table
from internal.scoring import evaluation

PICTURES = ("input", "enhanced", "v", "r", "truth")


def write_results(folder: Path, names: list[str]) -> None:
    """Writes table.md and table.csv (mean scores), sheet.png (the first test view) and
    index.html, and prints the table.

    Args:
        folder: holds a run's folder by the name of each variant, evaluated.
        names: of variants; the first is what the others vary.
    """
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
    table = tables.as_markdown(Table("", "", headers, rows))
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
    page = _write_page(folder, names, Table("Scores", "Test views.", headers, rows))
    print(f"{table}\n{folder / 'table.md'}\n{folder / 'sheet.png'}\n{page}")


def _write_page(folder: Path, names: list[str], scores: Table) -> Path:
    """Writes index.html: scores, any two pictures of a view, how variants trained."""
    evaluated = {name: folder / name / "eval" for name in names}
    media = {
        picture: parts.pictures_in(folder, evaluated[names[0]] / picture)
        for picture in ("input", "truth")
    }
    for name, pictures in evaluated.items():
        for part in ("enhanced", *parts.parts_in(pictures)):
            media[f"{name}: {part}"] = parts.pictures_in(folder, pictures / part)
    return pages.write_index(
        folder,
        "Comparison of variants",
        "One scene, one change of the configuration per variant.",
        [
            scores,
            parts.compare_outputs(media, f"{names[0]}: enhanced"),
            pages.Section("First test view", "", (("sheet.png", "all variants"),)),
            *parts.training_curves("Training", {name: folder / name for name in names}),
            parts.links_to_models("Models", folder, evaluated),
            parts.this_command(),
        ],
    )
