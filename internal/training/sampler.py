# SPDX-License-Identifier: Apache-2.0
"""Which pixels a training step sees, and where their colours come from.

A batch is made of patches: a pixel, and for an enhancement with ``neighbors = 2`` the
ones to its right and below it, each with its own colour; until ``enhance_start``, when
nothing asks for neighbours yet, of as many single pixels. The pixels of step k follow
from the seed and k alone, whatever the number of devices or hosts. Pictures lie end to
end in one flat uint16 array (65535 is 1.0), on the devices (``ResidentPixels``) or,
when too large or with several processes, on the hosts (``FedPixels``).
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
from internal.configs import Config, TrainConfig
from internal.files.picture_store import Picture, PictureStore, gigabytes

# Steps right and down from a patch's centre.
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
        return jnp.asarray(self.levels).astype(jnp.float32) / 65535.0


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
) -> Pixels:
    """Draws photos evenly, then pixels evenly inside each photo.

    Patches are only needed by the smoothness loss; before it starts every member is
    a pixel of its own, which tells the field more. Patches never leave the picture,
    so every member has a colour of its own.
    """
    view_key, x_key, y_key = jax.random.split(key, 3)
    columns, rows = _OFFSETS[neighbors]
    members = (train.batch_size, len(columns))
    view = jax.random.randint(view_key, members, 0, len(cameras))
    widths = jnp.asarray(cameras.widths)[view]
    heights = jnp.asarray(cameras.heights)[view]
    apart = Pixels(
        view=view,
        x=jax.random.randint(x_key, members, 0, widths),
        y=jax.random.randint(y_key, members, 0, heights),
    )
    corner_x = jnp.minimum(apart.x, widths - 1 - max(columns))[:, :1]
    corner_y = jnp.minimum(apart.y, heights - 1 - max(rows))[:, :1]
    together = Pixels(
        view=jnp.broadcast_to(view[:, :1], members),
        x=corner_x + jnp.array(columns),
        y=corner_y + jnp.array(rows),
    )
    in_patches = step >= train.enhance_start
    return jax.tree.map(lambda p, q: jnp.where(in_patches, p, q), together, apart)


@struct.dataclass
class ResidentPixels:
    """All pictures on the devices; the step gathers what it needs."""

    levels: UInt16[Array | np.ndarray, "k 3"]
    starts: Int[Array | np.ndarray, " n"]  # first row of each picture
    gains: Float[Array | np.ndarray, "n 3"]

    def batch(
        self,
        key: PRNGKeyArray,
        cameras: Cameras,
        train: TrainConfig,
        neighbors: int,
        step: Int[Array, ""],
    ) -> Batch:
        pixels = sample_pixels(key, cameras, train, neighbors, step)
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


def resident_pixels(
    images: Sequence[Picture], gains: Float[np.ndarray, "n 3"]
) -> ResidentPixels:
    """All pictures, flat."""
    sizes = [image.shape[0] * image.shape[1] for image in images]
    starts = np.cumsum([0, *sizes[:-1]]).astype(np.int32)
    return ResidentPixels(
        np.concatenate([image.reshape(-1, 3) for image in images]), starts, gains
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
    ) -> None:
        self._images, self._gains = images, gains
        self._mesh = mesh
        self._share = parallel.process_share(config.train.batch_size)

        @jax.jit
        def sample(step: Int[Array, ""]) -> Pixels:
            key, _ = step_keys(config.train.seed, step)
            return sample_pixels(key, cameras, config.train, neighbors_of(config), step)

        self._sample = sample

    def feed(self, step: int) -> FedPixels:
        """The batch that ``ResidentPixels.batch`` gives after ``step`` steps."""
        sampled = jax.device_get(self._sample(np.int32(step)))
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
        return PixelFeeder(store, gains, cameras, mesh, config).feed
    resident = parallel.replicate(resident_pixels(images, gains), mesh)
    return lambda step: resident
