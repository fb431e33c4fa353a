# SPDX-License-Identifier: Apache-2.0
"""The paper's enhancement: a dynamic gamma of the lighting v at each sample.

v, v_hat and r are display-coded (sRGB) factors of colour: v * r is the dark colour,
v_hat * r the enhanced one (LLNeRF Sec. 4.2.2).
"""

import dataclasses
import functools
from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from flax import struct
from jax import Array
from jaxtyping import Float

from internal import losses
from internal.binding import configurable, typed
from internal.enhancements.base import Output
from internal.enhancements.look import LightEdit
from internal.fields.base import Dense
from internal.structs import Decomposed, Level, Lit, LitRendering, Terms
from internal.volume import composite

EPS_ALPHA = 1e-4  # floor of alpha, so that the gain stays finite


@configurable("Gamma")
@typed
@dataclasses.dataclass(frozen=True)
class Gamma:
    """Sizes and loss weights (0 removes a term). See ``base.Enhancement``."""

    neighbors: ClassVar[int] = 2
    whole_batch: ClassVar[bool] = False

    gamma0: float = 2.2  # LLNeRF Eq. 8
    width: int = 128  # hidden width of phi
    exposure: float = 0.1  # L_c1
    exposure_target: float = 0.55  # e, sRGB
    gray: float = 0.1  # L_c2; lambda_1 = gray / exposure
    gray_bias: float = 0.5  # beta_1
    gamma_norm: float = 0.01  # L_c3; lambda_2 = gamma_norm / exposure
    alpha_smooth: float = 0.1  # L_sa
    gamma_smooth: float = 0.1  # L_sg
    smooth_eps: float = 1e-4  # epsilon_1
    smooth_beta: float = 1.5

    @property
    def outputs(self) -> Mapping[str, Output]:
        return OUTPUTS

    def network(self, name: str) -> "GammaNetwork":
        return GammaNetwork(self, name=name)

    def metered(self, dark_srgb: Float[np.ndarray, "n 3"]) -> "Gamma":
        """Itself: the paper's e is a constant."""
        return self

    def along_rays(self, edit: LightEdit) -> LightEdit:
        return edit.without_gains()

    def terms(self, rendering: LitRendering) -> Terms:
        """L_c (LLNeRF Eq. 9) and L_s (LLNeRF Eq. 10), term by term."""
        lit = rendering.lit
        assert isinstance(lit, GammaLit)
        members = (-1, self.neighbors + 1)
        smooth = functools.partial(
            losses.smoothness_loss,
            v=rendering.v.reshape(*members, 1),
            beta=self.smooth_beta,
            eps=self.smooth_eps,
        )
        exposure = losses.exposure_loss(lit.enhanced, target=self.exposure_target)
        gray = losses.gray_world_loss(lit.enhanced, rendering.r, bias=self.gray_bias)
        return {
            "exposure": self.exposure * exposure,
            "gray": self.gray * gray,
            "gamma_norm": self.gamma_norm * losses.gamma_norm_loss(lit.gamma_energy),
            "alpha_smooth": self.alpha_smooth * smooth(lit.alpha.reshape(*members, 1)),
            "gamma_smooth": self.gamma_smooth * smooth(lit.gamma.reshape(*members, 3)),
        }


@struct.dataclass
class Coefficients:
    """What phi predicts at each sample."""

    alpha: Float[Array, "*b 1"]  # lighting gain is 1 / alpha
    gamma: Float[Array, "*b 3"]  # per-channel change of the exponent


@struct.dataclass
class GammaLit(Lit):
    """Enhanced rays with their composited lighting and coefficients."""

    v_enhanced: Float[Array | np.ndarray, "*rays 3"]  # v_hat
    alpha: Float[Array | np.ndarray, "*rays 1"]
    gamma: Float[Array | np.ndarray, "*rays 3"]
    gamma_energy: Float[Array | np.ndarray, "*rays 1"]  # |gamma|^2


