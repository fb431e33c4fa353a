# SPDX-License-Identifier: Apache-2.0
"""Which pixels a training step sees, and where their colours come from.

A batch is made of patches: a pixel, and for an enhancement with ``neighbors = 2`` the
ones to its right and below it, each with its own colour; until ``enhance_start``, when
nothing asks for neighbours yet, of as many single pixels. None of them is masked. The
pixels of step k follow from the seed and k alone, whatever the number of devices or
hosts. Pictures lie end to end in one flat uint16 array (65535 is 1.0), on the devices
(``ResidentPixels``) or, when too large or with several processes, on the hosts
(``FedPixels``).
"""

from collections.abc import Callable, Sequence
from typing import Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import Array
from jaxtyping import Float, Int, UInt16, UInt32

from internal import parallel
from internal.cameras import Cameras
from internal.color import UINT16_ONE
from internal.configs import Config, TrainConfig
from internal.files.picture_store import PictureStore, StoredPicture, gigabytes
from internal.scene.masks import Mask
from internal.scene.scene import Scene
from internal.training import shuffle
from internal.training.choices import Choices, Drawable, find_choices
from internal.training.detail import Detail, find_detail

# Steps right and down from the first pixel of a patch to each of its members.
_OFFSETS = {0: ((0,), (0,)), 2: ((0, 1, 0), (0, 0, 1))}


@struct.dataclass
class Pixels:
    """Positions of pixels: view index, column, row."""

    view: Int[Array | np.ndarray, "*batch"]
    x: Int[Array | np.ndarray, "*batch"]
    y: Int[Array | np.ndarray, "*batch"]


@struct.dataclass
class Batch:
    """Pixels ``[patches, members]`` and the stored colours that supervise them."""

    pixels: Pixels
    levels: UInt16[Array | np.ndarray, "*batch 3"]
    gains: Float[Array | np.ndarray, "*batch 3"]  # photo over scene, linear light

    def rgb(self) -> Float[Array, "*batch 3"]:
        """The colours as sRGB in [0, 1]."""
        return jnp.asarray(self.levels).astype(jnp.float32) / UINT16_ONE


@struct.dataclass
class Chances:
    """Which pixels are drawn, and how often: at first all, and all alike."""

    choices: Choices | None = None  # those that may be drawn; None: all
    detail: Detail | None = None  # draws its places more often; None: all alike


@runtime_checkable
class PixelSource(Protocol):
    """Gives the batch of a step inside the jitted train step."""

    def batch(
        self,
        cameras: Cameras,
        train: TrainConfig,
        neighbors: int,
        step: Int[Array, ""],
    ) -> Batch: ...


def neighbors_of(config: Config) -> int:
    """How many pixels beside each one the enhancement's losses look at."""
    enhancement = config.model.enhancement
    return 0 if enhancement is None else enhancement.neighbors


def sample_pixels(
    cameras: Cameras,
    train: TrainConfig,
    neighbors: int,
    step: Int[Array, ""],
    chances: Chances,
) -> Pixels:
    """Photos in turns, and of each all pixels in a random order before one comes again.

    With ``chances.detail``, of two of them each, one is taken: the likelier, the more
    detail is around it. The enhancement's losses, which are means over the scene, see
    all alike.

    Patches are only needed by the smoothness loss; before it starts every member is
    a pixel of its own, which tells the field more. Patches never leave the picture,
    so every member has a colour of its own.
    """
    columns, rows = _OFFSETS[neighbors]
    members = (train.batch_size, len(columns))
    first = step.astype(jnp.uint32) * jnp.uint32(train.batch_size)
    patch = first + jnp.arange(members[0], dtype=jnp.uint32)[:, None]
    single = patch * jnp.uint32(members[1]) + jnp.arange(members[1], dtype=jnp.uint32)
    apart = _draw_singles(single, train.seed, cameras, chances)
    drawable = chances.choices.patches if chances.choices else None
    corner = _draw(patch, train.seed, cameras, (max(columns), max(rows)), drawable)
    together = Pixels(
        view=jnp.broadcast_to(corner.view, members),
        x=corner.x + jnp.array(columns),
        y=corner.y + jnp.array(rows),
    )
    in_patches = step >= train.enhance_start
    return jax.tree.map(lambda p, q: jnp.where(in_patches, p, q), together, apart)


def _draw_singles(
    number: UInt32[Array, "*b"],
    seed: int,
    cameras: Cameras,
    chances: Chances,
) -> Pixels:
    """The pixels of draws of these numbers: with ``detail``, of two pixels each, either
    with chances in proportion to the detail around them."""
    detail = chances.detail
    drawable = chances.choices.singles if chances.choices else None

    def draw(number: UInt32[Array, "*b"]) -> Pixels:
        return _draw(number, seed, cameras, (0, 0), drawable)

    if detail is None:
        return draw(number)
    one, other = draw(2 * number), draw(2 * number + 1)
    first, second = (detail.at(p.view, p.x, p.y) for p in (one, other))
    taken = shuffle.uniform(number, seed) * (first + second) < first
    return jax.tree.map(lambda a, b: jnp.where(taken, a, b), one, other)


