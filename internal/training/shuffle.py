# SPDX-License-Identifier: Apache-2.0
"""Draws that repeat nothing before all was drawn, any of them found by its number.

A training that draws with replacement has not seen a fifth of the pixels when it has
drawn 1.6 times as many. Here photos take turns, and each gives its pixels in a random
order; when all have come, in another one. No order is ever stored: a permutation is
computed at the places that are asked for.
"""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int, UInt32

ROUNDS = 4  # of the Feistel network, each of both its halves
_STEP = 0x9E3779B9  # between the keys of two rounds


def draw(
    number: UInt32[Array, "*b"],
    seed: int,
    views: Int[Array, " m"],
    counts: Int[Array, " n"],
) -> tuple[Int[Array, "*b"], Int[Array, "*b"]]:
    """The photos and the ranks of the draws of these numbers.

    Args:
        number: of each draw, from the first one of a training.
        views: the photos that have pixels.
        counts: how many each of ``n`` photos has; ranks are below that.
    """
    turn, slot = jnp.divmod(number, jnp.uint32(len(views)))
    view = views[slot]
    count = counts[view].astype(jnp.uint32)
    epoch, place = jnp.divmod(turn, count)
    key = _mix(_mix(_mix(jnp.uint32(seed % 2**32)) + view.astype(jnp.uint32)) + epoch)
    return view, permuted(place, count, key).astype(jnp.int32)


def uniform(number: UInt32[Array, "*b"], seed: int) -> Float[Array, "*b"]:
    """A random number in [0, 1) for each draw."""
    key = _mix(jnp.uint32((seed + _STEP) % 2**32))
    return (_mix(number ^ key) >> 8).astype(jnp.float32) / 2.0**24


def permuted(
    place: UInt32[Array, "*b"], count: UInt32[Array, "*b"], key: UInt32[Array, "*b"]
) -> UInt32[Array, "*b"]:
    """What a random permutation of ``count`` numbers has at a place.

    A Feistel network on the smallest near-square that holds them permutes it; a number
    beyond ``count`` is sent on until it falls below (Black and Rogaway 2002), which
    few need.

    Args:
        place: below ``count``, each in a permutation of its own.
        count: at most 2^31.
        key: another one, another permutation.
    """
    across = jnp.ceil(jnp.sqrt(count.astype(jnp.float32))).astype(jnp.uint32)
    down = (count + across - 1) // across

    def permute(number: UInt32[Array, "*b"]) -> UInt32[Array, "*b"]:
        row, column = jnp.divmod(number, across)
        for turn in range(ROUNDS):
            own = _mix(key + jnp.uint32(turn * _STEP % 2**32))
            column = (column + _mix(row ^ own) % across) % across
            row = (row + _mix(column + own) % down) % down
        return row * across + column

    return jax.lax.while_loop(
        lambda found: jnp.any(found >= count),
        lambda found: jnp.where(found >= count, permute(found), found),
        permute(place),
    )


def _mix(x: UInt32[Array, "*b"]) -> UInt32[Array, "*b"]:
    """Every bit of the result depends on all of ``x``: MurmurHash3's finalizer."""
    x = (x ^ (x >> 16)) * jnp.uint32(0x85EBCA6B)
    x = (x ^ (x >> 13)) * jnp.uint32(0xC2B2AE35)
    return x ^ (x >> 16)
