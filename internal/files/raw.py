# SPDX-License-Identifier: Apache-2.0
"""RAW photos, developed through rawpy (the only module that imports it).

The optional extra ``raw`` brings rawpy with its own LibRaw.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from internal import extras
from internal.errors import UserError


def develop(path: Path) -> Float[np.ndarray, "height width 3"]:
    """Develops one RAW photo, upright, to the 8-bit sRGB that the method expects.

    White balance of daylight and no automatic brightness, the same for all photos:
    what differs between two developed photos differed in the light.

    Returns:
        sRGB float32 in [0, 1], on 8-bit levels.

    Raises:
        UserError: rawpy is missing, or the file is no RAW photo.
    """
    instead = "develop it to JPEG or PNG with a fixed exposure and white balance"
    extras.need("raw", "rawpy", to=f"{path}: a RAW photo", otherwise=instead)
    import rawpy

    try:
        with rawpy.imread(str(path)) as raw:
            levels = raw.postprocess(no_auto_bright=True, use_camera_wb=False)
    except (rawpy.LibRawError, OSError) as error:
        raise UserError(f"{path}: not a readable RAW photo ({error})") from error
    return levels.astype(np.float32) / 255.0