def _draw(
    number: UInt32[Array, "*b"],
    seed: int,
    cameras: Cameras,
    margin: tuple[int, int],
    drawable: Drawable | None,
) -> Pixels:
    """The pixels of draws of these numbers.

    Args:
        margin: columns and rows that keep free at the right and below.
        drawable: what may be drawn, which knows the margin; None: all before it.
    """
    widths, heights = jnp.asarray(cameras.widths), jnp.asarray(cameras.heights)
    if drawable is None:
        widths = widths - margin[0]
        counts = widths * (heights - margin[1])
        view, place = shuffle.draw(number, seed, jnp.arange(len(cameras)), counts)
    else:
        views, counts = jnp.asarray(drawable.views), jnp.asarray(drawable.counts)
        view, rank = shuffle.draw(number, seed, views, counts)
        place = drawable.nth(view, rank)
    y, x = jnp.divmod(place, widths[view])
    return Pixels(view, x, y)


@struct.dataclass
class ResidentPixels:
    """All pictures on the devices; the step gathers what it needs."""

    levels: UInt16[Array | np.ndarray, "k 3"]
    starts: Int[Array | np.ndarray, " n"]  # first row of each picture
    gains: Float[Array | np.ndarray, "n 3"]
    chances: Chances

    def batch(
        self,
        cameras: Cameras,
        train: TrainConfig,
        neighbors: int,
        step: Int[Array, ""],
    ) -> Batch:
        pixels = sample_pixels(cameras, train, neighbors, step, self.chances)
        rows = flat_rows(pixels, self.starts, cameras.widths)
        return Batch(pixels, self.levels[rows], self.gains[pixels.view])


@struct.dataclass
class FedPixels:
    """A batch that the host gathered."""

    fed: Batch

    def batch(
        self,
        cameras: Cameras,
        train: TrainConfig,
        neighbors: int,
        step: Int[Array, ""],
    ) -> Batch:
        return self.fed


def flat_rows(
    pixels: Pixels,
    starts: Int[Array | np.ndarray, " n"],
    widths: Int[Array | np.ndarray, " n"],
) -> Int[Array, "patches members"]:
    """Rows of the flat picture array that hold ``pixels``."""
    starts, widths = jnp.asarray(starts), jnp.asarray(widths)
    return starts[pixels.view] + pixels.y * widths[pixels.view] + pixels.x


def find_chances(scene: Scene, config: Config) -> Chances:
    """What a training on a scene draws: nothing masked, and detail if it seeks that.

    Raises:
        UserError: masks leave no whole patch in any photo.
    """
    choices = choices_of(scene.masks, neighbors_of(config))
    seeks = config.train.seek_detail
    return Chances(choices, find_detail(scene.images, scene.masks) if seeks else None)


def choices_of(masks: Sequence[Mask], neighbors: int) -> Choices | None:
    """What a step may draw of photos with these masks; None: () leaves all of them."""
    return find_choices(masks, *_OFFSETS[neighbors]) if masks else None


def resident_pixels(
    images: Sequence[StoredPicture],
    gains: Float[np.ndarray, "n 3"],
    chances: Chances,
) -> ResidentPixels:
    """All pictures, flat."""
    sizes = [image.shape[0] * image.shape[1] for image in images]
    starts = np.cumsum([0, *sizes[:-1]]).astype(np.int32)
    levels = np.concatenate([image.reshape(-1, 3) for image in images])
    return ResidentPixels(levels, starts, gains, chances)


class PixelFeeder:
    """Gathers each step's batch on the host; every process its own share of it."""

    def __init__(
        self,
        images: PictureStore,
        gains: Float[np.ndarray, "n 3"],
        cameras: Cameras,
        mesh: jax.sharding.Mesh,
        config: Config,
        chances: Chances,
    ) -> None:
        self._images, self._gains = images, gains
        self._chances = jax.device_put(chances)
        self._mesh = mesh
        self._share = parallel.process_share(config.train.batch_size)

        @jax.jit
        def sample(step: Int[Array, ""], chances: Chances) -> Pixels:
            neighbors = neighbors_of(config)
            return sample_pixels(cameras, config.train, neighbors, step, chances)

        self._sample = sample

    def feed(self, step: int) -> FedPixels:
        """The batch that ``ResidentPixels.batch`` gives after ``step`` steps."""
        number = jax.device_put(np.int32(step))
        sampled = jax.device_get(self._sample(number, self._chances))
        pixels = jax.tree.map(lambda x: x[self._share], sampled)
        levels = self._images.pixels(pixels.view, pixels.x, pixels.y)
        batch = Batch(pixels, levels, self._gains[pixels.view])
        return FedPixels(parallel.shard_batch(batch, self._mesh))


def pixel_source(
    images: Sequence[StoredPicture],
    gains: Float[np.ndarray, "n 3"],
    cameras: Cameras,
    mesh: jax.sharding.Mesh,
    config: Config,
    chances: Chances,
) -> Callable[[int], PixelSource]:
    """What gives the train step its pixels, as a function of the finished steps.

    Pictures larger than ``Config.max_image_memory`` gigabytes, and all pictures of a
    run of several processes, are fed by the host.
    """
    size = gigabytes(images)
    stored = isinstance(images, PictureStore)
    if stored or jax.process_count() > 1 or size > config.max_image_memory:
        print(f"pictures: {size:.2f} GB, fed from the host", flush=True)
        store = images if isinstance(images, PictureStore) else PictureStore(images)
        return PixelFeeder(store, gains, cameras, mesh, config, chances).feed
    resident = parallel.replicate(resident_pixels(images, gains, chances), mesh)
    return lambda step: resident
