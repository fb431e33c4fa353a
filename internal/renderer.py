# SPDX-License-Identifier: Apache-2.0
"""Whole pictures from a trained model, in chunks of rays, on all devices."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Int

from internal import parallel
from internal.cameras import Cameras, cast_rays
from internal.coord import Space
from internal.editing import NEUTRAL, LightEdit
from internal.models import LitRendering, Model, Rendering
from internal.training import Params


class Renderer:
    """Renders views of ``cameras``; compiled once, whatever the views' sizes."""

    def __init__(
        self,
        model: Model,
        cameras: Cameras,
        space: Space,
        mesh: jax.sharding.Mesh,
        chunk: int,
    ) -> None:
        devices = mesh.devices.size
        rays_per_call = -(-chunk // devices) * devices
        sharding = parallel.batch_sharding(mesh)

        apply: Any = model.apply

        @jax.jit
        def render_chunk(
            params: Params,
            cameras: Cameras,
            space: Space,
            edit: LightEdit,
            view: Int[Array, ""],
            start: Int[Array, ""],
        ) -> Rendering | LitRendering:
            width, height = cameras.widths[view], cameras.heights[view]
            pixel = jnp.minimum(start + jnp.arange(rays_per_call), width * height - 1)
            pixel = jax.lax.with_sharding_constraint(pixel, sharding)
            views = jnp.full_like(pixel, view)
            rays = cast_rays(cameras, space, views, pixel % width, pixel // width)
            return apply({"params": params}, rays, space, edit)

        self._render_chunk = render_chunk
        self._rays_per_call = rays_per_call
        self._fixed = parallel.replicate((cameras, space), mesh)
        self._widths = np.asarray(cameras.widths)
        self._heights = np.asarray(cameras.heights)

    def view(
        self, params: Params, view: int, edit: LightEdit = NEUTRAL
    ) -> Rendering | LitRendering:
        """All pixels of one view, ``[height, width, channels]``."""
        width, height = int(self._widths[view]), int(self._heights[view])
        chunks = [
            self._render_chunk(params, *self._fixed, edit, view, start)
            for start in range(0, width * height, self._rays_per_call)
        ]

        def assemble(*parts: Array) -> Array:
            pixels = jnp.concatenate(parts)[: width * height]
            return pixels.reshape(height, width, -1)

        return jax.tree.map(assemble, *chunks)
