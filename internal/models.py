# SPDX-License-Identifier: Apache-2.0
"""LLNeRF on one screen: sample, ask the field, composite, enhance.

Rays are flat, ``[rays, ...]``. A ``Space`` says where the samples lie.
"""

import dataclasses
from typing import Literal

import jax
import jax.numpy as jnp
from flax import linen as nn
from jax import Array
from jax.lax import stop_gradient
from jaxtyping import Float, PRNGKeyArray

from internal import mip, stepfun
from internal.cameras import Rays
from internal.configs import ModelConfig
from internal.coord import Space
from internal.enhancements.look import LightEdit
from internal.heads import DecomposedField, PlainField, density_of
from internal.structs import (
    Decomposed,
    Histogram,
    Level,
    Levels,
    LitRendering,
    Rendering,
)
from internal.volume import composite, compute_weights, with_gradient


class Model(nn.Module):
    """Mip-NeRF whose colour is v * r, with an enhancement that lights it up.

    Without ``config.enhancement`` it is plain mip-NeRF and renders ``Rendering``.
    """

    config: ModelConfig

    def setup(self) -> None:
        config = self.config
        self.proposal = config.field.proposal()
        heads = config.field, config.head_width, config.deg_view
        if config.enhancement is None:
            self.field = PlainField(*heads)
        else:
            self.field = DecomposedField(*heads)
            self.enhancement = config.enhancement.network("enhancement")

    def __call__(
        self, rays: Rays, space: Space, edit: LightEdit
    ) -> Rendering | LitRendering:
        """Renders rays exactly (without randomness), as eval.py and render.py do.

        Returns:
            Pixels; ``LitRendering`` for a model with an enhancement.
        """
        last = self.march(rays, space).last
        if self.config.enhancement is None:
            return Rendering(last.rgb, depth(space, last))
        return self.light_up(last, space, edit)

    def march(
        self, rays: Rays, space: Space, key: PRNGKeyArray | None = None
    ) -> Levels:
        """Hierarchical sampling: each level looks closer where the last saw weight.

        Args:
            rays: ``[rays, ...]`` in ``space``.
            space: how distance and position are encoded.
            key: randomises sample positions and density; None does not.
        """
        count = rays.origins.shape[0]
        s_edges = jnp.broadcast_to(jnp.array([0.0, 1.0]), (count, 2))
        weights = jnp.ones((count, 1))
        proposals: list[Histogram] = []
        levels: list[Level] = []
        for number, num_samples in enumerate(self.config.num_samples):
            last = number == len(self.config.num_samples) - 1
            level_key = None if key is None else jax.random.fold_in(key, number)
            if number > 0:
                weights = stepfun.blur_weights(weights, self.config.resample_padding)
            s_edges = _resample(s_edges, weights, num_samples, level_key)
            if self.proposal is not None and not last:
                proposals.append(self._propose(rays, space, s_edges))
                weights = stop_gradient(proposals[-1].weights)
            else:
                levels.append(self._ask_field(rays, space, s_edges, level_key))
                weights = stop_gradient(levels[-1].weights)
        return Levels(tuple(proposals), tuple(levels[:-1]), levels[-1])

    def light_up(self, level: Level, space: Space, edit: LightEdit) -> LitRendering:
        """Enhances what a level saw.

        All of it is stopped: the enhancement's losses teach the enhancement alone and
        cannot move the geometry or the decomposition.
        """
        level = stop_gradient(level)
        assert isinstance(level.samples, Decomposed)
        return LitRendering(
            rgb=level.rgb,
            depth=depth(space, level),
            v=composite(level.weights, level.samples.v),
            r=composite(level.weights, level.samples.r),
            lit=self.enhancement(level, edit),
        )

    def relight(self, rendering: LitRendering, edit: LightEdit) -> LitRendering:
        """The same pixels under ``edit``, of a rendering under the enhancement's
        ``along_rays(edit)``."""
        lit = self.enhancement.relight(rendering, edit)
        return dataclasses.replace(rendering, lit=lit)

    def _propose(
        self, rays: Rays, space: Space, s_edges: Float[Array, "rays n_edges"]
    ) -> Histogram:
        """Where the field's proposal expects something."""
        assert self.proposal is not None
        t_edges = space.s_to_t(s_edges)
        density = density_of(self.proposal(*self._gaussians(rays, space, t_edges)))
        return Histogram(s_edges, compute_weights(density, t_edges, rays.directions))

    def _ask_field(
        self,
        rays: Rays,
        space: Space,
        s_edges: Float[Array, "rays n_edges"],
        key: PRNGKeyArray | None,
    ) -> Level:
        """What the field holds between the edges, and its colour along the rays."""
        t_edges = space.s_to_t(s_edges)
        gaussians = self._gaussians(rays, space, t_edges)
        noise = self._density_noise(s_edges[:, 1:].shape, key)
        samples = self.field(*gaussians, rays.viewdirs, noise)
        if self.config.near_reach:
            t_mean = 0.5 * (t_edges[:, :-1] + t_edges[:, 1:])
            share = space.gradient_share(t_mean, self.config.near_reach)
            samples = with_gradient(samples, share)
        weights = compute_weights(samples.density, t_edges, rays.directions)
        return Level(s_edges, weights, composite(weights, samples.rgb), samples)

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
        self, shape: tuple[int, ...], key: PRNGKeyArray | None
    ) -> Float[Array, "rays n"]:
        if key is None or self.config.density_noise == 0.0:
            return jnp.zeros(shape)
        noise = jax.random.normal(jax.random.fold_in(key, 1), shape)
        return self.config.density_noise * noise


def ray_shape(wanted: str, space: Space) -> Literal["cone", "cylinder"]:
    """``auto`` is a cylinder in NDC, where pixels do not widen, else a cone."""
    if wanted == "auto":
        return "cylinder" if space.faces_one_way else "cone"
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
