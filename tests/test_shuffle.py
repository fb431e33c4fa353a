# SPDX-License-Identifier: Apache-2.0
"""Draws without repetition: permutations whatever their length, and photos in turns."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from internal.training import shuffle

PERMUTED = jax.jit(shuffle.permuted)
DRAW = jax.jit(shuffle.draw, static_argnums=1)
MOST = 700


def permutation(count: int, key: int) -> np.ndarray:
    places = jnp.arange(MOST, dtype=jnp.uint32) % jnp.uint32(count)
    keys = jnp.full(MOST, key, jnp.uint32)
    counts = jnp.full(MOST, count, jnp.uint32)
    return np.asarray(PERMUTED(places, counts, keys))[:count]


@given(st.integers(1, MOST), st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_every_number_has_one_place(count, key):
    np.testing.assert_array_equal(np.sort(permutation(count, key)), np.arange(count))


@pytest.mark.parametrize("count", [50_000, 2**31])
def test_a_part_of_a_long_order_is_spread_evenly_and_has_no_trend(count):
    """The first draws of 10,000: 20 equal parts get as many, and neither neighbours
    nor orders of two keys have anything in common (five standard deviations)."""
    places = jnp.arange(10_000, dtype=jnp.uint32)
    counts = jnp.full(10_000, count, jnp.uint32)
    orders = [
        np.asarray(PERMUTED(places, counts, jnp.full(10_000, key, jnp.uint32)))
        for key in (1, 2)
    ]
    assert len(np.unique(orders[0])) == 10_000
    parts = np.bincount((orders[0] * (20.0 / count)).astype(int), minlength=20)
    assert np.abs(parts - 500).max() < 5 * np.sqrt(500)
    first, second = (order / count - 0.5 for order in orders)
    for one, other in ((first[1:], first[:-1]), (first[50:], first[:-50]), orders):
        assert abs(np.corrcoef(one, other)[0, 1]) < 5 / np.sqrt(10_000)
    assert abs(np.corrcoef(first, second)[0, 1]) < 5 / np.sqrt(10_000)
    side = int(np.ceil(np.sqrt(count)))  # of the square in which they are permuted
    for along in (orders[0] % side, orders[0] // side):
        _, often = np.unique(np.diff(along.astype(np.int64)), return_counts=True)
        assert often.max() < 200


@given(st.lists(st.integers(1, 40), min_size=1, max_size=5), st.integers(0, 2**40))
@settings(max_examples=20)
def test_photos_take_turns_and_give_all_pixels_before_one_comes_again(sizes, seed):
    counts = jnp.asarray([0, *sizes])  # the first photo is masked whole
    views = jnp.arange(1, len(sizes) + 1)
    number = jnp.arange(3 * 40 * len(sizes), dtype=jnp.uint32)
    view, rank = map(np.asarray, DRAW(number, seed, views, counts))
    for turn in view.reshape(-1, len(sizes)):
        np.testing.assert_array_equal(turn, views)
    for index, size in enumerate(sizes, start=1):
        epochs = rank[view == index][: 120 // size * size].reshape(-1, size)
        for epoch in epochs:
            np.testing.assert_array_equal(np.sort(epoch), np.arange(size))
        if size > 20:
            assert not np.array_equal(epochs[0], epochs[1])
