# SPDX-License-Identifier: Apache-2.0
"""The losses, one function per term, as numbers without weights: the paper's, and
``colorfulness_loss``, ours.

Colours are display-coded (sRGB), rays come in patches ``[patches, 3]`` of a pixel,
its right and its lower neighbour wherever a loss looks at neighbours.
``docs/method.md`` says where these forms differ from the authors' release and why.
"""

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.lax import stop_gradient
from jaxtyping import Float

WHITE = 254.5 / 255.0  # a pixel at least this bright may have been clipped


def data_loss(
    rgb: Float[Array | np.ndarray, "*b 3"],
    target: Float[Array | np.ndarray, "*b 3"],
    *,
    eps: float,
) -> Float[Array, ""]:
    """Log-linearised data term (LLNeRF Sec. 4.3; RawNeRF Eq. 4).

    The squared error in log(c + eps), linearised around the prediction, so that an
    error of one level counts more in the dark. A prediction above 1 equals a
    clipped pixel and is too bright for any other.
    """
    clipped = jnp.minimum(rgb, 1.0)
    seen = jnp.where(target >= WHITE, clipped, rgb)
    return jnp.mean(((seen - target) / (stop_gradient(clipped) + eps)) ** 2)


def exposure_loss(
    enhanced: Float[Array | np.ndarray, "*b 3"], *, target: float
) -> Float[Array, ""]:
    """L_c1 = E[(c_hat - e)^2] (LLNeRF Eq. 9, first term), on the channel mean: the
    colour is left to the gray-world term."""
    return jnp.mean((jnp.mean(enhanced, axis=-1) - target) ** 2)


def colorfulness(srgb: Float[Array | np.ndarray, "*b 3"]) -> Float[Array, ""]:
    """E[max_c - min_c]: zero for gray."""
    return jnp.mean(jnp.max(srgb, axis=-1) - jnp.min(srgb, axis=-1))


def colorfulness_loss(
    enhanced: Float[Array | np.ndarray, "*b 3"], *, least: float
) -> Float[Array, ""]:
    """(E[max_c c_hat - min_c c_hat] - least)^2: asks a scene that is paler than normal
    photos for more colour. No saturation is less than 1, so it takes none away."""
    return (colorfulness(enhanced) - least) ** 2


def gray_world_loss(
    enhanced: Float[Array | np.ndarray, "*b 3"],
    r: Float[Array | np.ndarray, "*b 3"],
    *,
    bias: float,
) -> Float[Array, ""]:
    """L_c2 = E[var_c(c_hat) / (beta_1 + var_c(r))] (LLNeRF Eq. 9, second term).

    ``r`` is first divided by its largest channel: v * r leaves the scale of r open,
    and a saturated colour must relax the term at any scale.
    """
    basis = r / (jnp.max(r, axis=-1, keepdims=True) + 1e-6)
    return jnp.mean(jnp.var(enhanced, axis=-1) / (bias + jnp.var(basis, axis=-1)))


def gamma_norm_loss(
    gamma_energy: Float[Array | np.ndarray, "*b 1"],
) -> Float[Array, ""]:
    """L_c3 = ||gamma||^2 (LLNeRF Eq. 9, third term), averaged over channels where
    the ray meets something: weighted along rays, so empty space does not count."""
    return jnp.mean(gamma_energy) / 3.0


def smoothness_loss(
    coefficient: Float[Array | np.ndarray, "patches 3 c"],
    v: Float[Array | np.ndarray, "patches 3 1"],
    *,
    beta: float,
    eps: float,
) -> Float[Array, ""]:
    """L_sa or L_sg (LLNeRF Eq. 11): squared differences of an integrated coefficient
    to the right and below, relative to those of log v, halved."""
    log_v = jnp.log(stop_gradient(v) + eps)
    total = jnp.zeros(())
    for neighbor in (1, 2):
        change = (coefficient[:, 0] - coefficient[:, neighbor]) ** 2
        edge = (log_v[:, 0] - log_v[:, neighbor]) ** 2
        total = total + jnp.mean(change / (beta * edge + eps))
    return 0.5 * total
