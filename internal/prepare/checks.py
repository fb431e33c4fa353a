# SPDX-License-Identifier: Apache-2.0
"""Judges a prepared scene: warnings in plain words, each with what to do.

Pure: numbers go in, sentences come out.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from internal.files.listing import LeftOut
from internal.prepare.statistics import PhotoStatistics

FEWEST_VIEWS = 3
FEW_VIEWS = 10
FEWEST_POINTS = 50
# Per photo. Right poses of LOM's photos at 1 to 1/4 of their light came with 25 to 76,
# wrong ones (by 8 degrees, chair at 1/8) with 8 and a reprojection error of 1.4.
FEWEST_POINTS_PER_VIEW = 12
PLACED_ENOUGH = 0.5
LARGE_ERROR = 2.0  # pixels of the copies
USELESS_ERROR = 3.0
SMALL_ANGLE = 5.0  # degrees between the outermost cameras
DARK_LEVEL = 4.0  # of 255, mean
BRIGHT_LEVEL = 90.0
FEW_LEVELS = 16
NOISY = 0.25  # noise over mean level
NAMES_SHOWN = 5


@dataclasses.dataclass(frozen=True)
class Geometry:
    """How well the cameras fit. Angles in degrees, errors in pixels of the copies."""

    registered: int
    error: float  # mean reprojection, or median epipolar where there are no tracks
    points: int  # 0 where none were found either
    angle: float  # between the outermost cameras, seen from the scene
    has_depth_range: bool


@dataclasses.dataclass(frozen=True)
class Verdict:
    """Whether a scene is fit to train, and what to know before."""

    fit: bool
    warnings: tuple[str, ...]


def rests_on_points(points: int, views: int) -> bool:
    """Whether that many points can hold the cameras of that many views.

    Poses that fit fewer may still be wrong: they bend until those few agree.
    """
    return points >= FEWEST_POINTS_PER_VIEW * views


def judge(
    geometry: Geometry,
    photos: Sequence[PhotoStatistics],
    failed: Sequence[LeftOut],
    stops: float,
    misplaced: Sequence[str] = (),
) -> Verdict:
    """Judges a scene.

    Args:
        photos: statistics of the usable photos.
        failed: photos without a pose, usable or not.
        stops: largest exposure difference of a photo from the others.
        misplaced: photos that do not fit their poses though the others do.
    """
    faults = _faults(geometry, len(photos))
    if misplaced:
        faults.append(
            f"{len(misplaced)} photos do not fit their poses ({_named(misplaced)}): "
            "what they share with the photos nearby lies elsewhere; give them the "
            "poses of the others' frame, or remove them."
        )
    advice = [*_geometry_advice(geometry), *_light_advice(photos, stops)]
    if failed:
        names = _named([f.name for f in failed])
        advice.insert(
            0,
            f"{len(failed)} photos have no pose ({names}); the table says why. "
            "If that part of the scene matters, take more photos there, each "
            "overlapping its neighbours by two thirds.",
        )
    return Verdict(not faults, (*faults, *advice))


def _named(names: Sequence[str]) -> str:
    more = f" and {len(names) - NAMES_SHOWN} more" * (len(names) > NAMES_SHOWN)
    return ", ".join(names[:NAMES_SHOWN]) + more


def _faults(geometry: Geometry, photos: int) -> list[str]:
    """What makes a scene unfit."""
    tests = {
        f"Only {geometry.registered} of {photos} photos have a pose: reshoot with more "
        "overlap and more light, on a tripod.": geometry.registered
        < max(FEWEST_VIEWS, PLACED_ENOUGH * photos),
        f"Poses and matches disagree (by {geometry.error:.1f} pixels): the poses are "
        "wrong or belong to other photos; estimate them again.": not geometry.error
        < USELESS_ERROR,
        f"Only {geometry.points} points were found: photograph things with texture, "
        "in more light.": 0 < geometry.points < FEWEST_POINTS,
        f"Only {geometry.points} points for {geometry.registered} photos: the poses "
        "may be wrong though they fit. More light or bright twins (--pose-images) "
        "help.": geometry.points >= FEWEST_POINTS
        and not rests_on_points(geometry.points, geometry.registered),
        "No depth range: no points that several photos see; give Config.near and "
        "Config.far.": not geometry.has_depth_range,
    }
    return [text for text, is_fault in tests.items() if is_fault]


def _geometry_advice(geometry: Geometry) -> list[str]:
    tests = {
        "The photos show no points under these poses, so whether the poses fit "
        "could be checked between pairs of photos only.": geometry.points == 0,
        f"{geometry.registered} views are few: 20 to 60 make a good scene. Take more "
        "from other places.": geometry.registered < FEW_VIEWS,
        f"Poses fit to {geometry.error:.1f} pixels only, so fine detail will be lost: "
        "use a tripod or shorter exposures against motion blur.": geometry.error
        > LARGE_ERROR,
        f"The camera hardly moved ({geometry.angle:.1f} degrees about the scene): "
        "depth is uncertain. Step sideways between photos.": geometry.angle
        < SMALL_ANGLE,
    }
    return [text for text, holds in tests.items() if holds]


def _light_advice(photos: Sequence[PhotoStatistics], stops: float) -> list[str]:
    mean = float(np.mean([photo.mean for photo in photos]))
    noise = float(np.median([photo.noise for photo in photos]))
    levels = int(np.median([photo.used_levels for photo in photos]))
    tests = {
        f"The photos are very dark (mean {mean:.1f} of 255): 8-bit rounding hides "
        "detail. Expose longer on a tripod, or shoot RAW.": mean < DARK_LEVEL,
        f"The photos are not dark (mean {mean:.0f} of 255): the enhancement is made "
        "for dark ones; configs/nerf.gin trains a plain NeRF.": mean > BRIGHT_LEVEL,
        f"A photo uses only {levels} different levels: colours will be coarse. Expose "
        "longer, or shoot RAW.": levels < FEW_LEVELS,
        f"Noise is {100.0 * noise / max(mean, 1e-6):.0f} % of the brightness: more "
        "photos of each part average it out.": noise > NOISY * mean,
        f"Exposures differ by up to {stops:.1f} stops: lock exposure and white "
        "balance next time. Training evens them out by exposures.json or by points "
        "of a COLMAP model.": stops > 0.0,
    }
    return [text for text, holds in tests.items() if holds]
