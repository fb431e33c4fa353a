# SPDX-License-Identifier: Apache-2.0
"""Labelled pictures side by side in one picture.

Pictures are ``[height, width, 3]`` float32 sRGB in [0, 1]. Sizes are in pixels.
Labels are drawn in OpenImageIO's own font, which has no Greek.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from internal.files import image_io

FONT_SIZE = 18
SMALLEST_FONT_SIZE = 10
LABEL_HEIGHT = 30
GAP = 8
LEGIBLE_WIDTH = 320  # narrower pictures are enlarged to about this width
BACKGROUND = 0.09
INK = 0.92


def contact_sheet(
    rows: Sequence[Sequence[Float[np.ndarray, "_height _width 3"]]],
    row_labels: Sequence[str],
    column_labels: Sequence[str],
) -> Float[np.ndarray, "sheet_height sheet_width 3"]:
    """A grid of pictures, labels above its columns and left of its rows.

    Small pictures are enlarged by one whole factor for all, without blur, so that
    noise stays visible. Pictures of other sizes sit at the top left of their cell.

    Args:
        rows: one picture per column label in each row.
        row_labels: one per row; all empty leaves no room for them.
        column_labels: one per column.

    Raises:
        UserError: the font of OpenImageIO's wheel is missing.
    """
    pictures = [picture for row in rows for picture in row]
    factor = legible_factor(max(picture.shape[1] for picture in pictures))
    height = factor * max(picture.shape[0] for picture in pictures)
    width = factor * max(picture.shape[1] for picture in pictures)
    margin = max(image_io.text_width(label, FONT_SIZE) for label in row_labels)
    head = [_label("", margin, LABEL_HEIGHT)]
    head += [_label(label, width, LABEL_HEIGHT) for label in column_labels]
    body = [
        _beside(
            [_label(label, margin, height)]
            + [_cell(picture, factor, height, width) for picture in row]
        )
        for label, row in zip(row_labels, rows, strict=True)
    ]
    return _below([_beside(head), *body])


def legible_factor(width: int) -> int:
    """The whole factor that makes a picture about ``LEGIBLE_WIDTH`` wide, or 1."""
    return -(-LEGIBLE_WIDTH // width)


def enlarged(
    picture: Float[np.ndarray, "_height _width 3"], factor: int
) -> Float[np.ndarray, "_height _width 3"]:
    """The picture in blocks of ``factor`` by ``factor`` pixels."""
    return picture.repeat(factor, axis=0).repeat(factor, axis=1)


def side_by_side(
    pictures: Sequence[tuple[str, Float[np.ndarray, "_height _width 3"]]], path: Path
) -> None:
    """Writes one row of pictures, each under its label.

    Raises:
        UserError: the folder cannot be written, the disk is full, or the font of
            OpenImageIO's wheel is missing.
    """
    labels = [label for label, _ in pictures]
    row = [picture for _, picture in pictures]
    image_io.write(path, contact_sheet([row], [""], labels))


def _cell(
    picture: Float[np.ndarray, "_height _width 3"], factor: int, height: int, width: int
) -> Float[np.ndarray, "{height} {width} 3"]:
    large = enlarged(picture, factor)
    cell = _blank(height, width)
    cell[: large.shape[0], : large.shape[1]] = large
    return cell


def _beside(
    pictures: Sequence[Float[np.ndarray, "height _width 3"]],
) -> Float[np.ndarray, "height width 3"]:
    """Joins pictures of one height from left to right; those of no width vanish."""
    gap = _blank(pictures[0].shape[0], GAP)
    shown = [picture for picture in pictures if picture.shape[1] > 0]
    parts = [gap, *(part for picture in shown for part in (picture, gap))]
    return np.concatenate(parts, axis=1)


def _below(
    pictures: Sequence[Float[np.ndarray, "_height width 3"]],
) -> Float[np.ndarray, "height width 3"]:
    """Joins pictures of one width from top to bottom."""
    gap = _blank(GAP, pictures[0].shape[1])
    parts = [part for picture in pictures for part in (picture, gap)]
    return np.concatenate(parts, axis=0)


def _blank(height: int, width: int) -> Float[np.ndarray, "{height} {width} 3"]:
    return np.full((height, width, 3), BACKGROUND, np.float32)


def _label(
    text: str, width: int, height: int
) -> Float[np.ndarray, "{height} {width} 3"]:
    """The text in the middle of a box, in a smaller font where it is too long."""
    box = _blank(height, width)
    if not text:
        return box
    size = FONT_SIZE
    while image_io.text_width(text, size) > width and size > SMALLEST_FONT_SIZE:
        size -= 1
    left = max(0, (width - image_io.text_width(text, size)) // 2)
    baseline = (height + FONT_SIZE * 7 // 10) // 2
    return image_io.draw_text(box, text, (left, baseline), size, INK)
