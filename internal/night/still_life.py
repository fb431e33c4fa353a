# SPDX-License-Identifier: Apache-2.0
"""What stands on the desk of the synthetic night scene, and what lights it.

World frame: OpenGL (x right, y up, z towards the viewer), unit one decimetre. The
desk top is y = 0, a brick wall rises behind it at z = -3.6. Colours are written as
sRGB in [0, 1], as one picks them, and stored as linear RGB; ``radiance`` is linear.
"""

import dataclasses
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from internal.color import srgb_to_linear
from internal.night.raytrace import Solids
from internal.night.shading import Lamps, World
from internal.night.textures import Material, Pattern

Triple = tuple[float, float, float]
SHAPES = ("sphere", "box", "cylinder")
BLACK = (0.0, 0.0, 0.0)
FLAME = (-2.55, 1.13, 1.5)
GLOBE_LAMP = (2.75, 2.35, -1.7)


@dataclasses.dataclass(frozen=True)
class Item:
    """One solid: a unit shape, stretched, turned about x then y, and moved."""

    shape: str  # one of SHAPES
    center: Triple  # decimetres
    half_sizes: Triple  # decimetres
    material: Material
    turn: float = 0.0  # degrees about y
    tilt: float = 0.0  # degrees about x, before the turn


def build_world() -> World:
    """The desk at night, lit so that the mean sRGB level of a view is about 0.45."""
    items = sorted(_items(), key=lambda item: SHAPES.index(item.shape))
    counts = [sum(item.shape == shape for item in items) for shape in SHAPES]
    maps = np.stack([_object_from_world(item) for item in items])
    half_sizes = np.array([item.half_sizes for item in items], np.float32)
    return World(
        solids=Solids(
            object_from_world=jnp.asarray(maps),
            half_sizes=jnp.asarray(half_sizes),
            spheres=counts[0],
            boxes=counts[1],
        ),
        materials=jax.tree.map(
            lambda *leaves: jnp.stack(leaves), *(item.material for item in items)
        ),
        lamps=_lamps(),
        ambient=jnp.array([0.21, 0.2, 0.225]),
    )


def _lamps() -> Lamps:
    """A warm globe, a warm ceiling light, cool light of a window, a candle."""
    return Lamps(
        centers=jnp.array([GLOBE_LAMP, (-5.0, 8.0, 6.0), (8.5, 6.0, 4.0), FLAME]),
        radii=jnp.array([0.6, 1.1, 1.6, 0.1]),
        radiances=jnp.array(
            [
                (8.5, 5.6, 2.9),
                (66.0, 55.0, 41.0),
                (10.5, 15.5, 24.0),
                (50.0, 27.0, 10.0),
            ]
        ),
    )


def _items() -> Iterator[Item]:
    yield from _room()
    yield from _books()
    yield from _plant()
    yield from _lights()
    yield from _front_row()
    yield from _chart()


def _chart() -> Iterator[Item]:
    """The colour chart, leaning on a block of wood."""
    yield Item(
        "box",
        (0.75, 1.5, -1.7),
        (1.2, 0.85, 0.05),
        _material(Pattern.CHART, BLACK, BLACK, grain_scale=1.0, roughness=0.7),
        turn=-6.0,
        tilt=-10.0,
    )
    block = _material(
        Pattern.WOOD, (0.20, 0.12, 0.08), (0.50, 0.34, 0.22), cell=0.8,
        grain_scale=(0.4, 2.0, 2.0), roughness=0.6,
    )  # fmt: skip
    yield Item("box", (0.75, 0.33, -1.6), (1.0, 0.33, 0.3), block, turn=-6.0)


def _room() -> Iterator[Item]:
    wood = _material(
        Pattern.WOOD,
        (0.34, 0.19, 0.11),
        (0.80, 0.56, 0.35),
        cell=1.7,
        grain_scale=(0.22, 1.6, 1.6),
        roughness=0.42,
    )
    brick = _material(
        Pattern.BRICK,
        (0.80, 0.75, 0.68),
        (0.62, 0.24, 0.14),
        cell=0.62,
        grain_scale=1.7,
    )
    yield Item("box", (0.0, -0.5, 2.0), (16.0, 0.5, 8.0), wood)
    yield Item("box", (0.0, 6.0, -4.0), (18.0, 8.0, 0.4), brick)


