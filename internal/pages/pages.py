# SPDX-License-Identifier: Apache-2.0
"""One static ``index.html`` that shows and explains an output folder.

The page needs no network and links by relative path, so that the folder can be
moved, zipped or put on any web server. Only ``Markup`` may bring a script.
``assets`` holds its template and style.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from internal.files import atomic, templates

ASSETS = Path(__file__).with_name("assets")


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


@dataclasses.dataclass(frozen=True)
class Verbatim:
    """A heading, a sentence, and a text as it is, such as a command or a file."""

    heading: str
    text: str
    content: str


Part = Section | Table | Markup | Verbatim


def write_index(folder: Path, title: str, intro: str, parts: Sequence[Part]) -> Path:
    """Writes ``index.html`` into an existing folder and returns its path.

    All texts are plain text. Nothing checks that the media exist.

    Raises:
        UserError: the folder cannot be written or the disk is full.
    """
    path = folder / "index.html"
    page = templates.fill(ASSETS / "page.html", title=title, intro=intro, parts=parts)
    atomic.write_text(path, page)
    return path
