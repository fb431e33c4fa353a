# SPDX-License-Identifier: Apache-2.0
"""The parts of a result page that explain where its numbers and pictures come from."""

import shlex
import sys
import urllib.parse
from collections.abc import Mapping, Sequence
from pathlib import Path

from internal.configs import ModelConfig
from internal.files import templates
from internal.pages import charts, pages
from internal.rendering import evidence
from internal.scoring import evaluation
from internal.training import run_folder

NOT_CURVES = frozenset(["step", "seconds"])

Media = Mapping[str, Sequence[tuple[str, str]]]  # by output: (path, view)


def compare_outputs(media: Media, right: str) -> pages.Markup:
    """A slider between any two outputs of any view: input and ``right`` at first."""
    urls: dict[str, dict[str, str]] = {}  # by view, then output
    order = ("input", right, "truth")
    outputs = sorted(media, key=lambda o: (*order, o).index(o))
    for output in outputs:
        for path, view in media[output]:
            urls.setdefault(view, {})[output] = urllib.parse.quote(path)
    html = templates.fill(
        pages.ASSETS / "slider.html", urls=urls, outputs=outputs, left="input",
        right=right,
    )  # fmt: skip
    text = "Drag the border. Each side can show any output."
    return pages.Markup("Compare", text, html)


def about_masks(masked: Mapping[str, float], views: int) -> str:
    """What to know of masks in pictures and scores; "" where nothing is masked.

    Args:
        masked: the masked part of each of ``views`` of which anything is.
    """
    if not masked:
        return ""
    whole = [name for name, part in masked.items() if part == 1.0]
    text = (
        f" Hatched pixels of photo and truth ({100 * sum(masked.values()) / views:.1f} "
        "% on average) are masked: they are in no score."
    )
    none = f" Masked as a whole, without scores: {', '.join(whole)}."
    return text + (none if whole else "")


def evidence_legend() -> pages.Markup:
    """The meaning of the false colours of evidence."""
    return pages.Markup(
        "Evidence: the colours",
        "A step of light is what the photos that saw a place just tell apart, all "
        "together: the level of the dark picture, times the square root of their "
        "number, over the noise of one. White balance and exposure lift noise alike.",
        evidence.legend_html(),
    )


def explained_pictures(model: ModelConfig) -> dict[str, str]:
    """What each folder of pictures of eval.py shows."""
    return {
        **evidence.explained_outputs(model),
        **{name: text for name, (_, text) in evaluation.BASELINES.items()},
        "input": "the dark photo",
        "truth": "the normal-light photo",
    }


def parts_in(evaluated: Path) -> tuple[str, ...]:
    """The outputs of eval.py that explain a model: all but the whole pictures."""
    whole = {"enhanced", "dark", "input", "truth", *evaluation.BASELINES}
    folders = sorted(path.name for path in evaluated.glob("*/"))
    return tuple(name for name in folders if name not in whole)


def pictures_in(root: Path, folder: Path, before: str = "") -> list[tuple[str, str]]:
    """The PNGs of a folder below ``root``: (path, view with ``before`` its name)."""
    return [
        (path.relative_to(root).as_posix(), before + path.stem)
        for path in sorted(folder.glob("*.png"))
    ]


def training_parts(run: Path) -> list[pages.Part]:
    """Curves, command and configuration of a run, as far as its folder holds them."""
    parts: list[pages.Part] = [*training_curves("Training", {"": run})]
    for heading, name in (("Command", "command.txt"), ("Configuration", "config.json")):
        if (run / name).is_file():
            text = f"{name} of the run: what trained this model."
            content = (run / name).read_text()
            parts.append(pages.Verbatim(heading, text, content))
    return parts


def training_curves(heading: str, runs: Mapping[str, Path]) -> list[pages.Markup]:
    """Every logged number that ever changes, over steps: a chart per number with a
    line per run, by label. Nothing where no run has a log."""
    found: dict[str, dict[str, charts.Curve]] = {}
    for label, run in runs.items():
        for name, curve in _read_curves(run).items():
            found.setdefault(name, {})[label] = curve
    if not found:
        return []
    text = f"{run_folder.LOG} of each run, over steps."
    return [pages.Markup(heading, text, charts.curves(found))]


def links_to_models(
    heading: str, root: Path, evaluated: Mapping[str, Path]
) -> pages.Section:
    """Links to the pages that eval.py wrote, by label, where there are any."""
    text = "Each model's own page: all its outputs, its command and configuration."
    files = {label: folder / "index.html" for label, folder in evaluated.items()}
    media = tuple(
        (file.relative_to(root).as_posix(), label)
        for label, file in files.items()
        if file.is_file()
    )
    return pages.Section(heading, text, media)


def this_command() -> pages.Verbatim:
    """The command that makes the page."""
    text = "What made this page; run again, it does what is missing."
    return pages.Verbatim("Command", text, f"python {shlex.join(sys.argv)}")


def _read_curves(run: Path) -> dict[str, charts.Curve]:
    """By name: steps and values of what a run logged and what was not always equal."""
    rows = run_folder.read_log(run)
    names = dict.fromkeys(name for row in rows for name in row)
    curves = {
        name: [(row["step"], row[name]) for row in rows if name in row]
        for name in names
        if name not in NOT_CURVES
    }
    return {
        name: curve
        for name, curve in curves.items()
        if len({value for _, value in curve}) > 1
    }