def _books() -> Iterator[Item]:
    covers = ((0.10, 0.28, 0.42), (0.58, 0.12, 0.13), (0.16, 0.38, 0.22))
    sizes = ((1.3, 0.21, 0.9), (1.15, 0.17, 0.82), (1.05, 0.24, 0.74))
    bottom = 0.0
    for cover, size, turn in zip(covers, sizes, (8.0, 22.0, -5.0), strict=True):
        paper = (0.90, 0.82, 0.62)
        cloth = _material(Pattern.BOOK, cover, paper, grain_scale=9.0, roughness=0.55)
        bottom += size[1]
        yield Item("box", (-1.75, bottom, -0.9), size, cloth, turn=turn)
        bottom += size[1]
    sea = _material(
        Pattern.GLOBE, (0.14, 0.38, 0.62), (0.86, 0.74, 0.38), grain_scale=1.6,
        roughness=0.3,
    )  # fmt: skip
    brass = _metal((0.86, 0.66, 0.32), roughness=0.35)
    yield Item("cylinder", (-1.75, bottom + 0.05, -0.9), (0.4, 0.05, 0.4), brass)
    yield _ball((-1.75, bottom + 0.7, -0.9), 0.64, sea)


def _plant() -> Iterator[Item]:
    clay = _material(
        Pattern.STRIPES, (0.66, 0.34, 0.22), (0.84, 0.56, 0.40), cell=0.42,
        grain_scale=3.0,
    )  # fmt: skip
    leaf = _material(
        Pattern.MOTTLED, (0.12, 0.34, 0.14), (0.52, 0.74, 0.32), grain_scale=3.5,
        roughness=0.45,
    )  # fmt: skip
    x, z = -3.75, -2.5
    yield Item("cylinder", (x, 0.5, z), (0.62, 0.5, 0.62), clay)
    for number in range(9):
        turn = 40.0 * number + (17.0 if number % 2 else 0.0)
        lean = 28.0 if number % 2 else 56.0
        axis = Rotation.from_euler("YX", [turn, lean], degrees=True).apply([0, 1, 0])
        center = np.array([x, 0.95, z]) + 0.72 * axis
        yield Item("sphere", tuple(center), (0.2, 0.75, 0.07), leaf, turn, lean)


def _lights() -> Iterator[Item]:
    brass = _metal((0.80, 0.62, 0.34), roughness=0.3)
    x, y, z = GLOBE_LAMP
    yield Item("cylinder", (x, 0.07, z), (0.5, 0.07, 0.5), brass)
    yield Item("cylinder", (x, 1.0, z), (0.07, 1.0, 0.07), brass)
    yield _ball(GLOBE_LAMP, 0.6, _glow((0.96, 0.83, 0.58)))
    wax = _material(
        Pattern.MOTTLED, (0.86, 0.78, 0.64), (0.96, 0.92, 0.82), grain_scale=4.0,
        roughness=0.5,
    )  # fmt: skip
    yield Item("cylinder", (FLAME[0], 0.45, FLAME[2]), (0.27, 0.45, 0.27), wax)
    yield Item("sphere", FLAME, (0.07, 0.18, 0.07), _glow((1.0, 0.83, 0.45)))
    for number, x in enumerate(np.linspace(-5.4, 5.4, 13)):
        y = 2.75 + 0.35 * np.cos(np.pi * x / 1.8)
        color = ((1.0, 0.8, 0.5), (1.0, 0.62, 0.5), (0.7, 0.85, 1.0))[number % 3]
        yield _ball((float(x), float(y), -3.5), 0.09, _glow(color))


