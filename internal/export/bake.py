# SPDX-License-Identifier: Apache-2.0
"""Splats from a trained field: placed on the surfaces that the views see, then fitted
to the field's own pictures.

A splat stands for a cell of space whose size is a few of the pixels that saw it, so
near and far surfaces get equal detail, and what no view sees gets no splat: it stays
empty rather than black. The field is rendered once per view; what is fitted are
positions, sizes, opacities and colours, by Adam on the squared error of sRGB.
"""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax import Array
from jaxtyping import Float, Int

from internal import progress
from internal.export import rasterizer
from internal.export.density import Density, normals
from internal.export.sightings import Sighting
from internal.export.splats import DILATION, SH0, Pinhole, Splats, pinhole_camera, take
from internal.scene.scene import Scene

STEPS = 110  # of the fit; each looks at one view
RECOLOR_STEPS = 44  # for each further look
FLATNESS = 0.25  # thickness along the normal over the size in the surface
SPARE = 6  # pixels that are looked at for each splat, if there are more
STRETCH = 6.0  # length of a cell along the rays that saw it, in its widths
OVERLAP = 0.6  # standard deviation of a splat, in cells
FIRST_OPTICAL_DEPTH = 4.0  # of all splats in front of a pixel, before fitting
MOST_OPAQUE = 0.9  # before fitting
LEAST_OPACITY = 0.02  # splats that fitting made fainter than that are left out
NEAREST = 0.2  # depth before which no splat is drawn, share of the scene's near
SEARCH_STEPS = 9  # bisections of the cell's size

# How far a step of the fit may take each parameter, at first; points in their sizes.
RATES = {
    "points": 0.03, "log_scales": 0.02, "opacity_logits": 0.1, "harmonics": 0.05,
}  # fmt: skip
LAST_RATE = 0.1  # of the first


Fitted = dict[str, Array]  # parameters of splats by name


@dataclasses.dataclass(frozen=True)
class Target:
    """A view of the field that the splats shall look like."""

    camera: Pinhole
    srgb: Float[np.ndarray, "height width 3"]


@dataclasses.dataclass(frozen=True)
class Surfels:
    """Coloured points of surfaces, and how wide the pixel is there that saw each."""

    points: Float[np.ndarray, "n 3"]
    footprints: Float[np.ndarray, " n"]
    srgb: Float[np.ndarray, "n 3"]
    axes: Int[np.ndarray, " n"]  # x, y or z: nearest to the direction of the ray


def bake(
    scene: Scene,
    sightings: Sequence[Sighting],
    between: Sequence[Sighting],
    density: Density,
    count: int,
    looks: Sequence[str],
) -> dict[str, Splats]:
    """At most ``count`` splats in the model's frame, for each look of the sightings.

    All looks share everything but the colours; the first one decides the rest.

    Args:
        sightings: of the photos' views: splats stand where these see surfaces.
        between: further ones, which the splats shall look like as well.
    """
    views = [*sightings, *between]
    splats = place(scene, sightings, density, count, looks[0])
    baked: dict[str, Splats] = {}
    for look in looks:
        targets = targets_of(scene, views, look)
        rates = {"harmonics": RATES["harmonics"]} if baked else RATES
        steps = RECOLOR_STEPS if baked else STEPS
        fitted = fit_splats(splats, targets, steps, rates)
        for step in progress.track(fitted, steps, f"fitting {look}", "step"):
            splats = step
        if not baked:
            splats = without_faint(splats)
        baked[look] = jax.tree.map(np.asarray, splats)
    return baked


def place(
    scene: Scene,
    sightings: Sequence[Sighting],
    density: Density,
    count: int,
    look: str,
) -> Splats:
    """At most ``count`` splats where sightings see surfaces, not fitted yet."""
    surfels, width = thin_out(see_surfels(sightings, look, SPARE * count), count)
    sizes = OVERLAP * width * surfels.footprints
    outwards = normals(density, scene.space, surfels.points, sizes)
    opacity = first_opacity(width)
    return first_splats(surfels.points, sizes, surfels.srgb, outwards, opacity)


