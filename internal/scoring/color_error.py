# SPDX-License-Identifier: Apache-2.0
"""CIEDE2000 through scikit-image.

The optional extra ``metrics`` brings the package. Colours are sRGB in [0, 1].
"""

import numpy as np
from jax import Array
from jaxtyping import Float

from internal import extras


def ciede2000(
    prediction: Float[Array | np.ndarray, "*pixels 3"],
    truth: Float[Array | np.ndarray, "*pixels 3"],
) -> float:
    """Colour difference CIEDE2000 (Sharma et al. 2005), mean over the pixels.

    In CIELAB under D65; 1 is about what an observer just sees, black and white
    differ by 100.

    Raises:
        UserError: the extra ``metrics`` is not installed.
    """
    extras.need("metrics", "skimage", to="CIEDE2000")
    from skimage import color

    pair = [color.rgb2lab(np.asarray(srgb, np.float64)) for srgb in (prediction, truth)]
    return float(np.mean(color.deltaE_ciede2000(*pair)))
