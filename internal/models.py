# SPDX-License-Identifier: Apache-2.0
"""LLNeRF on one screen: sample, ask the field, composite, enhance.

Rays are flat, ``[rays, ...]``. A ``Space`` says where the samples lie.
"""

from typing import Any, Literal

import jax
import jax.numpy as jnp
from flax import linen as nn
from flax import struct
from jax import Array
from jax.lax import stop_gradient
from jaxtyping import Float, PRNGKeyArray

from internal import mip, stepfun
from internal.cameras import Rays
from internal.configs import ModelConfig
from internal.coord import ForwardFacing, Space
from internal.enhancements.editing import LightEdit
from internal.enhancements.gamma import Coefficients, phi
from internal.enhancements.tone import Meter, develop
from internal.heads import (
    DENSITY_BIAS,
    Colored,
    Decomposed,
    DecomposedField,
    Phi,
    PlainField,
)
from internal.volume import composite, compute_weights


@struct.dataclass
class Histogram:
    """One level of hierarchical sampling: where along the rays, and how much there."""

    s_edges: Float[Array, "*rays n_edges"]
    weights: Float[Array, "*rays n"]


@struct.dataclass
class Level(Histogram):
    """A level at which the field itself was asked."""

    rgb: Float[Array, "*rays 3"]  # dark colour
    samples: Decomposed | Colored  # ``[rays, n, ...]``


@struct.dataclass
class Rendering:
    """Pixels of the last level; colours are sRGB and may exceed 1."""

    rgb: Float[Array, "*rays 3"]  # the dark picture, c
    depth: Float[Array, "*rays 1"]  # along the camera's axis, model units


@struct.dataclass
class LitRendering(Rendering):
    """A rendering with its decomposition and enhancement (paper, Eqs. 3, 4 and 8)."""

    enhanced: Float[Array, "*rays 3"]  # c_hat
    v: Float[Array, "*rays 1"]
    r: Float[Array, "*rays 3"]
    v_enhanced: Float[Array, "*rays 3"]  # v_hat


@struct.dataclass
class GammaRendering(LitRendering):
    """One that Eq. 8 lit, with its composited coefficients."""

    alpha: Float[Array, "*rays 1"]
    gamma: Float[Array, "*rays 3"]
    gamma_energy: Float[Array, "*rays 1"]  # composited |gamma|^2


