# SPDX-License-Identifier: Apache-2.0
"""The paper's field: an MLP of integrated positional encodings (mip-NeRF)."""

import dataclasses

import jax.numpy as jnp
from flax import linen as nn
from jax import Array
from jaxtyping import Float

from internal import mip
from internal.binding import configurable, typed
from internal.fields.base import Dense


@configurable("MLP")
@typed
@dataclasses.dataclass(frozen=True)
class MLP:
    """Sizes of the MLP; the defaults are the paper's."""

    depth: int = 8  # hidden layers
    width: int = 256
    skip: int = 4  # every so many layers the encoding enters again
    max_deg: int = 16  # of the integrated positional encoding

    def trunk(self, name: str) -> nn.Module:
        return MipTrunk(self, name=name)

    def proposal(self) -> None:
        """None: every level asks the field, as in mip-NeRF."""


class MipTrunk(nn.Module):
    """Encoded Gaussian -> raw density and features tau (LLNeRF Eq. 1)."""

    config: MLP

    @nn.compact
    def __call__(
        self, mean: Float[Array, "*b 3"], var: Float[Array, "*b 3"]
    ) -> tuple[Float[Array, "*b"], Float[Array, "*b f"]]:
        config = self.config
        encoded = mip.integrated_pos_enc(mean, var, config.max_deg)
        x = encoded
        for layer in range(config.depth):
            x = nn.relu(Dense(config.width)(x))
            if layer % config.skip == 0 and layer > 0:
                x = jnp.concatenate([x, encoded], axis=-1)
        raw_density = Dense(1)(x)[..., 0]
        return raw_density, Dense(config.width)(x)
