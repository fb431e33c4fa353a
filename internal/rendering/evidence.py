# SPDX-License-Identifier: Apache-2.0
"""What stands behind a rendered pixel: photos that saw its place, and their light.

A field fills in what no photo saw, and an enhancement lifts noise like anything else.
Neither shows in a lit picture, so each pixel is traced back: in how many training
photos is its surface in sight, and how many steps of light do they tell apart there?
Depths are renderings' own; levels are 8-bit, 0 to 255, of the mean over channels.
"""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from internal.cameras import Cameras, Lens
from internal.configs import ModelConfig
from internal.coord import Space
from internal.files import templates
from internal.rendering.pictures import Picture, outputs_of
from internal.rendering.surfaces import is_background, surface_points
from internal.scene import colmap
from internal.scene.masks import Mask
from internal.scene.noise import NODES, Noise, expectation
from internal.scene.scene import Scene, posed_cameras
from internal.structs import LitRendering, Rendering

EVIDENCE = "evidence"
EVIDENCE_EXPLANATION = (
    "what was seen and what is guessed: photos and steps of light behind each pixel"
)
# What the photos saw is asked for in pictures of about so many pixels.
WITNESS_PIXELS = 10_000
TOLERANCE = 0.04  # of depths that are to be one surface, share of the distance
ONE_PIXEL = 3  # a point's pixel and its neighbours, along each side

RenderView = Callable[[Cameras], Rendering | LitRendering]


@dataclasses.dataclass(frozen=True)
class Band:
    """A false colour: of what, up to how many steps of light."""

    rgb: tuple[int, int, int]  # sRGB, 8-bit
    meaning: str
    steps: float  # more are of the next band


UNSEEN = Band((214, 39, 40), "no photo saw it: guessed", 0.0)
ALONE = Band((244, 150, 170), "one photo saw it: how far away it is, is guessed", 0.0)
# Lightness grows along them, so that they can be told apart without hues.
BANDS = (
    Band((68, 1, 84), "under 4 steps of light: lifted noise", 4.0),
    Band((49, 104, 142), "4 to 16 steps: large shapes", 16.0),
    Band((53, 183, 121), "16 to 64 steps: texture", 64.0),
    Band((253, 231, 37), "over 64 steps: fine detail", np.inf),
)
LEGEND = (UNSEEN, ALONE, *BANDS)


@dataclasses.dataclass(frozen=True)
class Evidence:
    """What stands behind each pixel."""

    photos: Int[np.ndarray, "height width"]  # that saw its surface
    levels: Float[np.ndarray, "height width"]  # of light in each of them
    steps: Float[np.ndarray, "height width"]  # that all of them together tell apart


