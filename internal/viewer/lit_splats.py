# SPDX-License-Identifier: Apache-2.0
"""Splats to walk on: those that export.py baked, or baked here, under any light.

The field is asked once at the place of each splat, as the nearest photo's camera sees
it; its enhancement then lights these samples as it lights rays. A splat takes its
baked colour times what a look changes there.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, UInt8
from scipy.spatial import KDTree

from internal.color import to_uint8
from internal.coord import Space
from internal.enhancements.look import LightEdit, Look
from internal.errors import UserError
from internal.export import splat_files
from internal.export.density import in_calls
from internal.export.splats import Splats, base_colors, carry_over
from internal.files.made_folder import RECORD, read_record
from internal.models import Model
from internal.scene.scene import Scene
from internal.structs import Colored, Level, Params

EXPORTED, FILE = "export", "splats.ply"
FAINT = 1e-3  # sRGB; added to both sides of a change, so that black stays black

Recolor = Callable[[Look], UInt8[np.ndarray, "n 3"]]


@dataclasses.dataclass(frozen=True, eq=False)
class Baked:
    """Splats in the model's frame."""

    splats: Splats
    look: Look  # that their colours have
    step: int  # of the checkpoint they show

    @property
    def srgb(self) -> Float[np.ndarray, "n 3"]:
        """As baked, the same from all sides."""
        return np.clip(base_colors(np.asarray(self.splats.harmonics)), 0.0, 1.0)


def exported(run: Path, scene: Scene) -> Baked | None:
    """What ``export.py --splats`` left in a run's folder, if it did.

    Raises:
        UserError: a file is broken.
    """
    folder = run / EXPORTED
    if not (folder / FILE).is_file():
        return None
    record = read_record(folder)
    if record is None:
        raise UserError(f"{folder / RECORD}: cannot be read; export anew")
    made_with = record["settings"]
    look = Look(
        **{field.name: made_with[field.name] for field in dataclasses.fields(Look)}
    )
    splats = splat_files.read_ply(folder / FILE)
    return Baked(carry_over(splats, scene.model_from_world), look, made_with["step"])


def recolorer(
    model: Model,
    params: Params,
    space: Space,
    centres: Float[np.ndarray, "views 3"],
    baked: Baked,
) -> Recolor:
    """The splats' colours under a look.

    Of a model without an enhancement they are as baked under every look.

    Args:
        centres: where the photos were taken.
    """
    if model.config.enhancement is None:
        return lambda look: to_uint8(baked.srgb)
    apply: Any = model.apply
    points = np.asarray(baked.splats.points, np.float64)
    rays = points - centres[KDTree(centres).query(points)[1]]
    rays /= np.maximum(np.linalg.norm(rays, axis=-1, keepdims=True), 1e-9)
    places = space.to_field(points)
    variances = np.exp(2.0 * np.asarray(baked.splats.log_scales).max(axis=-1))
    level = _sample(model, params, places, variances, rays)

    @jax.jit
    def lit(level: Level, edit: LightEdit) -> Float[Array, "n 3"]:
        return apply({"params": params}, level, edit, method=_light)

    before = (baked.srgb + FAINT) / (lit(level, baked.look.edit()) + FAINT)

    @jax.jit
    def recolor(level: Level, edit: LightEdit) -> UInt8[Array, "n 3"]:
        srgb = before * (lit(level, edit) + FAINT) - FAINT
        return jnp.round(255.0 * jnp.clip(srgb, 0.0, 1.0)).astype(jnp.uint8)

    return lambda look: np.asarray(recolor(level, look.edit()))


def _light(module: Model, level: Level, edit: LightEdit) -> Float[Array, "n 3"]:
    return module.enhancement(level, edit).enhanced


def _sample(model: Model, params: Params, *where: Float[np.ndarray, "n ..."]) -> Level:
    """What the field holds at points, as rays with one sample each.

    Args:
        where: points in field space, variances, unit directions of sight.
    """
    apply: Any = model.apply
    ask = jax.jit(lambda *where: apply({"params": params}, *where, method=_ask))
    calls = [ask(*some) for _, some in in_calls(*where)]
    return jax.tree.map(lambda *x: jnp.concatenate(x)[: len(where[0])], *calls)


def _ask(
    module: Model,
    points: Float[Array, "n 3"],
    variances: Float[Array, " n"],
    directions: Float[Array, "n 3"],
) -> Level:
    mean = points[:, None]
    variance = jnp.broadcast_to(variances[:, None, None], mean.shape)
    samples = module.field(mean, variance, directions, jnp.zeros(mean.shape[:2]))
    assert not isinstance(samples, Colored)
    whole, edges = jnp.ones((len(points), 1)), jnp.zeros((len(points), 2))
    return Level(edges, whole, samples.rgb[:, 0], samples)
