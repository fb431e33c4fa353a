# SPDX-License-Identifier: Apache-2.0
"""The fast field: features from a multiresolution hash grid, and a small MLP.

Its samples still are Gaussians: a level whose cells are finer than a sample's
footprint counts less (the idea of Zip-NeRF, one lookup per sample). Levels before
the last of the hierarchical sampling ask two or three small grids of densities.
"""

import dataclasses
import functools

import jax
import jax.numpy as jnp
from flax import linen as nn
from jax import Array
from jaxtyping import Float, PRNGKeyArray

from internal import grids
from internal.binding import configurable, typed
from internal.fields.base import Dense

TABLE_INIT = 1e-4  # features start close to nothing (Instant NGP Sec. 4)
PROPOSAL_GAIN = 10.0  # lets a grid of densities move as fast as an MLP's last layer


@configurable("HashGrid")
@typed
@dataclasses.dataclass(frozen=True)
class HashGrid:
    """Sizes of the grids; resolutions count cells across the whole cube."""

    levels: int = 8
    coarsest: int = 16
    finest: int = 1024
    features: int = 2  # per level and vertex
    log2_rows: int = 18  # of the table of one level; more vertices are hashed
    width: int = 64  # hidden layer
    width_out: int = 16  # features tau
    proposal_resolutions: tuple[int, ...] = (32, 96)
    antialias: bool = True

    def trunk(self, name: str) -> nn.Module:
        return GridTrunk(self, name=name)

    def proposal(self) -> nn.Module:
        return GridProposal(self)


class GridTrunk(nn.Module):
    """Grid features -> raw density and features tau (LLNeRF Eq. 1)."""

    config: HashGrid

    @nn.compact
    def __call__(
        self, mean: Float[Array, "*b 3"], var: Float[Array, "*b 3"]
    ) -> tuple[Float[Array, "*b"], Float[Array, "*b f"]]:
        config = self.config
        resolutions = grids.geometric_resolutions(
            config.coarsest, config.finest, config.levels
        )
        encoded = _Encoding(
            resolutions, config.features, 2**config.log2_rows, config.antialias
        )(mean, var)
        encoded = jnp.moveaxis(encoded, 1, 0).reshape(*mean.shape[:-1], -1)
        hidden = nn.relu(Dense(config.width)(encoded))
        return Dense(1)(hidden)[..., 0], Dense(config.width_out)(hidden)


class GridProposal(nn.Module):
    """The sum of a few grids of raw densities, too coarse to alias."""

    config: HashGrid

    @nn.compact
    def __call__(
        self, mean: Float[Array, "*b 3"], var: Float[Array, "*b 3"]
    ) -> Float[Array, "*b"]:
        resolutions = self.config.proposal_resolutions
        dense = (max(resolutions) + 1) ** 3
        encoded = _Encoding(resolutions, 1, dense, antialias=False)(mean, var)
        total = functools.reduce(jnp.add, encoded[..., 0])
        return PROPOSAL_GAIN * total.reshape(mean.shape[:-1])


class _Encoding(nn.Module):
    resolutions: tuple[int, ...]
    features: int
    max_rows: int
    antialias: bool

    @nn.compact
    def __call__(
        self, mean: Float[Array, "*b 3"], var: Float[Array, "*b 3"]
    ) -> Float[Array, "levels n f"]:
        levels = grids.make_levels(self.resolutions, self.max_rows)
        rows = levels[-1].start + levels[-1].rows
        table = self.param("table", _small, (rows, self.features))
        position, std = to_cube(mean.reshape(-1, 3), var.reshape(-1, 3))
        encoded = grids.lookup(table, position, levels)
        if self.antialias:
            encoded = encoded * grids.seen_fraction(std, levels)[..., None]
        return encoded


def to_cube(
    mean: Float[Array, "n 3"], var: Float[Array, "n 3"]
) -> tuple[Float[Array, "n 3"], Float[Array, " n"]]:
    """Warped Gaussians in the unit cube, with one standard deviation each.

    Every axis is the identity in [-1, 1] and contracted to less than 2 beyond. The
    deviation is the geometric mean of the axes', so that it measures volume.
    """
    size = jnp.maximum(jnp.abs(mean), 1.0)
    contracted = mean * (2.0 * size - 1.0) / size**2
    std = (var[:, 0] * var[:, 1] * var[:, 2] + 1e-36) ** (1.0 / 6.0)
    return jax.lax.stop_gradient((contracted / 4.0 + 0.5, std / 4.0))


def _small(key: PRNGKeyArray, shape: tuple[int, ...]) -> Array:
    return jax.random.uniform(key, shape, minval=-TABLE_INIT, maxval=TABLE_INIT)
