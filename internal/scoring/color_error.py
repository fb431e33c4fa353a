# SPDX-License-Identifier: Apache-2.0
"""CIEDE2000 through scikit-image (the only module that imports it).

The optional extra ``metrics`` brings the package. Colours are sRGB in [0, 1].
"""

import importlib.util

import numpy as np
from jax import Array
from jaxtyping import Float

from internal.errors import UserError


def available() -> bool:
    """Whether the extra ``metrics`` is installed."""
    return importlib.util.find_spec("skimage") is not None


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
    if not available():
        raise UserError("CIEDE2000 needs scikit-image: run pip install -e '.[metrics]'")
    from skimage import color

    pair = [color.rgb2lab(np.asarray(srgb, np.float64)) for srgb in (prediction, truth)]
    return float(np.mean(color.deltaE_ciede2000(*pair)))
