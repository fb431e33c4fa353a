# SPDX-License-Identifier: Apache-2.0
"""Volume rendering: density to weights, weights to pixels."""

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jax.lax import stop_gradient
from jaxtyping import Float


def compute_weights(
    density: Float[Array, "*b n"],
    t_edges: Float[Array, "*b n_edges"],
    directions: Float[Array, "*b 3"],
) -> Float[Array, "*b n"]:
    """w_i = (1 - exp(-sigma_i delta_i)) exp(-sum_{j<i} sigma_j delta_j): how much of
    a pixel is each sample's (LLNeRF Eq. 2).

    The last interval is opaque: whatever light is left ends there, so that the
    weights of a ray sum to one and a dark pixel cannot be explained by emptiness.
    """
    lengths = jnp.linalg.norm(directions, axis=-1, keepdims=True)
    optical = density * jnp.diff(t_edges, axis=-1) * lengths
    transmittance = jnp.exp(-(jnp.cumsum(optical, axis=-1) - optical))
    alpha = 1.0 - jnp.exp(-optical)
    alpha = jnp.concatenate([alpha[..., :-1], jnp.ones_like(alpha[..., -1:])], -1)
    return alpha * transmittance


def composite(
    weights: Float[Array, "*b n"], values: Float[Array, "*b n c"]
) -> Float[Array, "*b c"]:
    """The weighted sum of a quantity along each ray, sum_i w_i c_i (LLNeRF Eq. 2)."""
    return jnp.einsum("...n,...nc->...c", weights, values)


def with_gradient(samples: Any, share: Float[Array, "*b n"]) -> Any:
    """The same samples, arrays ``[*b, n, ...]``, of which only a share of the gradient
    is passed on."""

    def scaled(values: Array) -> Array:
        wide = share.reshape(share.shape + (1,) * (values.ndim - share.ndim))
        return values + (wide - 1.0) * (values - stop_gradient(values))

    return jax.tree.map(scaled, samples)
