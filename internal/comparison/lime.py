# SPDX-License-Identifier: Apache-2.0
"""LIME: low-light enhancement by an illumination map (Guo et al., TIP 2017).

A picture is light times reflectance. The light is at least the greatest of a
pixel's channels; made smooth but for the edges of objects, and with its power taken
down, it is divided out. Pictures are ``[height, width, 3]`` sRGB in [0, 1], maps
``[height, width]``.
"""

import numpy as np
import scipy.ndimage
import scipy.sparse
import scipy.sparse.linalg
from jaxtyping import Float

SMOOTHNESS = 0.15  # alpha, as in the paper's experiments
WINDOW_SIGMA = 2.0  # pixels; of the weights' Gaussian window, likewise
LIGHT_POWER = 0.8  # gamma, likewise
EPS = 1e-3  # keeps flat regions from infinite weight, and black from division by zero


def lime(
    srgb: Float[np.ndarray, "height width 3"],
) -> Float[np.ndarray, "height width 3"]:
    """The picture with its light divided out, clipped (LIME Eq. 1)."""
    light = smooth_light(srgb.max(axis=-1))
    lit = srgb / np.maximum(light, EPS)[..., None] ** LIGHT_POWER
    return np.clip(lit, 0.0, 1.0).astype(np.float32)


def smooth_light(
    light: Float[np.ndarray, "height width"],
) -> Float[np.ndarray, "height width"]:
    """The map that is near ``light`` and smooth across texture, not across edges.

    Minimises the sum of (map - light)^2 + alpha w (d map)^2 over pixels and both
    directions (LIME Eq. 17), a sparse linear system.
    """
    height, width = light.shape
    steps = (
        scipy.sparse.kron(_differences(height), scipy.sparse.identity(width)),
        scipy.sparse.kron(scipy.sparse.identity(height), _differences(width)),
    )
    system = scipy.sparse.identity(light.size, format="csc")
    for axis, step in enumerate(steps):
        weights = scipy.sparse.diags(edge_weights(light, axis).ravel())
        system = system + SMOOTHNESS * (step.T @ weights @ step)
    solved = scipy.sparse.linalg.spsolve(
        system.tocsc(), light.ravel().astype(np.float64), permc_spec="MMD_AT_PLUS_A"
    )
    return np.asarray(solved).reshape(light.shape)


def edge_weights(
    light: Float[np.ndarray, "height width"], axis: int
) -> Float[np.ndarray, "_height _width"]:
    """Weights of the differences along ``axis``, small at edges (LIME Eq. 14).

    Differences are summed over a window before their size is taken: those of
    texture and noise cancel, those of an edge do not.
    """
    difference = np.diff(light.astype(np.float64), axis=axis)
    windowed = scipy.ndimage.gaussian_filter(difference, WINDOW_SIGMA)
    return 1.0 / ((np.abs(windowed) + EPS) * (np.abs(difference) + EPS))


def _differences(size: int) -> scipy.sparse.spmatrix:
    """The matrix that takes ``size`` values to their ``size - 1`` differences."""
    shape = (size - 1, size)
    return scipy.sparse.eye(*shape, k=1) - scipy.sparse.eye(*shape)
