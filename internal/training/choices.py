# SPDX-License-Identifier: Apache-2.0
"""The pixels that may be drawn, where photos have masks.

A photo's pixels, row after row, are bits of words. The k-th that counts is found by
bisection over how many count before each word, then in the word: two bits of memory a
pixel, and no draw is ever thrown away.
"""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import Array
from jaxtyping import Bool, Int, Int32, UInt32

from internal.errors import UserError
from internal.scene.masks import Mask

BITS = 32  # of a word


@struct.dataclass
class Drawable:
    """The pixels of each of ``n`` photos that may be drawn."""

    words: UInt32[Array | np.ndarray, " k"]  # lowest bit first; photos start a word
    before: Int32[Array | np.ndarray, " k"]  # pixels of the photo before each word
    starts: Int32[Array | np.ndarray, " _ends"]  # first word of each photo, and the end
    counts: Int32[Array | np.ndarray, " n"]  # pixels of each photo
    views: Int32[Array | np.ndarray, " m"]  # photos that have any

    def nth(
        self, view: Int[Array, "*shape"], rank: Int[Array, "*shape"]
    ) -> Int[Array, "*shape"]:
        """Where the pixel lies that ``rank`` pixels of its photo are before."""
        starts, before = jnp.asarray(self.starts), jnp.asarray(self.before)
        word, last = starts[view], starts[view + 1] - 1
        for _ in range(max(len(before) - 1, 1).bit_length()):
            middle = (word + last + 1) // 2
            is_right = before[middle] <= rank
            word = jnp.where(is_right, middle, word)
            last = jnp.where(is_right, last, middle - 1)
        bits = jnp.asarray(self.words)[word][..., None] >> jnp.arange(BITS, dtype="u4")
        order = jnp.cumsum((bits & 1).astype(jnp.int32), axis=-1)
        wanted = (rank - before[word] + 1)[..., None]
        return BITS * (word - starts[view]) + jnp.argmax(order == wanted, axis=-1)


@struct.dataclass
class Choices:
    """What is drawn by itself, and what begins a patch of pixels that all count."""

    singles: Drawable
    patches: Drawable


def find_choices(
    masks: Sequence[Mask], columns: Sequence[int], rows: Sequence[int]
) -> Choices:
    """What may be drawn of masked photos.

    Args:
        columns: steps to the right of a patch's members from where it begins.
        rows: likewise down.

    Raises:
        UserError: no photo has a whole patch.
    """
    singles = _choice(masks)
    if not any(columns) and not any(rows):
        return Choices(singles, singles)
    patches = _choice([_beginnings(mask, columns, rows) for mask in masks])
    if len(patches.views) == 0:
        raise UserError(
            f"the masks leave no {len(columns)} neighbouring pixels in any photo, but "
            "the enhancement's losses look at these; leave larger parts of the photos"
        )
    return Choices(singles, patches)


def _beginnings(mask: Mask, columns: Sequence[int], rows: Sequence[int]) -> Mask:
    """Pixels at which a patch may begin: all its members are inside and count."""
    height, width = mask.shape
    inside = (height - max(rows), width - max(columns))
    found = np.zeros_like(mask)
    found[: inside[0], : inside[1]] = np.all(
        [
            mask[row : row + inside[0], column : column + inside[1]]
            for row, column in zip(rows, columns, strict=True)
        ],
        axis=0,
    )
    return found


def _choice(masks: Sequence[Bool[np.ndarray, "_h _w"]]) -> Drawable:
    words = [_words(mask) for mask in masks]
    sums = [np.cumsum(np.bitwise_count(own), dtype=np.int32) for own in words]
    counts = np.array([own[-1] for own in sums], np.int32)
    return Drawable(
        words=np.concatenate(words),
        before=np.concatenate([np.append(np.int32(0), own[:-1]) for own in sums]),
        starts=np.cumsum([0, *map(len, words)], dtype=np.int32),
        counts=counts,
        views=np.flatnonzero(counts).astype(np.int32),
    )


def _words(mask: Bool[np.ndarray, "_h _w"]) -> UInt32[np.ndarray, " _words"]:
    packed = np.packbits(mask.ravel(), bitorder="little")
    padded = np.pad(packed, (0, -len(packed) % (BITS // 8)))
    return padded.view("<u4").astype(np.uint32)
