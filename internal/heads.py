# SPDX-License-Identifier: Apache-2.0
"""What every field shares: the heads F1 and F2, which split its colour into v and r.

Fields see Gaussians (``mean``, per-axis ``var``) on the axis before the last and
unit view directions without that axis. Colours and their factors are display-coded
(sRGB) and non-negative; they may exceed 1, and only the loss and the writer clip.
"""

import jax.numpy as jnp
from flax import linen as nn
from jax import Array
from jaxtyping import Float

from internal import mip
from internal.fields.base import Dense, FieldConfig
from internal.structs import Colored, Decomposed

DENSITY_BIAS = -1.0
COLOR_BIAS = -5.0  # a new network is dark: exp(-5) is 1.7 / 255


def density_of(
    raw_density: Float[Array, "*b"], noise: Float[Array, "*b"] | float = 0.0
) -> Float[Array, "*b"]:
    """Density, per unit of length, of what a trunk or a proposal answers."""
    return nn.softplus(raw_density + DENSITY_BIAS + noise)


class Lighting(nn.Module):
    """F1: features and view direction -> v (one channel) and its hidden layer."""

    width: int
    deg_view: int

    @nn.compact
    def __call__(
        self, features: Float[Array, "*b n f"], viewdirs: Float[Array, "*b 3"]
    ) -> tuple[Float[Array, "*b n 1"], Float[Array, "*b n h"]]:
        hidden = _view_layer(self.width, self.deg_view, features, viewdirs)
        return jnp.exp(Dense(1)(hidden) + COLOR_BIAS), hidden


class Basis(nn.Module):
    """F2: features alone -> r (three channels), the same from every side."""

    width: int

    @nn.compact
    def __call__(self, features: Float[Array, "*b f"]) -> Float[Array, "*b 3"]:
        hidden = nn.relu(Dense(self.width)(features))
        return jnp.exp(Dense(3)(hidden))


class DecomposedField(nn.Module):
    """F_density, F1 and F2: c = v * r (LLNeRF Eq. 3)."""

    field: FieldConfig
    width: int  # hidden, of F1 and F2
    deg_view: int

    @nn.compact
    def __call__(
        self,
        mean: Float[Array, "*b n 3"],
        var: Float[Array, "*b n 3"],
        viewdirs: Float[Array, "*b 3"],
        density_noise: Float[Array, "*b n"],
    ) -> Decomposed:
        raw_density, features = self.field.trunk("density")(mean, var)
        v, hidden = Lighting(self.width, self.deg_view, name="lighting")(
            features, viewdirs
        )
        r = Basis(self.width, name="basis")(features)
        density = density_of(raw_density, density_noise)
        return Decomposed(density, v, r, hidden)


class PlainField(nn.Module):
    """Mip-NeRF's field: density and view-dependent colour, not decomposed."""

    field: FieldConfig
    width: int
    deg_view: int

    @nn.compact
    def __call__(
        self,
        mean: Float[Array, "*b n 3"],
        var: Float[Array, "*b n 3"],
        viewdirs: Float[Array, "*b 3"],
        density_noise: Float[Array, "*b n"],
    ) -> Colored:
        raw_density, features = self.field.trunk("density")(mean, var)
        hidden = _view_layer(self.width, self.deg_view, features, viewdirs)
        rgb = jnp.exp(Dense(3)(hidden) + COLOR_BIAS)
        density = density_of(raw_density, density_noise)
        return Colored(density, rgb)


def _view_layer(
    width: int,
    deg_view: int,
    features: Float[Array, "*b n f"],
    viewdirs: Float[Array, "*b 3"],
) -> Float[Array, "*b n h"]:
    """A hidden layer of [features, encoded direction]; the direction's part is
    computed once per ray instead of once per sample."""
    per_ray = Dense(width, use_bias=False)(mip.pos_enc(viewdirs, deg_view))
    return nn.relu(Dense(width)(features) + per_ray[..., None, :])