def _front_row() -> Iterator[Item]:
    steel = _metal((0.90, 0.90, 0.92), roughness=0.16)
    ball = _material(
        Pattern.STRIPES, (0.78, 0.20, 0.12), (0.93, 0.85, 0.66), cell=0.36,
        grain_scale=1.5, roughness=0.8,
    )  # fmt: skip
    glaze = _material(
        Pattern.CUP, (0.20, 0.10, 0.06), (0.86, 0.84, 0.80), cell=0.29,
        grain_scale=5.0, roughness=0.22,
    )  # fmt: skip
    plum = _material(
        Pattern.MOTTLED, (0.30, 0.07, 0.26), (0.66, 0.24, 0.52), grain_scale=2.5,
        roughness=0.2,
    )  # fmt: skip
    tiles = _material(
        Pattern.CHECKER, (0.16, 0.24, 0.26), (0.80, 0.74, 0.58), cell=0.3,
        grain_scale=6.0, roughness=0.6,
    )  # fmt: skip
    yield _ball((-1.15, 0.5, 1.25), 0.5, ball, turn=30.0, tilt=35.0)
    yield _ball((0.2, 0.58, 0.75), 0.58, steel)
    saucer = _material(
        Pattern.MOTTLED, (0.76, 0.74, 0.70), (0.86, 0.84, 0.80), grain_scale=5.0,
        roughness=0.22,
    )  # fmt: skip
    yield Item("cylinder", (1.65, 0.05, 1.0), (0.72, 0.05, 0.72), saucer)
    yield Item("cylinder", (1.65, 0.55, 1.0), (0.42, 0.46, 0.42), glaze)
    yield Item("box", (2.95, 0.4, 0.25), (0.55, 0.4, 0.45), tiles, turn=31.0)
    yield _ball((2.95, 1.12, 0.25), 0.32, plum)


def _ball(
    center: Triple,
    radius: float,
    material: Material,
    *,
    turn: float = 0.0,
    tilt: float = 0.0,
) -> Item:
    return Item("sphere", center, (radius, radius, radius), material, turn, tilt)


def _material(
    pattern: Pattern,
    first: Triple,
    second: Triple,
    *,
    grain_scale: float | Triple,
    cell: float = 1.0,
    roughness: float = 0.9,
) -> Material:
    """A surface of two sRGB colours."""
    return Material(
        pattern=jnp.array(int(pattern)),
        colors=srgb_to_linear(jnp.array([first, second], jnp.float32)),
        cell=jnp.array(cell, jnp.float32),
        grain_scale=jnp.broadcast_to(jnp.array(grain_scale, jnp.float32), 3),
        roughness=jnp.array(roughness, jnp.float32),
        metalness=jnp.array(0.0),
        emission=jnp.zeros(3),
    )


def _metal(color: Triple, *, roughness: float) -> Material:
    """Slightly stained metal of one sRGB colour."""
    red, green, blue = color
    stained = (0.9 * red, 0.9 * green, 0.9 * blue)
    metal = _material(
        Pattern.MOTTLED, stained, color, grain_scale=3.0, roughness=roughness
    )
    return dataclasses.replace(metal, metalness=jnp.array(1.0))


def _glow(color: Triple) -> Material:
    """The face of a lamp, as frosted glass shows it: dimmer than the light it casts.

    A lamp that looked as bright as it shines would clip over all of its face.
    """
    glass = _material(Pattern.MOTTLED, BLACK, BLACK, grain_scale=1.0)
    emission = srgb_to_linear(jnp.array(color))
    return dataclasses.replace(glass, emission=emission)


def _object_from_world(item: Item) -> Float[np.ndarray, "3 4"]:
    """Undoes the item's move, turn, tilt and stretch."""
    turn = Rotation.from_euler("YX", [item.turn, item.tilt], degrees=True)
    linear = turn.inv().as_matrix() / np.array(item.half_sizes)[:, None]
    return np.concatenate(
        [linear, -linear @ np.array(item.center)[:, None]], axis=1
    ).astype(np.float32)