@dataclasses.dataclass(frozen=True)
class Witness:
    """A training camera, and how far it sees in each pixel; model units."""

    lens: Lens
    camtoworld: Float[np.ndarray, "3 4"]
    nearest: Float[np.ndarray, "height width"]  # of a pixel and its neighbours
    farthest: Float[np.ndarray, "height width"]
    background: Bool[np.ndarray, "height width"]  # there, too
    mask: Bool[np.ndarray, "_height _width"]  # of its photo; what is masked, none saw

    def sees(
        self, points: Float[np.ndarray, "n 3"], background: Bool[np.ndarray, " n"]
    ) -> Bool[np.ndarray, " n"]:
        """Which points are what it sees, not hidden behind it, outside nor masked.

        Args:
            background: which points lie where a ray met nothing.
        """
        local = (points - self.camtoworld[:, 3]) @ self.camtoworld[:, :3]
        pixels = colmap.project(self.lens, local)
        size = [self.lens.width, self.lens.height]
        seen = np.all((pixels >= 0.0) & (pixels < size), axis=-1)
        index = np.flatnonzero(seen)
        column, row = pixels[index].astype(int).T
        distance = np.linalg.norm(local[index], axis=-1)
        low = (1.0 - TOLERANCE) * self.nearest[row, column]
        high = (1.0 + TOLERANCE) * self.farthest[row, column]
        hit = (low <= distance) & (distance <= high)
        seen[index] = np.where(background[index], self.background[row, column], hit)
        seen[index] &= self._counts(pixels[index])
        return seen

    def _counts(self, pixels: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """Whether what lies at pixels of the lens counts in the photo."""
        size = np.array(self.mask.shape[::-1])
        places = (pixels * size / [self.lens.width, self.lens.height]).astype(int)
        column, row = np.minimum(places, size - 1).T
        return self.mask[row, column]


@dataclasses.dataclass(frozen=True)
class Witnesses:
    """All training cameras, and the noise of their photos."""

    space: Space
    far: float  # depth, model units
    noise_variance: Float[np.ndarray, " nodes"]  # levels, of the colours ``NODES``
    cameras: tuple[Witness, ...]

    def testify(
        self,
        lens: Lens,
        camtoworld: Float[np.ndarray, "3 4"],
        rendering: Rendering | LitRendering,
    ) -> Evidence:
        """What stands behind a picture that was taken through a lens from a pose."""
        depth = np.asarray(rendering.depth, np.float64)[..., 0]
        directions = colmap.lens_directions(lens).reshape(*depth.shape, 3)
        capped = np.minimum(depth, self.far)
        points = surface_points(self.space, camtoworld, directions, capped)
        background = is_background(depth, self.far).ravel()
        flat = points.reshape(-1, 3)
        photos = sum(witness.sees(flat, background).astype(int)
                     for witness in self.cameras)  # fmt: skip
        photos = np.asarray(photos).reshape(depth.shape)
        srgb = np.asarray(rendering.rgb).mean(axis=-1)
        noise = np.sqrt(np.interp(srgb, NODES, self.noise_variance))
        levels = 255.0 * srgb
        return Evidence(photos, levels, levels * np.sqrt(photos) / noise)


def explained_outputs(model: ModelConfig) -> dict[str, str]:
    """``pictures.outputs_of`` a model, and the evidence."""
    return {**outputs_of(model), EVIDENCE: EVIDENCE_EXPLANATION}


def witness_lenses(scene: Scene) -> list[Lens]:
    """Each view's lens, in the size in which its photo is asked."""
    return [shrink(lens, WITNESS_PIXELS) for lens in scene.lenses]


def witness_cameras(scene: Scene) -> list[Cameras]:
    """Each view's camera with that lens."""
    pairs = zip(witness_lenses(scene), scene.cameras.camtoworlds, strict=True)
    return [posed_cameras([lens], np.asarray(pose)[None]) for lens, pose in pairs]


def gather(
    scene: Scene, factor: int, renderings: Sequence[Rendering | LitRendering]
) -> Witnesses:
    """All witnesses from what ``witness_cameras`` of a training split see.

    Args:
        factor: how many pixels of a photo's side are one of the scene's.
    """
    far = scene.model_from_world.scale * scene.far
    camtoworlds = np.asarray(scene.cameras.camtoworlds, np.float64)
    masks = [scene.mask(view) for view in range(len(camtoworlds))]
    asked = zip(witness_lenses(scene), camtoworlds, renderings, masks, strict=True)
    cameras = tuple(witness(scene.space, far, *answer) for answer in asked)
    variance = noise_variance(scene.noise) / factor**2
    return Witnesses(scene.space, far, variance, cameras)


def call_witnesses(scene: Scene, factor: int, render: RenderView) -> Witnesses:
    """``gather`` from what ``render`` makes of single cameras."""
    return gather(scene, factor, [render(x) for x in witness_cameras(scene)])


def witness(
    space: Space,
    far: float,
    lens: Lens,
    camtoworld: Float[np.ndarray, "3 4"],
    rendering: Rendering | LitRendering,
    mask: Mask,
) -> Witness:
    """What a training camera sees by its rendering, ``far`` in model units, where the
    mask of its photo, of any size, lets it.

    A pixel answers for its neighbours, since it stands for many of a larger picture.
    """
    depth = np.asarray(rendering.depth, np.float64)[..., 0]
    directions = colmap.lens_directions(lens).reshape(*depth.shape, 3)
    points = surface_points(space, camtoworld, directions, np.minimum(depth, far))
    distance = np.linalg.norm(points - camtoworld[:, 3], axis=-1)
    return Witness(
        lens,
        camtoworld,
        ndimage.minimum_filter(distance, ONE_PIXEL, mode="nearest"),
        ndimage.maximum_filter(distance, ONE_PIXEL, mode="nearest"),
        ndimage.maximum_filter(is_background(depth, far), ONE_PIXEL, mode="nearest"),
        mask,
    )


def noise_variance(noise: Noise) -> Float[np.ndarray, " nodes"]:
    """Of one photo's pixels in levels, for the colours ``NODES``, rounding included."""
    pairs = zip(noise.floor, noise.growth, strict=True)
    variances = [expectation(*pair)[1] for pair in pairs]
    return np.mean(variances, axis=0)


def shrink(lens: Lens, pixels: int) -> Lens:
    """The same view in at most about so many pixels; a small one stays as it is."""
    ratio = min(np.sqrt(pixels / (lens.width * lens.height)), 1.0)
    width, height = (max(round(ratio * side), 1) for side in (lens.width, lens.height))
    return colmap.scale_lens(lens, width, height)


def false_colors(evidence: Evidence) -> Picture:
    """Each pixel in the colour of its band, sRGB in [0, 1]."""
    limits = [band.steps for band in BANDS[:-1]]
    band = len(LEGEND) - len(BANDS) + np.digitize(evidence.steps, limits)
    place = np.where(evidence.photos < 2, evidence.photos, band)
    return (np.array([b.rgb for b in LEGEND], np.float32) / 255.0)[place]


def legend_html() -> str:
    """A coloured square and a meaning in each line."""
    return templates.fill(Path(__file__).with_name("legend.html"), bands=LEGEND)
