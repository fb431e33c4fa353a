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
from jaxtyping import Float, Int, PRNGKeyArray, UInt16

from internal import parallel
from internal.cameras import Cameras
from internal.color import UINT16_ONE
from internal.configs import Config, TrainConfig
from internal.files.picture_store import Picture, PictureStore, gigabytes
from internal.scene.masks import Mask
from internal.training.choices import Choices, find_choices

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


@runtime_checkable
class PixelSource(Protocol):
    """Gives the batch of a step inside the jitted train step."""

    def batch(
        self,
        key: PRNGKeyArray,
        cameras: Cameras,
        train: TrainConfig,
        neighbors: int,
        step: Int[Array, ""],
    ) -> Batch: ...


def neighbors_of(config: Config) -> int:
    """How many pixels beside each one the enhancement's losses look at."""
    enhancement = config.model.enhancement
    return 0 if enhancement is None else enhancement.neighbors


def step_keys(seed: int, step: Int[Array, ""]) -> tuple[PRNGKeyArray, PRNGKeyArray]:
    """Keys of (pixels, rendering) for a step: a function of seed and step alone."""
    key = jax.random.fold_in(jax.random.key(seed), step)
    pixel_key, render_key = jax.random.split(key)
    return pixel_key, render_key


def sample_pixels(
    key: PRNGKeyArray,
    cameras: Cameras,
    train: TrainConfig,
    neighbors: int,
    step: Int[Array, ""],
    choices: Choices | None = None,
) -> Pixels:
    """Draws photos evenly, then pixels evenly inside each photo.

    Patches are only needed by the smoothness loss; before it starts every member is
    a pixel of its own, which tells the field more. Patches never leave the picture,
    so every member has a colour of its own.

    Args:
        choices: the pixels that may be drawn; None: all.
    """
    columns, rows = _OFFSETS[neighbors]
    members = (train.batch_size, len(columns))
    if choices is None:
        apart, corner = _draw_all(key, cameras, members, max(columns), max(rows))
    else:
        apart, corner = _draw_some(key, cameras, members, choices)
    together = Pixels(
        view=jnp.broadcast_to(corner.view, members),
        x=corner.x + jnp.array(columns),
        y=corner.y + jnp.array(rows),
    )
    in_patches = step >= train.enhance_start
    return jax.tree.map(lambda p, q: jnp.where(in_patches, p, q), together, apart)


def _draw_all(
    key: PRNGKeyArray,
    cameras: Cameras,
    members: tuple[int, int],
    columns: int,
    rows: int,
) -> tuple[Pixels, Pixels]:
    """Single pixels, and the first ones of patches of so many more columns and rows."""
    view_key, x_key, y_key = jax.random.split(key, 3)
    view = jax.random.randint(view_key, members, 0, len(cameras))
    widths = jnp.asarray(cameras.widths)[view]
    heights = jnp.asarray(cameras.heights)[view]
    apart = Pixels(
        view=view,
        x=jax.random.randint(x_key, members, 0, widths),
        y=jax.random.randint(y_key, members, 0, heights),
    )
    corner = Pixels(
        view=view[:, :1],
        x=jnp.minimum(apart.x, widths - 1 - columns)[:, :1],
        y=jnp.minimum(apart.y, heights - 1 - rows)[:, :1],
    )
    return apart, corner


def _draw_some(
    key: PRNGKeyArray, cameras: Cameras, members: tuple[int, int], choices: Choices
) -> tuple[Pixels, Pixels]:
    """Likewise of what may be drawn."""
    own_key, patch_key = jax.random.split(key)
    widths = jnp.asarray(cameras.widths)

    def place(view: Int[Array, "*b"], index: Int[Array, "*b"]) -> Pixels:
        y, x = jnp.divmod(index, widths[view])
        return Pixels(view, x, y)

    apart = place(*choices.singles.draw(own_key, members))
    return apart, place(*choices.patches.draw(patch_key, (members[0], 1)))


