# SPDX-License-Identifier: Apache-2.0
"""The parts of a result page that explain where its numbers and pictures come from."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from internal import charts, pages, sliders

NOT_CURVES = frozenset(["step"])

Media = Mapping[str, Sequence[tuple[str, str]]]  # by output: (path, view)


def compare_outputs(media: Media) -> pages.Markup:
    """A slider between any two outputs of any view: input and enhanced at first."""
    by_view: dict[str, dict[str, str]] = {}
    order = ("input", "enhanced", "truth")
    for output in sorted(media, key=lambda o: (*order, o).index(o)):
        for path, view in media[output]:
            by_view.setdefault(view, {})[output] = path
    right = "enhanced" if "enhanced" in media else "dark"
    return sliders.comparison(
        "Compare", "Drag the border. Each side can show any output.", by_view,
        "input", right,
    )  # fmt: skip


def training_parts(run: Path) -> list[pages.Markup]:
    """Curves, command and configuration of a run, as far as its folder holds them."""
    parts = []
    if (run / "metrics.jsonl").is_file():
        lines = (run / "metrics.jsonl").read_text().splitlines()
        parts += _curves([json.loads(line) for line in lines])
    for heading, name in (("Command", "command.txt"), ("Configuration", "config.json")):
        if (run / name).is_file():
            text = f"{name} of the run: what trained this model."
            content = (run / name).read_text()
            parts.append(pages.preformatted(heading, text, content))
    return parts


def _curves(lines: Sequence[Mapping[str, float | int]]) -> list[pages.Markup]:
    """Every logged number that ever changes, over steps."""
    names = [name for name in lines[0] if name not in NOT_CURVES] if lines else []
    series = {name: [line[name] for line in lines] for name in names}
    series = {name: values for name, values in series.items() if len(set(values)) > 1}
    if not series:
        return []
    svg = charts.curves([int(line["step"]) for line in lines], series)
    return [pages.Markup("Training", "metrics.jsonl of the run, over steps.", svg)]
