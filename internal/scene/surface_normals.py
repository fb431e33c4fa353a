# SPDX-License-Identifier: Apache-2.0
"""Folders named like normal-light truth that hold something else.

Geometry networks and renderers write pictures of surface normals into ``normal``:
unit vectors, a component per channel, from -1 to 1 as floats or as (1 + n) / 2.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from internal.files import image_io
from internal.files.listing import find_pictures

LOOKED_AT = 3  # pictures
STEP = 4  # every fourth pixel of a row and column is enough
WORST_LENGTH = 0.1  # off 1: of 8 bits and of JPEG
COLORED = 0.1  # between channels; grey is a background, or a photo's wall
FEWEST_COLORED = 0.2  # of all pixels
FEWEST_UNIT = 0.8  # of the coloured ones; of colours by chance it would be a third


def why_no_truth(folder: Path) -> str:
    """Why a folder does not hold normal-light pictures; "" if it seems to.

    Raises:
        UserError: a picture cannot be read.
    """
    names = find_pictures(folder).pictures
    if not names:
        return "no picture in it"
    if "normal" not in folder.name.casefold():
        return ""
    chosen = {names[i * (len(names) - 1) // (LOOKED_AT - 1)] for i in range(LOOKED_AT)}
    values = [image_io.read_values(folder / name) for name in sorted(chosen)]
    if all(map(are_surface_normals, values)):
        return "it holds surface normals"
    return ""


def are_surface_normals(values: Float[np.ndarray, "h w channels"]) -> bool:
    """Whether most pixels that are not grey are unit vectors."""
    values = values[::STEP, ::STEP]
    if values.shape[-1] != 3:
        return False
    vectors = values if values.min() < 0.0 else 2.0 * values - 1.0
    is_colored = np.ptp(values, axis=-1) > COLORED
    is_unit = np.abs(np.linalg.norm(vectors, axis=-1) - 1.0) < WORST_LENGTH
    is_common = is_colored.mean() > FEWEST_COLORED
    return bool(is_common and is_unit[is_colored].mean() > FEWEST_UNIT)
