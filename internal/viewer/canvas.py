# SPDX-License-Identifier: Apache-2.0
"""From a rendering to the picture in the browser: choice of outputs, and a split.

Everything here is cheap: choosing another output and dragging the split need no new
rendering.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, UInt8

from internal import color
from internal.cameras import Lens
from internal.rendering.pictures import Display, Picture, pictures
from internal.scene import colmap
from internal.structs import LitRendering, Rendering

PHOTO = "photo"
NOTHING = "nothing"
LINE_GREY = 0.9


@dataclasses.dataclass(frozen=True)
class Split:
    """Which outputs are seen, and where one ends and the other begins."""

    left: str = "enhanced"
    right: str = NOTHING
    split: float = 0.5  # of the width


def compose(
    rendering: Rendering | LitRendering,
    display: Display,
    choice: Split,
    others: Mapping[str, Picture],
) -> UInt8[np.ndarray, "height width 3"]:
    """The picture that a user sees.

    Args:
        display: scales of outputs that are not colours.
        others: pictures of the rendering's size that are not part of it, by name; a
            choice that is not there yet shows the dark picture.
    """
    shown = {**pictures(rendering, display), **others}
    left = shown.get(choice.left, shown["dark"])
    if choice.right == NOTHING:
        return _to_uint8(left)
    right = shown.get(choice.right, shown["dark"])
    width = left.shape[1]
    column = min(max(round(choice.split * width), 0), width)
    joined = np.concatenate([left[:, :column], right[:, column:]], axis=1)
    thickness = max(width // 250, 1)
    joined[:, max(column - thickness, 0) : column] = LINE_GREY
    return _to_uint8(joined)


def photo_through(
    photo: Picture,
    photo_lens: Lens,
    photo_from_view: Float[np.ndarray, "3 3"],
    directions: Float[np.ndarray, "pixels 3"],
    view_lens: Lens,
) -> Float[np.ndarray, "view_height view_width 3"]:
    """A photo as a camera at its place sees it through another lens.

    Args:
        photo_from_view: rotation from the camera's axes to the photo's.
        directions: of the camera's pixels, in its own frame.

    Returns:
        Nearest pixels, [height, width, 3]; black where the photo shows nothing.
    """
    pixels = colmap.project(photo_lens, directions.astype(float) @ photo_from_view.T)
    inside = (pixels >= 0.0) & (pixels < [photo_lens.width, photo_lens.height])
    seen = inside.all(axis=-1, keepdims=True)
    column, row = np.where(seen, pixels, 0.0).astype(int).T
    values = np.where(seen, photo[row, column], 0.0).astype(np.float32)
    return values.reshape(view_lens.height, view_lens.width, 3)


def _to_uint8(picture: Picture) -> UInt8[np.ndarray, "height width 3"]:
    """Rays that never enter the scene's space have no colour; they are shown black."""
    return color.to_uint8(np.nan_to_num(picture))
