# SPDX-License-Identifier: Apache-2.0
"""The page of a comparison: tables, any two pictures of a view, how models trained."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from internal.comparison import jobs, score_tables
from internal.comparison.jobs import Result, Results
from internal.pages import pages, parts


def write_page(out: Path, results: Results, figures: Sequence[Path]) -> Path:
    """Writes ``index.html`` into the folder of the comparison.

    Args:
        figures: pictures below ``out`` that show methods side by side.
    """
    figure_media = tuple(
        (path.relative_to(out).as_posix(), f"{path.parent.name}: {path.stem}")
        for path in figures
    )
    scenes = jobs.scenes_of(out)
    media = slider_media(out, {scenes[name]: rows for name, rows in results.items()})
    methods = [name for rows in results.values() for name in rows]
    settings = (out / jobs.RECORD).read_text()
    return pages.write_index(
        out,
        "Comparison of methods",
        score_tables.TEXT,
        [
            *score_tables.tables(results),
            parts.compare_outputs(media, methods[-1] if methods else "input"),
            pages.Section("Figures", "The first test view of a scene.", figure_media),
            *(
                part
                for scene, rows in results.items()
                for part in _trainings(out, scene, rows)
            ),
            parts.this_command(),
            pages.Verbatim("Scenes and bindings", "Of all trainings.", settings),
        ],
    )


def slider_media(
    out: Path, results: Mapping[Path, Mapping[str, Result]]
) -> dict[str, list[tuple[str, str]]]:
    """By output, the pictures of all test views: (path below ``out``, view).

    Input and truth, what every method is scored by, then the parts of models.
    """
    media: dict[str, list[tuple[str, str]]] = {}
    for data_dir, rows in results.items():
        photos = jobs.read_result(out, jobs.dark_photos(data_dir), "")
        shown = {"input": (photos, "unchanged"), "truth": (photos, "truth")}
        shown |= {name: (row, row.output) for name, row in rows.items()}
        shown |= {
            f"{name}: {part}": (row, part)
            for name, row in rows.items()
            for part in parts.parts_in(out / row.folder)
        }
        for output, (result, kind) in shown.items():
            folder = result.pictures(out, kind)
            before = f"{jobs.scene_name(data_dir)}: "
            media.setdefault(output, []).extend(parts.pictures_in(out, folder, before))
    return {output: listed for output, listed in media.items() if listed}


def _trainings(out: Path, scene: str, rows: Mapping[str, Result]) -> list[pages.Part]:
    """Curves of a scene's models, and links to their own pages."""
    models = {name: out / row.folder for name, row in rows.items() if row.trained}
    if not models:
        return []
    runs = {name: folder.parent for name, folder in models.items()}
    return [
        *parts.training_curves(f"Training on {scene}", runs),
        parts.links_to_models(f"Models of {scene}", out, models),
    ]
