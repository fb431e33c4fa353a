# SPDX-License-Identifier: Apache-2.0
"""Figures: labelled pictures of one view with enlarged details below them.

Pictures are ``[height, width, 3]`` float32 sRGB in [0, 1]. A crop is a window of a
picture in pixels.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from internal.pages.contact_sheet import (
    BACKGROUND,
    contact_sheet,
    enlarged,
    legible_factor,
)

CROP_PART = 4  # a crop that is found is this part of the picture, either way
FRAME = 2  # pixels of the figure
FRAME_COLORS = ((1.0, 0.85, 0.0), (0.0, 0.85, 1.0), (1.0, 0.35, 0.75), (0.4, 1.0, 0.4))

Picture = Float[np.ndarray, "_height _width 3"]


@dataclasses.dataclass(frozen=True)
class Crop:
    """A window of a picture, in pixels from its top left corner."""

    x: int
    y: int
    width: int
    height: int

    def of(self, picture: Picture) -> Picture:
        """What the picture shows in the window."""
        return picture[self.y : self.y + self.height, self.x : self.x + self.width]

    def fits(self, picture: Picture) -> bool:
        """Whether the window is not empty and lies in the picture."""
        height, width, _ = picture.shape
        return (
            min(self.width, self.height) > 0
            and 0 <= self.x <= width - self.width
            and 0 <= self.y <= height - self.height
        )


def find_crops(truth: Picture) -> tuple[Crop, Crop]:
    """Two windows worth a look: the one of most detail, and the darkest of the rest.

    Of the windows on a grid of half their size; detail is the deviation of the sRGB
    values from their mean. The second does not overlap the first.
    """
    height, width, _ = truth.shape
    size = max(width // CROP_PART, 1), max(height // CROP_PART, 1)
    windows = [
        Crop(x, y, *size)
        for y in range(0, height - size[1] + 1, max(size[1] // 2, 1))
        for x in range(0, width - size[0] + 1, max(size[0] // 2, 1))
    ]
    detailed = max(windows, key=lambda window: float(window.of(truth).std()))
    rest = [
        window
        for window in windows
        if abs(window.x - detailed.x) >= size[0]
        or abs(window.y - detailed.y) >= size[1]
    ]
    return detailed, min(rest, key=lambda window: float(window.of(truth).mean()))


def figure(
    pictures: Sequence[tuple[str, Picture]], crops: Sequence[Crop], columns: int
) -> Float[np.ndarray, "height width 3"]:
    """Pictures of one size under their labels, ``columns`` in a row.

    Small pictures are enlarged by a whole factor, as a contact sheet does. Below each
    are its crops, each enlarged by the whole factor that fills its share of the width.
    Frames of the same colour show on the first picture where they come from.
    """
    columns = min(columns, len(pictures))
    factor = legible_factor(pictures[0][1].shape[1])
    labels = [label for label, _ in pictures]
    shown = [
        _with_details(picture, crops, factor, framed=index == 0)
        for index, (_, picture) in enumerate(pictures)
    ]
    missing = -len(shown) % columns
    shown += [np.full_like(shown[0], BACKGROUND)] * missing
    labels += [""] * missing
    bands = [
        contact_sheet([shown[i : i + columns]], [""], labels[i : i + columns])
        for i in range(0, len(shown), columns)
    ]
    return np.concatenate(bands)


def _with_details(
    picture: Picture, crops: Sequence[Crop], factor: int, *, framed: bool
) -> Picture:
    """The enlarged picture over a strip of its crops; no strip without crops."""
    whole = enlarged(picture, factor)
    height, width, _ = whole.shape
    if framed:
        for crop, color in zip(crops, FRAME_COLORS, strict=False):
            scaled = (factor * n for n in (crop.x, crop.y, crop.width, crop.height))
            _draw_frame(Crop(*scaled).of(whole), color)
    if not crops:
        return whole
    cell = width // len(crops)
    details = []
    for crop, color in zip(crops, FRAME_COLORS, strict=False):
        fill = min(cell // crop.width, height // crop.height)
        details.append(enlarged(crop.of(picture), max(fill, 1)))
        _draw_frame(details[-1], color)
    strip_height = FRAME + max(len(detail) for detail in details)
    strip = np.full((strip_height, width, 3), BACKGROUND, np.float32)
    for index, detail in enumerate(details):
        share = strip[FRAME:, index * cell : (index + 1) * cell]
        share[: len(detail), : detail.shape[1]] = detail[:, :cell]
    return np.concatenate([whole, strip])


def _draw_frame(picture: Picture, color: tuple[float, float, float]) -> None:
    """Draws along the picture's edges, in place."""
    for edge in (
        picture[:FRAME],
        picture[-FRAME:],
        picture[:, :FRAME],
        picture[:, -FRAME:],
    ):
        edge[:] = color
