# SPDX-License-Identifier: Apache-2.0
"""What every field shares: F1 and F2, which split its colour into v and r, and phi.

Fields see Gaussians (``mean``, per-axis ``var``) on the axis before the last and
unit view directions without that axis. Colours and their factors are display-coded
(sRGB) and non-negative; they may exceed 1, and only the loss and the writer clip.
"""

import jax
import jax.numpy as jnp
from flax import linen as nn
from flax import struct
from jax import Array
from jaxtyping import Float

from internal import mip
from internal.configs import ModelConfig
from internal.enhancements.gamma import Coefficients
from internal.fields.base import Dense

DENSITY_BIAS = -1.0
COLOR_BIAS = -5.0  # a new network is dark: exp(-5) is 1.7 / 255


@struct.dataclass
class Colored:
    """A plain field's answer at samples: density and colour."""

    density: Float[Array, "*b n"]
    rgb: Float[Array, "*b n 3"]


@struct.dataclass
class Decomposed:
    """A decomposed field's answer at samples; its colour is v * r (paper, Eq. 3)."""

    density: Float[Array, "*b n"]
    v: Float[Array, "*b n 1"]  # view-dependent lighting component
    r: Float[Array, "*b n 3"]  # view-independent colour basis
    features: Float[Array, "*b n f"]  # what phi sees besides v

    @property
    def rgb(self) -> Float[Array, "*b n 3"]:
        return self.v * self.r


class Lighting(nn.Module):
    """F1: features and view direction -> v (one channel) and its hidden layer."""

    config: ModelConfig

    @nn.compact
    def __call__(
        self, features: Float[Array, "*b n f"], viewdirs: Float[Array, "*b 3"]
    ) -> tuple[Float[Array, "*b n 1"], Float[Array, "*b n h"]]:
        encoded = mip.pos_enc(viewdirs, self.config.deg_view)
        hidden = nn.relu(_view_layer(self.config.head_width, features, encoded))
        return jnp.exp(Dense(1)(hidden) + COLOR_BIAS), hidden


class Basis(nn.Module):
    """F2: features alone -> r (three channels), the same from every side."""

    config: ModelConfig

    @nn.compact
    def __call__(self, features: Float[Array, "*b f"]) -> Float[Array, "*b 3"]:
        hidden = nn.relu(Dense(self.config.head_width)(features))
        return jnp.exp(Dense(3)(hidden))


class DecomposedField(nn.Module):
    """F_density, F1 and F2: c = v * r (paper, Eq. 3)."""

    config: ModelConfig

    @nn.compact
    def __call__(
        self,
        mean: Float[Array, "*b n 3"],
        var: Float[Array, "*b n 3"],
        viewdirs: Float[Array, "*b 3"],
        density_noise: Float[Array, "*b n"],
    ) -> Decomposed:
        raw_density, features = self.config.field.trunk("density")(mean, var)
        v, hidden = Lighting(self.config, name="lighting")(features, viewdirs)
        r = Basis(self.config, name="basis")(features)
        density = nn.softplus(raw_density + DENSITY_BIAS + density_noise)
        return Decomposed(density, v, r, hidden)


class PlainField(nn.Module):
    """Mip-NeRF's field: density and view-dependent colour, not decomposed."""

    config: ModelConfig

    @nn.compact
    def __call__(
        self,
        mean: Float[Array, "*b n 3"],
        var: Float[Array, "*b n 3"],
        viewdirs: Float[Array, "*b 3"],
        density_noise: Float[Array, "*b n"],
    ) -> Colored:
        raw_density, features = self.config.field.trunk("density")(mean, var)
        encoded = mip.pos_enc(viewdirs, self.config.deg_view)
        hidden = nn.relu(_view_layer(self.config.head_width, features, encoded))
        rgb = jnp.exp(Dense(3)(hidden) + COLOR_BIAS)
        density = nn.softplus(raw_density + DENSITY_BIAS + density_noise)
        return Colored(density, rgb)


class Phi(nn.Module):
    """The enhancement network: v and features of the field -> alpha and gamma.

    It reads the field and does not move it: gradients stop at its inputs.
    """

    config: ModelConfig

    @nn.compact
    def __call__(
        self, v: Float[Array, "*b 1"], features: Float[Array, "*b f"]
    ) -> Coefficients:
        x = jax.lax.stop_gradient(jnp.concatenate([features, v], axis=-1))
        hidden = nn.relu(Dense(self.config.head_width)(x))
        return Coefficients(
            alpha=nn.sigmoid(Dense(1)(hidden)), gamma=nn.sigmoid(Dense(3)(hidden))
        )


def _view_layer(
    width: int, features: Float[Array, "*b n f"], encoded: Float[Array, "*b d"]
) -> Float[Array, "*b n h"]:
    """A dense layer of [features, direction]; the direction's part is computed
    once per ray instead of once per sample."""
    per_ray = Dense(width, use_bias=False)(encoded)
    return Dense(width)(features) + per_ray[..., None, :]
