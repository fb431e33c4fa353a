# SPDX-License-Identifier: Apache-2.0
"""A part of a page in which two pictures of one view lie on top of each other.

Its style and script are inlined from ``assets``, so the page stays one file.
"""

import html
import json
import urllib.parse
from collections.abc import Mapping
from pathlib import Path

from internal.pages.pages import Markup

ASSETS = Path(__file__).with_name("assets")


def comparison(
    heading: str,
    text: str,
    pictures: Mapping[str, Mapping[str, str]],
    left: str,
    right: str,
) -> Markup:
    """A view chooser, two output choosers and a draggable border between them.

    Args:
        pictures: by view, then output: path relative to the page, forward slashes.
        left: output shown left of the border at first.
        right: likewise right.
    """
    outputs = list(
        dict.fromkeys(output for view in pictures.values() for output in view)
    )
    urls = {
        view: {output: urllib.parse.quote(path) for output, path in paths.items()}
        for view, paths in pictures.items()
    }
    controls = (
        _select("View", "view", list(pictures), next(iter(pictures)))
        + _select("Left", "left", outputs, left)
        + _select("Right", "right", outputs, right)
    )
    return Markup(
        heading,
        text,
        f"<style>{(ASSETS / 'slider.css').read_text()}</style>\n"
        f'<div class="compare" data-urls="{html.escape(json.dumps(urls))}">'
        f'<div class="controls">{controls}</div>'
        '<div class="stage"><img class="right" alt=""><img class="left" alt="">'
        '<input type="range" min="0" max="100" step="0.1" aria-label="border"></div>'
        f"</div>\n<script>{(ASSETS / 'slider.js').read_text()}</script>",
    )


def _select(label: str, name: str, values: list[str], chosen: str) -> str:
    options = "".join(
        f"<option{' selected' if value == chosen else ''}>{html.escape(value)}</option>"
        for value in values
    )
    return f'<label>{label} <select name="{name}">{options}</select></label>'
