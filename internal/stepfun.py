# SPDX-License-Identifier: Apache-2.0
"""Step functions along rays: resampling and the distortion of weights.

``edges`` are the ``n + 1`` sorted ends of ``n`` bins on the last axis; ``weights``
are the non-negative masses of the bins, which need not sum to one.
"""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, PRNGKeyArray


def stratified_positions(
    count: int, rays: int, key: PRNGKeyArray | None
) -> Float[Array, "rays count"]:
    """``count`` sorted positions in [0, 1), one in each of ``count`` equal strata.

    All positions of a ray share one offset, drawn from ``key``; without a key they
    sit at the centres of the strata.
    """
    if key is None:
        offset = jnp.full((rays, 1), 0.5)
    else:
        offset = jax.random.uniform(key, (rays, 1))
    return (jnp.arange(count, dtype=offset.dtype) + offset) / count


def blur_weights(weights: Float[Array, "*b n"], padding: float) -> Float[Array, "*b n"]:
    """A wide, smooth upper envelope plus ``padding`` (mip-NeRF Eq. 18)."""
    padded = jnp.concatenate([weights[..., :1], weights, weights[..., -1:]], axis=-1)
    maxima = jnp.maximum(padded[..., :-1], padded[..., 1:])
    return 0.5 * (maxima[..., :-1] + maxima[..., 1:]) + padding


def invert_cdf(
    positions: Float[Array, "*b m"],
    edges: Float[Array, "*b n_edges"],
    weights: Float[Array, "*b n"],
) -> Float[Array, "*b m"]:
    """Where the normalised cumulative weight reaches each position in [0, 1].

    Finds bins by comparing with every edge: for the tens to hundreds of bins of a
    ray this beats a binary search on every kind of device.
    """
    mass = weights / jnp.sum(weights, axis=-1, keepdims=True)
    inner = jnp.minimum(jnp.cumsum(mass[..., :-1], axis=-1), 1.0)
    zeros = jnp.zeros_like(mass[..., :1])
    cdf = jnp.concatenate([zeros, inner, zeros + 1.0], axis=-1)
    below = positions[..., None, :] >= cdf[..., 1:-1, None]
    left = jnp.sum(below, axis=-2)
    cdf0 = jnp.take_along_axis(cdf, left, axis=-1)
    cdf1 = jnp.take_along_axis(cdf, left + 1, axis=-1)
    edge0 = jnp.take_along_axis(edges, left, axis=-1)
    edge1 = jnp.take_along_axis(edges, left + 1, axis=-1)
    width = cdf1 - cdf0
    fraction = (positions - cdf0) / jnp.where(width > 0, width, 1.0)
    return edge0 + jnp.clip(fraction, 0.0, 1.0) * (edge1 - edge0)


def interlevel(
    edges: Float[Array, "*b n_edges"],
    weights: Float[Array, "*b n"],
    outer_edges: Float[Array, "*b m_edges"],
    outer_weights: Float[Array, "*b m"],
) -> Float[Array, "*b"]:
    """How far a proposal fails to cover a histogram (mip-NeRF 360 Eq. 13).

    The outer bins that touch a bin must hold at least its weight; what they lack
    counts, squared and relative to the weight.
    """
    touches = (outer_edges[..., None, 1:] > edges[..., :-1, None]) & (
        outer_edges[..., None, :-1] < edges[..., 1:, None]
    )
    bound = jnp.einsum("...nm,...m->...n", touches.astype(weights.dtype), outer_weights)
    lack = jnp.maximum(weights - bound, 0.0)
    return jnp.sum(lack**2 / (weights + 1e-5), axis=-1)


def distortion(
    edges: Float[Array, "*b n_edges"], weights: Float[Array, "*b n"]
) -> Float[Array, "*b"]:
    """Spread of weights along a ray (mip-NeRF 360 Eq. 15), in linear time.

    The double sum over pairs of bins is twice the sum over ordered pairs, which
    two running sums give.
    """
    middles = (edges[..., 1:] + edges[..., :-1]) / 2.0
    moments = weights * middles
    mass_before = jnp.cumsum(weights, axis=-1) - weights
    moment_before = jnp.cumsum(moments, axis=-1) - moments
    between = 2.0 * jnp.sum(moments * mass_before - weights * moment_before, axis=-1)
    within = jnp.sum(weights**2 * jnp.diff(edges, axis=-1), axis=-1) / 3.0
    return between + within