class Model(nn.Module):
    """Mip-NeRF whose colour is v * r, with the network phi that lights it up.

    Without ``config.decomposition`` it is plain mip-NeRF and renders ``Rendering``.
    """

    config: ModelConfig

    def setup(self) -> None:
        self.proposal = self.config.field.proposal()
        if self.config.decomposition:
            self.field = DecomposedField(self.config)
            tone = self.config.enhancement == "tone"
            self.phi: Any = Meter() if tone else Phi(self.config)
        else:
            self.field = PlainField(self.config)

    def __call__(
        self, rays: Rays, space: Space, edit: LightEdit
    ) -> Rendering | LitRendering:
        """Renders rays exactly (without randomness), as eval.py and render.py do.

        Returns:
            Pixels; ``LitRendering`` for a decomposed model.
        """
        last = self.march(rays, space)[-1]
        assert isinstance(last, Level)
        if self.config.decomposition:
            return self.light_up(last, space, edit)
        return Rendering(last.rgb, depth(space, last))

    def march(
        self, rays: Rays, space: Space, key: PRNGKeyArray | None = None
    ) -> list[Histogram]:
        """Hierarchical sampling: each level looks closer where the last saw weight.

        Args:
            rays: ``[rays, ...]`` in ``space``.
            space: how distance and position are encoded.
            key: randomises sample positions and density; None does not.

        Returns:
            The levels, coarse first; the last, and all of a field without a
            proposal, are ``Level``.
        """
        count = rays.origins.shape[0]
        s_edges = jnp.broadcast_to(jnp.array([0.0, 1.0]), (count, 2))
        weights = jnp.ones((count, 1))
        levels: list[Histogram] = []
        for level, num_samples in enumerate(self.config.num_samples):
            last = level == len(self.config.num_samples) - 1
            level_key = None if key is None else jax.random.fold_in(key, level)
            if level > 0:
                weights = stepfun.blur_weights(weights, self.config.resample_padding)
            s_edges = _resample(s_edges, weights, num_samples, level_key)
            t_edges = space.s_to_t(s_edges)
            gaussians = self._gaussians(rays, space, t_edges)
            if self.proposal is not None and not last:
                density = nn.softplus(self.proposal(*gaussians) + DENSITY_BIAS)
                weights = compute_weights(density, t_edges, rays.directions)
                levels.append(Histogram(s_edges, weights))
            else:
                noise = self._density_noise((count, num_samples), level_key)
                samples = self.field(*gaussians, rays.viewdirs, noise)
                weights = compute_weights(samples.density, t_edges, rays.directions)
                rgb = composite(weights, samples.rgb)
                levels.append(Level(s_edges, weights, rgb, samples))
            weights = stop_gradient(weights)
        return levels

    def light_up(self, level: Level, space: Space, edit: LightEdit) -> LitRendering:
        """Enhances what a level saw, as ``config.enhancement`` says: v at the samples
        (paper, Eqs. 4 and 8), or the composited colour by one tone curve, of which
        v_hat is the quotient by r.

        Weights, v and r are stopped: the enhancement's losses teach phi alone and
        cannot move the geometry or the decomposition.
        """
        samples = level.samples
        assert isinstance(samples, Decomposed)
        weights, v, r = stop_gradient((level.weights, samples.v, samples.r))
        basis = composite(weights, r)
        parts = {
            "rgb": level.rgb,
            "depth": depth(space, level),
            "v": composite(weights, v),
            "r": basis,
        }
        if self.config.enhancement == "tone":
            dark = stop_gradient(level.rgb)
            enhanced = develop(dark, self.phi(), self.config.tone_contrast, edit)
            v_enhanced = enhanced / jnp.maximum(basis, 1e-6)
            return LitRendering(**parts, enhanced=enhanced, v_enhanced=v_enhanced)
        coefficients: Coefficients = self.phi(v, samples.features)
        v_hat = phi(v, coefficients, self.config.gamma0, edit)
        gamma_energy = jnp.sum(coefficients.gamma**2, axis=-1, keepdims=True)
        return GammaRendering(
            **parts,
            enhanced=composite(weights, v_hat * r),
            v_enhanced=composite(weights, v_hat),
            alpha=composite(weights, coefficients.alpha),
            gamma=composite(weights, coefficients.gamma),
            gamma_energy=composite(weights, gamma_energy),
        )

    def _gaussians(
        self, rays: Rays, space: Space, t_edges: Float[Array, "rays n_edges"]
    ) -> tuple[Float[Array, "rays n 3"], Float[Array, "rays n 3"]]:
        """Means and variances of the cone's sections between the edges."""
        shape = ray_shape(self.config.ray_shape, space)
        section = {
            "cone": mip.conical_frustum_to_gaussian,
            "cylinder": mip.cylinder_to_gaussian,
        }[shape]
        radii = jnp.broadcast_to(rays.radii, t_edges[:, 1:].shape)
        t_mean, t_var, r_var = section(t_edges[:, :-1], t_edges[:, 1:], radii)
        directions = jnp.broadcast_to(rays.directions[:, None], (*t_mean.shape, 3))
        mean = rays.origins[:, None] + t_mean[..., None] * directions
        return space.warp(mean, directions, t_var[..., None], r_var[..., None])

    def _density_noise(
        self, shape: tuple[int, int], key: PRNGKeyArray | None
    ) -> Float[Array, "rays n"]:
        if key is None or self.config.density_noise == 0.0:
            return jnp.zeros(shape)
        noise = jax.random.normal(jax.random.fold_in(key, 1), shape)
        return self.config.density_noise * noise


def ray_shape(wanted: str, space: Space) -> Literal["cone", "cylinder"]:
    """``auto`` is a cylinder in NDC, where pixels do not widen, else a cone."""
    if wanted == "auto":
        return "cylinder" if isinstance(space, ForwardFacing) else "cone"
    return "cone" if wanted == "cone" else "cylinder"


def _resample(
    s_edges: Float[Array, "rays m_edges"],
    weights: Float[Array, "rays m"],
    num_samples: int,
    key: PRNGKeyArray | None,
) -> Float[Array, "rays n_edges"]:
    """Edges of ``num_samples`` intervals of equal weight; the ends stay put."""
    inner = stepfun.stratified_positions(num_samples - 1, s_edges.shape[0], key)
    inner_edges = stepfun.invert_cdf(inner, s_edges, weights)
    return jnp.concatenate([s_edges[:, :1], inner_edges, s_edges[:, -1:]], axis=-1)


def depth(space: Space, level: Level) -> Float[Array, "rays 1"]:
    """Median depth: where half of the light is behind."""
    half = jnp.full_like(level.s_edges[:, :1], 0.5)
    s_median = stepfun.invert_cdf(half, level.s_edges, level.weights)
    return space.depth(space.s_to_t(s_median))
