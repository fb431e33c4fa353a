# SPDX-License-Identifier: Apache-2.0
"""Figures: labelled pictures of one view with enlarged details below them.

Pictures are ``[height, width, 3]`` float32 sRGB in [0, 1]. A crop is a window of a
picture in pixels.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from internal.contact_sheet import BACKGROUND, contact_sheet

CROP_PART = 4  # a crop that is found is this part of the picture, either way
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

    Below each picture are its crops, enlarged by one whole factor. Frames of the same
    colour show on the first picture where they come from.
    """
    columns = min(columns, len(pictures))
    (first_label, first), *others = pictures
    shown = [(first_label, _framed(first, crops), _details(first, crops))]
    shown += [(label, p, _details(p, crops)) for label, p in others]
    nothing = np.full_like(first, BACKGROUND)
    shown += [("", nothing, np.full_like(shown[0][2], BACKGROUND))] * (
        -len(shown) % columns
    )
    bands = []
    for start in range(0, len(shown), columns):
        labels, whole, details = zip(*shown[start : start + columns], strict=True)
        rows = [_stacked(w, d) for w, d in zip(whole, details, strict=True)]
        bands.append(contact_sheet([rows], [""], labels))
    return np.concatenate(bands)


def _details(picture: Picture, crops: Sequence[Crop]) -> Picture:
    """The crops side by side, each enlarged and framed, in a strip of the picture's
    width; of no height without crops."""
    width = picture.shape[1]
    if not crops:
        return picture[:0]
    cell = width // len(crops)
    factor = max(min(cell // crop.width for crop in crops), 1)
    height = factor * max(crop.height for crop in crops)
    strip = np.full((height, width, 3), BACKGROUND, np.float32)
    for index, crop in enumerate(crops):
        large = crop.of(picture).repeat(factor, axis=0).repeat(factor, axis=1)
        whole = Crop(0, 0, large.shape[1], large.shape[0])
        large = _draw_frame(large, whole, FRAME_COLORS[index])
        left = index * cell
        strip[: large.shape[0], left : left + large.shape[1]] = large[:, : width - left]
    return strip


def _framed(picture: Picture, crops: Sequence[Crop]) -> Picture:
    for index, crop in enumerate(crops):
        picture = _draw_frame(picture, crop, FRAME_COLORS[index])
    return picture


def _draw_frame(
    picture: Picture, crop: Crop, color: tuple[float, float, float]
) -> Picture:
    framed = picture.copy()
    window = crop.of(framed)
    for edge in (window[:1], window[-1:], window[:, :1], window[:, -1:]):
        edge[:] = color
    return framed


def _stacked(whole: Picture, details: Picture) -> Picture:
    gap = np.full((2 * (len(details) > 0), whole.shape[1], 3), BACKGROUND, np.float32)
    return np.concatenate([whole, gap, details])
