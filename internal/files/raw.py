# SPDX-License-Identifier: Apache-2.0
"""RAW photos, developed through rawpy (the only module that imports it).

The optional extra ``raw`` brings rawpy with its own LibRaw.
"""

import importlib.util
from pathlib import Path

import numpy as np
from jaxtyping import Float

from internal.errors import UserError


def available() -> bool:
    """Whether the extra ``raw`` is installed."""
    return importlib.util.find_spec("rawpy") is not None


def develop(path: Path) -> Float[np.ndarray, "height width 3"]:
    """Develops one RAW photo, upright, to the 8-bit sRGB that the method expects.

    White balance of daylight and no automatic brightness, the same for all photos:
    what differs between two developed photos differed in the light.

    Returns:
        sRGB float32 in [0, 1], on 8-bit levels.

    Raises:
        UserError: rawpy is missing, or the file is no RAW photo.
    """
    if not available():
        raise UserError(
            f"{path}: RAW photo; run pip install -e '.[raw]' to develop it, or "
            "develop it to JPEG or PNG with a fixed exposure and white balance"
        )
    import rawpy

    try:
        with rawpy.imread(str(path)) as raw:
            levels = raw.postprocess(no_auto_bright=True, use_camera_wb=False)
    except (rawpy.LibRawError, OSError) as error:
        raise UserError(f"{path}: not a readable RAW photo ({error})") from error
    return levels.astype(np.float32) / 255.0
