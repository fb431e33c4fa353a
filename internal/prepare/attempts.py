# SPDX-License-Identifier: Apache-2.0
"""Ways to recover cameras from dark photos, tried in turn until one places enough.

The order was measured (docs/your_photos.md): most photos need the first alone. Each
way keeps its copies and its database in a folder of its own, so that an interrupted
run goes on where it was.
"""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from internal import progress
from internal.files import image_io
from internal.prepare import mapping, matching
from internal.prepare.brighten import AS_IT_IS, Recipe, make_copy
from internal.prepare.checks import rests_on_points
from internal.prepare.mapping import Mapped
from internal.prepare.matching import Copy

ENOUGH = 0.98  # of the photos: no further way is tried
LOW_CONTRAST = 0.002  # peak threshold of SIFT; COLMAP's own is three times as high
HIGH_CONTRAST = 0.02 / 3.0

ReadView = Callable[[int], Float[np.ndarray, "_height _width 3"]]


@dataclasses.dataclass(frozen=True)
class Way:
    """How cameras are looked for. Ways of one ``folder`` share copies and matches."""

    name: str
    folder: str
    recipe: Recipe
    peak_threshold: float
    exhaustive: bool  # all pairs, however many photos there are
    globally: bool  # all cameras at once instead of one after the other


_LIGHT_BLUR = Recipe(brighten=True, blur=1.0)
_STRONG_BLUR = Recipe(brighten=True, blur=2.0)
WAYS = (
    Way("brightened", "blur_1", _LIGHT_BLUR, LOW_CONTRAST, False, False),
    Way("brightened, all pairs", "blur_1", _LIGHT_BLUR, LOW_CONTRAST, True, False),
    Way("brightened, more blur", "blur_2", _STRONG_BLUR, LOW_CONTRAST, True, False),
    Way(
        "brightened, more blur, all at once",
        *("blur_2", _STRONG_BLUR, LOW_CONTRAST, True, True),
    ),
)
# What COLMAP does by itself: the baseline, and the way for bright twins.
PLAIN = Way("as it is", "plain", AS_IT_IS, HIGH_CONTRAST, True, False)


@dataclasses.dataclass(frozen=True)
class Attempt:
    """What a way found."""

    way: Way
    database: Path
    models: tuple[Mapped, ...]  # the largest first; may be none

    @property
    def registered(self) -> int:
        """Number of photos with a pose."""
        return len(self.models[0].views) if self.models else 0

    @property
    def points(self) -> int:
        """Number of sparse points."""
        return self.models[0].points if self.models else 0

    @property
    def solid(self) -> bool:
        """Whether there are poses, held by points enough to be trusted."""
        return bool(self.models) and rests_on_points(self.points, self.registered)

    @property
    def rank(self) -> tuple[bool, int, float]:
        """Smaller is better: poses to be trusted, many of them, small errors."""
        return not self.solid, -self.registered, self.error

    def describe(self, views: int) -> str:
        """What it found, in a few words."""
        placed = f"{self.registered} of {views} photos placed"
        if not self.models:
            return placed
        return f"{placed}, error {self.error:.2f} pixels, {self.points} points"

    @property
    def error(self) -> float:
        """Mean reprojection error in pixels of the copies; infinite without model."""
        return self.models[0].error if self.models else float("inf")


def try_ways(
    ways: Sequence[Way], copies: Sequence[Copy], read: ReadView, work: Path
) -> list[Attempt]:
    """Tries ways until one places ``ENOUGH`` of the photos; prints what each found.

    Args:
        copies: of the views, in order.
        read: the picture that a view's copy is made of, sRGB in [0, 1].
        work: folder for copies and databases.

    Returns:
        Attempts, the best first (``Attempt.rank``).
    """
    attempts = []
    for way in _different(ways, len(copies)):
        print(f"trying: {way.name}", flush=True)
        attempt = _try_way(way, copies, read, work)
        attempts.append(attempt)
        print(f"  {attempt.describe(len(copies))}", flush=True)
        if attempt.solid and attempt.registered >= ENOUGH * len(copies):
            break
    return sorted(attempts, key=lambda attempt: attempt.rank)


def make_copies(recipe: Recipe, count: int, read: ReadView, folder: Path) -> None:
    """Writes the copies that are not there yet; shows progress."""
    folder.mkdir(parents=True, exist_ok=True)
    for view in progress.track(range(count), count, "brightening", "photo"):
        path = folder / matching.copy_name(view)
        if not path.is_file():
            image_io.write(path, make_copy(read(view), recipe))


def _try_way(way: Way, copies: Sequence[Copy], read: ReadView, work: Path) -> Attempt:
    folder = work / way.folder
    database = folder / "database.db"
    make_copies(way.recipe, len(copies), read, folder)
    matching.extract_features(database, folder, copies, way.peak_threshold)
    exhaustive = way.exhaustive or len(copies) <= matching.EXHAUSTIVE_UP_TO
    matching.match(database, matching.choose_pairs(len(copies), exhaustive=exhaustive))
    if way.globally:
        models = mapping.map_globally(database, folder, len(copies))
    else:
        models = mapping.map_incrementally(database, folder, len(copies))
    return Attempt(way, database, tuple(models))


def _different(ways: Sequence[Way], count: int) -> Iterator[Way]:
    """Leaves out ways that match all pairs where an earlier one did so already."""
    done = set()
    for way in ways:
        exhaustive = way.exhaustive or count <= matching.EXHAUSTIVE_UP_TO
        key = (way.folder, exhaustive, way.globally)
        if key not in done:
            done.add(key)
            yield way
