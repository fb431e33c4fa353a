# SPDX-License-Identifier: Apache-2.0
"""Pictures as means of squares of pixels."""

import numpy as np
from jaxtyping import Float


def square_means(
    values: Float[np.ndarray, "height width *channels"], size: int
) -> Float[np.ndarray, "rows columns *channels"]:
    """Means of squares of ``size`` pixels along each side, which divides both sides of
    the picture: what is done about a rest is the caller's."""
    height, width, *channels = values.shape
    squares = values.reshape(height // size, size, width // size, size, *channels)
    return squares.mean(axis=(1, 3))
