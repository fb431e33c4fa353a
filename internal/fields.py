# SPDX-License-Identifier: Apache-2.0
"""The radiance field: F_density, and F1 and F2 that split its colour into v and r.

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
from internal.enhance import Coefficients

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


class Density(nn.Module):
    """F_density: encoded Gaussian -> raw density and features tau (paper, Eq. 1)."""

    config: ModelConfig

    @nn.compact
    def __call__(
        self, mean: Float[Array, "*b 3"], var: Float[Array, "*b 3"]
    ) -> tuple[Float[Array, "*b"], Float[Array, "*b f"]]:
        config = self.config
        encoded = mip.integrated_pos_enc(mean, var, config.max_deg)
        x = encoded
        for layer in range(config.depth):
            x = nn.relu(_Dense(config.width)(x))
            if layer % config.skip == 0 and layer > 0:
                x = jnp.concatenate([x, encoded], axis=-1)
        raw_density = _Dense(1)(x)[..., 0]
        return raw_density, _Dense(config.width)(x)


class Lighting(nn.Module):
    """F1: features and view direction -> v (one channel) and its hidden layer."""

    config: ModelConfig

    @nn.compact
    def __call__(
        self, features: Float[Array, "*b n f"], viewdirs: Float[Array, "*b 3"]
    ) -> tuple[Float[Array, "*b n 1"], Float[Array, "*b n h"]]:
        encoded = mip.pos_enc(viewdirs, self.config.deg_view)
        hidden = nn.relu(_view_layer(self.config.head_width, features, encoded))
        return jnp.exp(_Dense(1)(hidden) + COLOR_BIAS), hidden


class Basis(nn.Module):
    """F2: features alone -> r (three channels), the same from every side."""

    config: ModelConfig

    @nn.compact
    def __call__(self, features: Float[Array, "*b f"]) -> Float[Array, "*b 3"]:
        hidden = nn.relu(_Dense(self.config.head_width)(features))
        return jnp.exp(_Dense(3)(hidden))


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
        raw_density, features = Density(self.config, name="density")(mean, var)
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
        raw_density, features = Density(self.config, name="density")(mean, var)
        encoded = mip.pos_enc(viewdirs, self.config.deg_view)
        hidden = nn.relu(_view_layer(self.config.head_width, features, encoded))
        rgb = jnp.exp(_Dense(3)(hidden) + COLOR_BIAS)
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
        hidden = nn.relu(_Dense(self.config.head_width)(x))
        return Coefficients(
            alpha=nn.sigmoid(_Dense(1)(hidden)), gamma=nn.sigmoid(_Dense(3)(hidden))
        )


class _Dense(nn.Module):
    """A dense layer that sees all samples on one axis: on a CPU the gradient of its
    kernel is then one plain matrix product, a quarter faster."""

    width: int
    use_bias: bool = True

    @nn.compact
    def __call__(self, inputs: Float[Array, "*b f"]) -> Float[Array, "*b g"]:
        layer = nn.Dense(
            self.width, self.use_bias, kernel_init=nn.initializers.glorot_uniform()
        )
        outputs = layer(inputs.reshape(-1, inputs.shape[-1]))
        return outputs.reshape(*inputs.shape[:-1], self.width)


def _view_layer(
    width: int, features: Float[Array, "*b n f"], encoded: Float[Array, "*b d"]
) -> Float[Array, "*b n h"]:
    """A dense layer of [features, direction]; the direction's part is computed
    once per ray instead of once per sample."""
    per_ray = _Dense(width, use_bias=False)(encoded)
    return _Dense(width)(features) + per_ray[..., None, :]
