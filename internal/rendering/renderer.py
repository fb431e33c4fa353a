# SPDX-License-Identifier: Apache-2.0
"""Whole pictures from a trained model, in chunks of rays, on all devices."""

from collections.abc import Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Int

from internal import parallel
from internal.cameras import Cameras, cast_rays
from internal.coord import Space
from internal.enhancements.look import NEUTRAL, LightEdit
from internal.models import Model
from internal.structs import LitRendering, Params, Rendering


class Renderer:
    """Renders views of ``cameras`` and any others; compiled once per length of lens
    table, whatever the views' sizes."""

    def __init__(
        self,
        model: Model,
        cameras: Cameras,
        space: Space,
        mesh: jax.sharding.Mesh,
        chunk: int,
    ) -> None:
        """
        Args:
            chunk: rays per call, at most; no more than a view of ``cameras`` has.
        """
        devices = mesh.devices.size
        largest = int(np.max(np.int64(cameras.widths) * np.int64(cameras.heights)))
        rays_per_call = -(-min(chunk, largest) // devices) * devices
        sharding = parallel.batch_sharding(mesh)

        apply: Any = model.apply

        @jax.jit
        def render_chunk(
            params: Params,
            camera: Cameras,
            space: Space,
            edit: LightEdit,
            start: Int[Array, ""],
        ) -> Any:
            width, height = camera.widths[0], camera.heights[0]
            pixel = jnp.minimum(start + jnp.arange(rays_per_call), width * height - 1)
            pixel = jax.lax.with_sharding_constraint(pixel, sharding)
            views = jnp.zeros_like(pixel)
            rays = cast_rays(camera, space, views, pixel % width, pixel // width)
            return apply({"params": params}, rays, space, edit)

        @jax.jit
        def relight_chunk(params: Params, part: LitRendering, edit: LightEdit) -> Any:
            return apply({"params": params}, part, edit, method="relight")

        self._render_chunk = render_chunk
        self._relight_chunk = relight_chunk
        self._rays_per_call = rays_per_call
        self._cameras = cameras
        self._space = parallel.replicate(space, mesh)
        self._mesh = mesh

    def view(
        self, params: Params, view: int, edit: LightEdit = NEUTRAL
    ) -> Rendering | LitRendering:
        """One view of ``cameras``, ``[height, width, channels]``."""
        return self.picture(params, self._cameras.take(np.array([view])), edit)

    def picture(
        self, params: Params, camera: Cameras, edit: LightEdit = NEUTRAL
    ) -> Rendering | LitRendering:
        """What a single camera sees, ``[height, width, channels]``."""
        parts = list(self.parts(params, camera, edit))
        return assemble(parts, int(camera.widths[0]), int(camera.heights[0]))

    def parts(self, params: Params, camera: Cameras, edit: LightEdit) -> Iterator[Any]:
        """The picture of a single camera in chunks of rays, for ``assemble``.

        Each chunk is computed when it is asked for, so a caller may stop between
        two. Cameras whose lens tables have one length share a compilation.
        """
        pixels = int(camera.widths[0]) * int(camera.heights[0])
        placed = parallel.replicate(camera, self._mesh)
        for start in range(0, pixels, self._rays_per_call):
            yield self._render_chunk(params, placed, self._space, edit, start)

    def relit(
        self, params: Params, rendering: LitRendering, edit: LightEdit
    ) -> LitRendering:
        """A finished picture that was rendered under the enhancement's
        ``along_rays(edit)``, under ``edit``; in chunks, as it was rendered."""
        height, width, _ = rendering.rgb.shape
        flat = jax.tree.map(lambda x: x.reshape(height * width, -1), rendering)

        def part(start: int) -> LitRendering:
            rows = np.arange(start, start + self._rays_per_call)
            return jax.tree.map(lambda x: x.take(rows, axis=0, mode="clip"), flat)

        starts = range(0, height * width, self._rays_per_call)
        parts = [self._relight_chunk(params, part(start), edit) for start in starts]
        return assemble(parts, width, height)


def assemble(parts: Sequence[Any], width: int, height: int) -> Any:
    """Joins all parts of a picture, NumPy ``[height, width, channels]``.

    On the host: pictures come in many shapes, and each would be compiled.
    """

    def join(*chunks: Array) -> np.ndarray:
        pixels = np.concatenate([np.asarray(chunk) for chunk in chunks])
        return pixels[: width * height].reshape(height, width, -1)

    return jax.tree.map(join, *parts)
