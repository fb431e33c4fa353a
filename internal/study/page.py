# SPDX-License-Identifier: Apache-2.0
"""The page that asks which of two pictures is better.

It is one file beside a folder of pictures: no network, no server. Methods are seen
under numbers, so that a picture's address does not give them away.
"""

import dataclasses
import hashlib
import json
import random
import urllib.parse
from collections.abc import Sequence
from pathlib import Path

from internal.errors import UserError
from internal.files import image_io, templates
from internal.files.listing import flat_pngs, list_pictures
from internal.scene.pairing import pair_by_name

TEMPLATE = Path(__file__).with_suffix(".html")


@dataclasses.dataclass(frozen=True)
class Gallery:
    """A name for the chart, and a folder of pictures."""

    name: str
    folder: Path


def parse_method(text: str) -> Gallery:
    """A method from ``NAME=FOLDER``; of eval.py's folders the enhanced pictures.

    Raises:
        UserError: the text has another form.
    """
    name, equals, folder = text.partition("=")
    if not (name and equals and folder):
        raise UserError(f"{text!r}: expected NAME=FOLDER, such as ours=outputs/x/eval")
    inner = Path(folder) / "enhanced"
    return Gallery(name, inner if inner.is_dir() else Path(folder))


def write_study(
    folder: Path, methods: Sequence[Gallery], count: int, seed: int
) -> dict[str, float]:
    """Fills an empty folder with ``index.html`` and the pictures it shows.

    Every picture of the first method is paired with those of all others.

    Args:
        count: how many views, chosen at random; 0 takes all.
        seed: of the choice.

    Returns:
        How many views and pairs were made.

    Raises:
        UserError: fewer than two methods, equal names, or pictures that do not pair.
    """
    names = [method.name for method in methods]
    if len(methods) < 2 or len(set(names)) < len(names):
        raise UserError(
            f"methods {', '.join(names)}: expected two or more, named apart"
        )
    views = list(list_pictures(methods[0].folder))
    if count and count < len(views):
        views = sorted(random.Random(seed).sample(views, count))
    urls = [_copy(folder, index, views, method) for index, method in enumerate(methods)]
    pairs = [
        {"view": view, "b": method.name, "a_url": a_url, "b_url": b_url}
        for method, others in zip(methods[1:], urls[1:], strict=True)
        for view, a_url, b_url in zip(views, urls[0], others, strict=True)
    ]
    content = json.dumps({"a": names[0], "pairs": pairs})
    identity = hashlib.sha256(content.encode()).hexdigest()[:8]
    study = {"id": identity, "a": names[0], "pairs": pairs}
    page = templates.fill(TEMPLATE, study=study)
    (folder / "index.html").write_text(page, encoding="utf-8")
    return {"views": float(len(views)), "pairs": float(len(pairs))}


def _copy(folder: Path, index: int, views: Sequence[str], method: Gallery) -> list[str]:
    """Copies a method's pictures as PNGs; their addresses on the page, by view."""
    paths, _ = pair_by_name(views, method.folder)
    urls = []
    for file, path in zip(flat_pngs(views), paths, strict=True):
        copied = folder / "pictures" / str(index) / file
        copied.parent.mkdir(parents=True, exist_ok=True)
        image_io.write(copied, image_io.read_srgb(path))
        urls.append(urllib.parse.quote(copied.relative_to(folder).as_posix()))
    return urls
