# SPDX-License-Identifier: Apache-2.0
"""Classical enhancement of one dark photo, with OpenCV (imported only here).

What a user would try without a 3-D model; the comparison's 2-D rows. The optional
extra ``enhance2d`` brings OpenCV. Pictures are ``[height, width, 3]`` float32 sRGB
in [0, 1]; OpenCV's algorithms see them in 8 bits.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from internal import extras
from internal.color import quantize, to_uint8
from internal.comparison.lime import lime
from internal.scene.noise import noise_level
from internal.scoring.baselines import gain_to_mean

Picture = Float[np.ndarray, "height width 3"]

CLIP_LIMIT = 2.0  # these two as in OpenCV's tutorial
TILES = (8, 8)
PATCH, SEARCH = 7, 21  # pixels, odd; what OpenCV's documentation recommends
# JPEG's blocks make noise alike in neighbouring pixels, so that the estimate of its
# level is too low; where texture makes it too high, the recommended strength is enough.
STRENGTH = 3.0  # of the denoising, in levels of noise
LEAST_NOISE = 0.5  # 8-bit levels: that of rounding, about
MAX_STRENGTH = 10.0  # 8-bit levels; likewise recommended, for colour pictures
VERSION = 1  # counts changes of the results; photos made by an older one are refused


def check_available(name: str) -> None:
    """Refuses an enhancer where the extra ``enhance2d`` is not installed.

    Raises:
        UserError: says how to install it.
    """
    instead = "leave the method out of the list"
    extras.need("enhance2d", "cv2", to=name, otherwise=instead)


def clahe(srgb: Picture) -> Picture:
    """Contrast-limited adaptive histogram equalisation (Zuiderveld 1994), after one
    linear gain to mean 0.5: by itself it leaves a dark photo dark.

    Equalises the greatest of a pixel's channels (the value of HSV) and scales all
    three alike, so that hues stay.
    """
    import cv2

    bright = quantize(gain_to_mean(srgb))
    value = to_uint8(bright).max(axis=-1)
    equalised = cv2.createCLAHE(CLIP_LIMIT, TILES).apply(value)
    gain = equalised / np.maximum(value, 1).astype(np.float32)
    return np.clip(bright * gain[..., None], 0.0, 1.0)


def denoise(srgb: Picture) -> Picture:
    """Non-local means (Buades et al. 2005), as strong as the picture is noisy."""
    import cv2

    noise = max(255.0 * noise_level(srgb), LEAST_NOISE)
    strength = min(STRENGTH * noise, MAX_STRENGTH)
    return quantize(
        cv2.fastNlMeansDenoisingColored(
            to_uint8(srgb), None, strength, strength, PATCH, SEARCH
        )
        / np.float32(255.0)
    )


ENHANCERS: dict[str, Callable[[Picture], Picture]] = {
    "clahe": clahe,
    "clahe_denoised": lambda srgb: denoise(clahe(srgb)),
    "lime": lime,
    "lime_denoised": lambda srgb: denoise(lime(srgb)),
}
