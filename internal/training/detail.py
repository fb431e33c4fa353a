# SPDX-License-Identifier: Apache-2.0
"""Where photos have detail, coarsely: what a training should look at more often.

Bare walls are learned long before texture and edges are. How much a place differs from
what is around it is measured in the logarithm of light, as the data term does, on means
of 2 x 2 pixels, which have half the noise; and kept as one number for each tile.
"""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import Array
from jaxtyping import Bool, Float, Int, Int32, UInt8
from scipy import ndimage

from internal.color import from_uint16
from internal.files.picture_store import StoredPicture
from internal.squares import square_means

MOST_PIXELS = 1_000_000  # of a photo that are looked at, evenly spread
TILE = 4  # of these along each side, even
WINDOW = 3  # tiles along each side that a tile is compared with
FLOOR = 0.3  # of the mean detail of a photo: bare walls are looked at, too
LARGEST = 8.0  # times the mean
STEPS = 255.0 / LARGEST
DARK = 0.5  # of the mean light, below which differences count less
Places = Int[Array | np.ndarray, "*b"]


@struct.dataclass
class Detail:
    """How much there is at each tile of ``n`` photos, 1 on average."""

    tiles: UInt8[Array | np.ndarray, " k"]  # in steps, row after row
    starts: Int32[Array | np.ndarray, " n"]  # first tile of each photo
    across: Int32[Array | np.ndarray, " n"]  # tiles in a row of each photo
    sides: Int32[Array | np.ndarray, " n"]  # pixels along the sides of its tiles

    def at(self, view: Places, x: Places, y: Places) -> Float[Array, "*b"]:
        """The detail around pixels."""
        starts, across = jnp.asarray(self.starts), jnp.asarray(self.across)
        side = jnp.asarray(self.sides)[view]
        row, column = jnp.asarray(y) // side, jnp.asarray(x) // side
        tile = starts[view] + row * across[view] + column
        return jnp.asarray(self.tiles)[tile] / STEPS


def find_detail(
    images: Sequence[StoredPicture], masks: Sequence[Bool[np.ndarray, "_h _w"]] = ()
) -> Detail:
    """The detail of photos; what is masked has no part in it.

    Args:
        masks: of the pixels that count; () if all do.
    """
    tiles, sides = [], []
    for view, image in enumerate(images):
        mask = masks[view] if masks else np.ones(image.shape[:2], bool)
        every = max(round((mask.size / MOST_PIXELS) ** 0.5), 1)
        tiles.append(_tiles(image[::every, ::every], mask[::every, ::every]))
        sides.append(TILE * every)
    starts = np.cumsum([0, *(own.size for own in tiles[:-1])]).astype(np.int32)
    across = np.array([own.shape[1] for own in tiles], np.int32)
    flat = np.concatenate([own.ravel() for own in tiles])
    return Detail(flat, starts, across, np.array(sides, np.int32))


def _tiles(
    image: StoredPicture, mask: Bool[np.ndarray, "h w"]
) -> UInt8[np.ndarray, "rows columns"]:
    """The detail of each tile of a photo; the last ones reach over its ends."""
    counts = _means(mask.astype(np.float32), 2)
    light = from_uint16(np.asarray(image)).mean(axis=-1) * mask
    light = _means(light, 2) / np.maximum(counts, 1e-6)
    typical = light[counts > 0.0].mean() if (counts > 0.0).any() else 1.0
    log_light = np.log(light + DARK * typical + 1e-6) * counts

    weight, first, second = (
        ndimage.uniform_filter(_means(part, TILE // 2), WINDOW, mode="nearest")
        for part in (counts, log_light, log_light**2 / np.maximum(counts, 1e-6))
    )
    weight = np.maximum(weight, 1e-6)
    spread = np.sqrt(np.maximum(second / weight - (first / weight) ** 2, 0.0))
    relative = FLOOR + (1.0 - FLOOR) * spread / max(float(spread.mean()), 1e-6)
    return np.round(np.minimum(relative, LARGEST) * STEPS).astype(np.uint8)


def _means(values: Float[np.ndarray, "h w"], size: int) -> Float[np.ndarray, "_ _"]:
    """Of squares of so many pixels along each side; zeros lie beyond the ends."""
    height, width = values.shape
    padded = np.pad(values, ((0, -height % size), (0, -width % size)))
    return square_means(padded, size)
