# SPDX-License-Identifier: Apache-2.0
"""One static ``index.html`` that shows and explains an output folder.

The page needs no network and links by relative path, so that the folder can be
moved, zipped or put on any web server. Only ``Markup`` may bring a script.
"""

import dataclasses
import html
import urllib.parse
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from internal.files import atomic

IMAGES = frozenset([".png", ".jpg", ".jpeg", ".webp", ".gif", ".bmp"])
VIDEOS = frozenset([".mp4", ".webm"])

STYLE = """
:root { color-scheme: dark; }
body { margin: 0 auto; max-width: 110rem; padding: 1.5rem; background: #161616;
  color: #e8e8e8; font: 1rem/1.5 system-ui, sans-serif; }
h1, h2 { font-weight: 600; line-height: 1.2; }
h2 { margin-top: 2.5rem; }
p { max-width: 50rem; }
a { color: #8ab8ff; }
.media { display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fill, minmax(min(22rem, 100%), 1fr)); }
figure { margin: 0; }
img, video { display: block; width: 100%; background: #000; }
figcaption { padding-top: 0.3rem; color: #b8b8b8; font-size: 0.9rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: 0.3rem 0.9rem; border-bottom: 1px solid #3a3a3a; text-align: right; }
th:first-child, td:first-child { text-align: left; }
"""


@dataclasses.dataclass(frozen=True)
class Section:
    """A heading, a sentence on what is seen, and pictures or videos.

    ``media`` are (path relative to the folder, with forward slashes; caption).
    What a browser cannot show, such as EXR, becomes a link.
    """

    heading: str
    text: str
    media: tuple[tuple[str, str], ...]


@dataclasses.dataclass(frozen=True)
class Table:
    """A heading, a sentence on what is listed, and text in rows."""

    heading: str
    text: str
    headers: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]  # one text per header


@dataclasses.dataclass(frozen=True)
class Markup:
    """A heading, a sentence, and HTML that another module made."""

    heading: str
    text: str
    html: str


def write_index(
    folder: Path,
    title: str,
    intro: str,
    sections: Sequence[Section | Table | Markup],
) -> Path:
    """Writes ``index.html`` into an existing folder and returns its path.

    All texts are plain text. Nothing checks that the media exist.

    Raises:
        UserError: the folder cannot be written or the disk is full.
    """
    body = [_tag("h1", title), _tag("p", intro), *map(_section, sections)]
    page = (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"{_tag('title', title)}\n<style>{STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )
    path = folder / "index.html"
    atomic.write_text(path, page)
    return path


def preformatted(heading: str, text: str, content: str) -> Markup:
    """A section that shows a text as it is, such as a command or a file."""
    return Markup(heading, text, f'<div class="scroll">{_tag("pre", content)}</div>')


def _section(section: Section | Table | Markup) -> str:
    head = f"{_tag('h2', section.heading)}\n{_tag('p', section.text)}\n"
    if isinstance(section, Markup):
        return f"<section>\n{head}{section.html}\n</section>"
    if isinstance(section, Table):
        return (
            f'<section>\n{head}<div class="scroll">{_table(section)}</div>\n</section>'
        )
    figures = "\n".join(_figure(path, caption) for path, caption in section.media)
    return f'<section>\n{head}<div class="media">\n{figures}\n</div>\n</section>'


def _figure(path: str, caption: str) -> str:
    """A picture that opens in full on a click, a looping video, or a link."""
    url = html.escape(urllib.parse.quote(path))
    text = html.escape(caption)
    ending = PurePosixPath(path).suffix.lower()
    if ending in VIDEOS:
        shown = f'<video src="{url}" controls loop muted playsinline></video>'
    elif ending in IMAGES:
        shown = f'<a href="{url}"><img src="{url}" alt="{text}" loading="lazy"></a>'
    else:
        shown = f'<a href="{url}">{html.escape(path)}</a>'
    return f"<figure>{shown}<figcaption>{text}</figcaption></figure>"


def _table(table: Table) -> str:
    head = "".join(_tag("th", text) for text in table.headers)
    rows = ("".join(_tag("td", text) for text in row) for row in table.rows)
    body = "\n".join(f"<tr>{row}</tr>" for row in rows)
    return (
        f"<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>"
    )


def _tag(name: str, text: str) -> str:
    return f"<{name}>{html.escape(text)}</{name}>"