class Phi(nn.Module):
    """phi: v and features of the field -> alpha and gamma (LLNeRF Sec. 4.2.2)."""

    width: int

    @nn.compact
    def __call__(
        self, v: Float[Array, "*b 1"], features: Float[Array, "*b f"]
    ) -> Coefficients:
        hidden = nn.relu(Dense(self.width)(jnp.concatenate([features, v], axis=-1)))
        return Coefficients(
            alpha=nn.sigmoid(Dense(1)(hidden)), gamma=nn.sigmoid(Dense(3)(hidden))
        )


def enhance_v(
    v: Float[Array, "*b 1"],
    alpha: Float[Array, "*b 1"],
    exponent: Float[Array, "*b 3"],
) -> Float[Array, "*b 3"]:
    """v_hat = (v / alpha)^exponent (LLNeRF Eq. 8); alpha = exponent = 1 is identity."""
    return (v / jnp.maximum(alpha, EPS_ALPHA)) ** exponent


def light_v(
    v: Float[Array, "*b 1"], coefficients: Coefficients, gamma0: float, edit: LightEdit
) -> Float[Array, "*b 3"]:
    """``enhance_v`` with exponent 1 / (gamma0 + gamma), under the user's light edit.

    The edit's strength moves alpha and the exponent towards their identity, 1; its
    contrast multiplies the exponent and its gains multiply v_hat along the rays
    (LLNeRF Fig. 11). The neutral edit changes no bit of the result.
    """
    exponent = 1.0 / (gamma0 + coefficients.gamma)
    weaker = 1.0 - edit.strength
    alpha = coefficients.alpha + weaker * (1.0 - coefficients.alpha)
    exponent = exponent + weaker * (1.0 - exponent)
    v_hat = enhance_v(v, alpha, exponent * edit.contrast)
    return v_hat * edit.pivot * edit.coded_gains


class GammaNetwork(nn.Module):
    """v_hat = phi(v) at the samples, v_hat * r composited (LLNeRF Eq. 4)."""

    config: Gamma

    @nn.compact
    def __call__(self, level: Level, edit: LightEdit) -> GammaLit:
        samples, weights = level.samples, level.weights
        assert isinstance(samples, Decomposed)
        phi = Phi(self.config.width, name="phi")
        coefficients: Coefficients = phi(samples.v, samples.features)
        v_hat = light_v(samples.v, coefficients, self.config.gamma0, edit)
        gamma_energy = jnp.sum(coefficients.gamma**2, axis=-1, keepdims=True)
        return GammaLit(
            enhanced=composite(weights, v_hat * samples.r),
            v_enhanced=composite(weights, v_hat),
            alpha=composite(weights, coefficients.alpha),
            gamma=composite(weights, coefficients.gamma),
            gamma_energy=composite(weights, gamma_energy),
        )

    def relight(self, rendering: LitRendering, edit: LightEdit) -> GammaLit:
        """Gains multiply v_hat at every sample alike, hence the pixels too."""
        lit = rendering.lit
        assert isinstance(lit, GammaLit)
        return dataclasses.replace(
            lit,
            enhanced=lit.enhanced * edit.coded_gains,
            v_enhanced=lit.v_enhanced * edit.coded_gains,
        )


def _lit(rendering: LitRendering) -> GammaLit:
    assert isinstance(rendering.lit, GammaLit)
    return rendering.lit


OUTPUTS: Mapping[str, Output] = {
    "enhanced": Output(
        "the lit scene, c_hat = v_hat * r: the result", lambda x: x.enhanced
    ),
    "v_enhanced": Output(
        "enhanced lighting v_hat, scaled to be visible",
        lambda x: _lit(x).v_enhanced,
        scaled=True,
    ),
    "alpha": Output(
        "alpha of the enhancement: lighting gain is 1 / alpha", lambda x: _lit(x).alpha
    ),
    "gamma": Output(
        "gamma of the enhancement: change of the exponent per channel",
        lambda x: _lit(x).gamma,
    ),
}