def targets_of(scene: Scene, sightings: Sequence[Sighting], look: str) -> list[Target]:
    """What splats shall look like from where the field was rendered."""
    near = NEAREST * scene.near * scene.model_from_world.scale
    return [
        Target(
            pinhole_camera(sighting.lens, sighting.camtoworld, near),
            sighting.looks[look].astype(np.float32) / 255.0,
        )
        for sighting in sightings
    ]


def see_surfels(sightings: Sequence[Sighting], look: str, enough: int) -> Surfels:
    """Where pixels of all views end; every pixel, unless half of them are enough."""
    pixels = sum(sighting.is_surface.size for sighting in sightings)
    every = max(pixels // enough, 1)
    points, footprints, colors, axes = [], [], [], []
    for sighting in sightings:
        points.append(sighting.points.reshape(-1, 3))
        rays = points[-1] - sighting.camtoworld[:, 3]
        depths = -rays @ sighting.camtoworld[:, 2]
        footprints.append(depths / sighting.lens.params[0])
        axes.append(np.abs(rays).argmax(axis=-1))
        colors.append(sighting.looks[look].reshape(-1, 3) / 255.0)
    parts = (points, footprints, colors, axes)
    return Surfels(*(np.concatenate(part)[::every] for part in parts))


def thin_out(surfels: Surfels, count: int) -> tuple[Surfels, float]:
    """At most ``count`` means of surfels, one for each occupied cell of space.

    Cells are as wide as some number of the footprints in them, in half octaves; that
    number is searched for, and returned. They are longer along the rays: there the
    views disagree, and one splat shall stand for all that they saw of a surface.
    """
    if len(surfels.points) <= count:
        return surfels, 1.0
    low, high = 0.25, 1024.0
    for _ in range(SEARCH_STEPS):
        middle = (low * high) ** 0.5
        if len(np.unique(_cells(surfels, middle))) > count:
            low = middle
        else:
            high = middle
    _, first, group, sizes = np.unique(
        _cells(surfels, high),
        return_index=True, return_inverse=True, return_counts=True,
    )  # fmt: skip

    def mean(values: np.ndarray) -> np.ndarray:
        return np.bincount(group, values) / sizes

    return Surfels(
        np.stack([mean(axis) for axis in surfels.points.T], axis=-1),
        mean(surfels.footprints),
        np.stack([mean(channel) for channel in surfels.srgb.T], axis=-1),
        surfels.axes[first],
    ), high


def _cells(surfels: Surfels, width: float) -> Int[np.ndarray, " n"]:
    """A number for the cell that each surfel lies in."""
    octave = np.round(2.0 * np.log2(surfels.footprints)).astype(np.int64)
    size = width * np.exp2(0.5 * octave)[:, None]
    size = np.where(np.arange(3) == surfels.axes[:, None], STRETCH * size, size)
    place = np.floor(surfels.points / size).astype(np.int64)
    key = 3 * octave + surfels.axes
    for axis in range(3):  # a hash: that two cells share a number is rare
        key = key * 0x9E3779B1 + place[:, axis]
        key = key ^ (key >> 29)
    return key


def first_splats(
    points: Float[np.ndarray, "n 3"],
    sizes: Float[np.ndarray, " n"],
    srgb: Float[np.ndarray, "n 3"],
    outwards: Float[np.ndarray, "n 3"],
    opacity: float,
) -> Splats:
    """Splats as discs on surfaces.

    Args:
        sizes: standard deviations in the surface.
        outwards: unit normals, or zero where unknown: the splat is a ball there.
    """
    scales = np.repeat(sizes[:, None], 3, axis=1)
    scales[np.linalg.norm(outwards, axis=-1) > 0.5, 2] *= FLATNESS
    logit = np.log(opacity / (1.0 - opacity))
    return Splats(
        points.astype(np.float32),
        _quaternions_to(outwards),
        np.log(scales).astype(np.float32),
        np.full(len(sizes), logit, np.float32),
        ((srgb - 0.5) / SH0).astype(np.float32)[:, None],
    )


def first_opacity(width: float) -> float:
    """The opacity at which splats in cells of that many pixels make a surface opaque,
    and no more: a pixel shows the mean of many small splats, not the nearest."""
    variance = (OVERLAP * width) ** 2 + DILATION
    overlapping = 2.0 * np.pi * variance / width**2  # splats over each pixel
    return float(min(1.0 - np.exp(-FIRST_OPTICAL_DEPTH / overlapping), MOST_OPAQUE))


def _quaternions_to(outwards: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 4"]:
    """Rotations w x y z that carry the z axis to unit normals or against them (a disc
    has two sides); none where a normal is zero."""
    x, y, z = np.where(outwards[:, 2:] < 0.0, -outwards, outwards).T
    half = np.stack([1.0 + z, -y, x, np.zeros_like(x)], axis=-1)
    return (half / np.linalg.norm(half, axis=-1, keepdims=True)).astype(np.float32)


def fit_splats(
    splats: Splats,
    targets: Sequence[Target],
    steps: int,
    rates: dict[str, float],
    seed: int = 0,
) -> Iterator[Splats]:
    """Yields the splats after each step of fitting them to one of the targets.

    Colours stay in the range that 8 bits hold: some viewers keep no more.

    Args:
        rates: how far a step may take each parameter that is fitted.
    """
    start = jax.tree.map(jnp.asarray, splats)
    sizes = jnp.exp(start.log_scales.max(axis=-1, keepdims=True))
    optimizer = optimizer_of_fit(steps)
    fitted = {name: getattr(start, name) for name in rates}
    state = optimizer.init(fitted)
    improve = jax.jit(improvement(optimizer, rates, sizes), donate_argnums=2)

    rng = np.random.default_rng(seed)
    for view in views_in_turn(rng, len(targets), steps):
        target = targets[view]
        splats = dataclasses.replace(start, **fitted)
        slopes = rasterizer.gradient(
            splats, target.camera, lambda picture, srgb=target.srgb: picture - srgb
        )
        named = {name: getattr(slopes, name) for name in rates}
        fitted, state = improve(fitted, named, state)
        yield dataclasses.replace(start, **fitted)


def without_faint(splats: Splats) -> Splats:
    """Those that fitting left with a part in the pictures; NumPy arrays."""
    return take(splats, np.asarray(splats.opacities) > LEAST_OPACITY)


def optimizer_of_fit(steps: int) -> optax.GradientTransformation:
    """Adam, in units of the rates, which sink to ``LAST_RATE`` of themselves."""
    return optax.chain(
        optax.scale_by_adam(0.9, 0.99, eps=1e-15),
        optax.scale_by_schedule(optax.cosine_decay_schedule(1.0, steps, LAST_RATE)),
    )


def improvement(
    optimizer: optax.GradientTransformation,
    rates: dict[str, float],
    sizes: Float[Array, "n 1"],
) -> Callable[[Fitted, Fitted, optax.OptState], tuple[Fitted, optax.OptState]]:
    """A step of the fit, from what is fitted, its gradients and the optimiser's state.

    Args:
        sizes: of the splats; points move in units of them.
    """

    def improve(
        fitted: Fitted, slopes: Fitted, state: optax.OptState
    ) -> tuple[Fitted, optax.OptState]:
        direction: Any
        direction, state = optimizer.update(slopes, state)
        steps = {name: rate * direction[name] for name, rate in rates.items()}
        if "points" in steps:
            steps["points"] = sizes * steps["points"]
        fitted = {name: fitted[name] - steps[name] for name in rates}
        base = jnp.clip(fitted["harmonics"][:, :1], -0.5 / SH0, 0.5 / SH0)
        fitted["harmonics"] = fitted["harmonics"].at[:, :1].set(base)
        return fitted, state

    return improve


def views_in_turn(rng: np.random.Generator, views: int, steps: int) -> list[int]:
    """Every view once in random order, then again, until there are ``steps``."""
    rounds = [rng.permutation(views) for _ in range(-(-steps // views))]
    return np.concatenate(rounds)[:steps].tolist()
