# SPDX-License-Identifier: Apache-2.0
"""The density of a trained field at points of space, without rays."""

from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from internal.coord import Space
from internal.models import Model
from internal.structs import Params

POINTS_PER_CALL = 65_536

Density = Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, " n"]]


def make_density(model: Model, params: Params, footprint: float) -> Density:
    """A function from points in field space to density.

    Args:
        footprint: standard deviation, along each axis, of the Gaussians that the
            field is asked about; details smaller than that are not seen.
    """
    apply: Any = model.apply

    def at_points(module: Model, points: Float[Array, "n 3"]) -> Float[Array, " n"]:
        mean = points[:, None]
        variance = jnp.full_like(mean, footprint**2)
        ahead = jnp.broadcast_to(jnp.array([0.0, 0.0, -1.0]), points.shape)
        samples = module.field(mean, variance, ahead, jnp.zeros(mean.shape[:2]))
        return samples.density[:, 0]

    call = jax.jit(lambda params, p: apply({"params": params}, p, method=at_points))

    def density(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        values = [np.zeros(0, np.float32)]
        for count, some in in_calls(points):
            values.append(np.asarray(call(params, *some))[:count])
        return np.concatenate(values)

    return density


def in_calls(
    *where: Float[np.ndarray, "n ..."],
) -> Iterator[tuple[int, list[Float[np.ndarray, "m ..."]]]]:
    """What to ask a field about points, ``POINTS_PER_CALL`` at a time: how many are
    asked about, and the float32 arrays, brought to that length by the last point so
    that one program is compiled."""
    for start in range(0, len(where[0]), POINTS_PER_CALL):
        some = [x[start : start + POINTS_PER_CALL] for x in where]
        count = len(some[0])
        yield count, [_padded(np.asarray(x, np.float32)) for x in some]


def _padded(values: Float[np.ndarray, "some ..."]) -> Float[np.ndarray, "m ..."]:
    missing = POINTS_PER_CALL - len(values)
    return np.pad(values, [(0, missing)] + [(0, 0)] * (values.ndim - 1), "edge")


def normals(
    density: Density,
    space: Space,
    points: Float[np.ndarray, "n 3"],
    steps: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "n 3"]:
    """Unit vectors against the gradient of density, in the model's frame.

    By central differences of ``steps``, which no field has to be differentiable
    for. Where density is flat the normal is zero.
    """
    gradient = np.empty_like(points)
    for axis in range(3):
        shift = np.zeros_like(points)
        shift[:, axis] = steps
        after, before = (
            density(space.to_field(points + sign * shift)) for sign in (1, -1)
        )
        gradient[:, axis] = after - before
    lengths = np.linalg.norm(gradient, axis=-1, keepdims=True)
    return -gradient / np.where(lengths > 0.0, lengths, 1.0)