@struct.dataclass
class ResidentPixels:
    """All pictures on the devices; the step gathers what it needs."""

    levels: UInt16[Array | np.ndarray, "k 3"]
    starts: Int[Array | np.ndarray, " n"]  # first row of each picture
    gains: Float[Array | np.ndarray, "n 3"]
    choices: Choices | None  # None: every pixel may be drawn

    def batch(
        self,
        key: PRNGKeyArray,
        cameras: Cameras,
        train: TrainConfig,
        neighbors: int,
        step: Int[Array, ""],
    ) -> Batch:
        pixels = sample_pixels(key, cameras, train, neighbors, step, self.choices)
        rows = flat_rows(pixels, self.starts, cameras.widths)
        return Batch(pixels, self.levels[rows], self.gains[pixels.view])


@struct.dataclass
class FedPixels:
    """A batch that the host gathered."""

    fed: Batch

    def batch(
        self,
        key: PRNGKeyArray,
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


def choices_of(masks: Sequence[Mask], neighbors: int) -> Choices | None:
    """What a step may draw of photos with these masks; None: () leaves all of them."""
    return find_choices(masks, *_OFFSETS[neighbors]) if masks else None


def resident_pixels(
    images: Sequence[Picture],
    gains: Float[np.ndarray, "n 3"],
    choices: Choices | None = None,
) -> ResidentPixels:
    """All pictures, flat."""
    sizes = [image.shape[0] * image.shape[1] for image in images]
    starts = np.cumsum([0, *sizes[:-1]]).astype(np.int32)
    return ResidentPixels(
        np.concatenate([image.reshape(-1, 3) for image in images]),
        starts,
        gains,
        choices,
    )


class PixelFeeder:
    """Gathers each step's batch on the host; every process its own share of it."""

    def __init__(
        self,
        images: PictureStore,
        gains: Float[np.ndarray, "n 3"],
        cameras: Cameras,
        mesh: jax.sharding.Mesh,
        config: Config,
        choices: Choices | None,
    ) -> None:
        self._images, self._gains = images, gains
        self._choices = jax.device_put(choices)
        self._mesh = mesh
        self._share = parallel.process_share(config.train.batch_size)

        @jax.jit
        def sample(step: Int[Array, ""], choices: Choices | None) -> Pixels:
            key, _ = step_keys(config.train.seed, step)
            neighbors = neighbors_of(config)
            return sample_pixels(key, cameras, config.train, neighbors, step, choices)

        self._sample = sample

    def feed(self, step: int) -> FedPixels:
        """The batch that ``ResidentPixels.batch`` gives after ``step`` steps."""
        number = jax.device_put(np.int32(step))
        sampled = jax.device_get(self._sample(number, self._choices))
        pixels = jax.tree.map(lambda x: x[self._share], sampled)
        levels = self._images.pixels(pixels.view, pixels.x, pixels.y)
        batch = Batch(pixels, levels, self._gains[pixels.view])
        return FedPixels(parallel.shard_batch(batch, self._mesh))


def pixel_source(
    images: Sequence[Picture],
    gains: Float[np.ndarray, "n 3"],
    cameras: Cameras,
    mesh: jax.sharding.Mesh,
    config: Config,
    masks: Sequence[Mask] = (),
) -> Callable[[int], PixelSource]:
    """What gives the train step its pixels, as a function of the finished steps.

    Pictures larger than ``Config.max_image_memory`` gigabytes, and all pictures of a
    run of several processes, are fed by the host.
    """
    choices = choices_of(masks, neighbors_of(config))
    size = gigabytes(images)
    stored = isinstance(images, PictureStore)
    if stored or jax.process_count() > 1 or size > config.max_image_memory:
        print(f"pictures: {size:.2f} GB, fed from the host", flush=True)
        store = images if isinstance(images, PictureStore) else PictureStore(images)
        return PixelFeeder(store, gains, cameras, mesh, config, choices).feed
    resident = parallel.replicate(resident_pixels(images, gains, choices), mesh)
    return lambda step: resident
