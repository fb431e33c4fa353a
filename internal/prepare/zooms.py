# SPDX-License-Identifier: Apache-2.0
"""Photos of one camera at several zooms, told apart by their matches.

Where tags tell zooms apart, ``photos`` did; photos without tags share a lens, and a
wrong lens bends a whole scene while the error of its points stays small. Given a lens
each, photos of one zoom agree to a few percent.
"""

import collections
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from internal.prepare import mapping, matching
from internal.prepare.attempts import Attempt
from internal.prepare.matching import Copy

# Dark photos of LOM's buu, chair and shrub with a lens each lie within 2 % of their
# mean (one within 5 %). With every third of buu's at 1.5 times the focal length, each
# kind spreads over 15 % at first, with 25 % between the two.
STEP = 1.12  # between two zooms


def tell_apart(attempt: Attempt, copies: Sequence[Copy], work: Path) -> Attempt:
    """The same features and matches mapped anew with a lens for each zoom, where there
    are several behind one lens and the new cameras agree; else the attempt itself.

    Args:
        work: folder for the new database.
    """
    if not attempt.solid:
        return attempt
    model = attempt.models[0]
    cameras = {view: copies[view].camera for view in model.views}
    zooms = split(cameras, mapping.own_focal_lengths(model))
    if len(set(zooms.values())) == len(set(cameras.values())):
        return attempt
    counts = ", ".join(str(n) for n in collections.Counter(zooms.values()).values())
    print(f"trying: a lens for each zoom ({counts} photos)", flush=True)
    renamed = [
        dataclasses.replace(copy, camera=zooms.get(view, copy.camera))
        for view, copy in enumerate(copies)
    ]
    work.mkdir(exist_ok=True)
    database = work / "database.db"
    database.unlink(missing_ok=True)
    matching.copy_matches(attempt.database, database, renamed)
    models = mapping.map_incrementally(database, work, len(copies))
    way = dataclasses.replace(attempt.way, name=f"{attempt.way.name}, a lens per zoom")
    again = Attempt(way, database, tuple(models))
    print(f"  {again.describe(len(copies))}", flush=True)
    if not again.models:
        return attempt
    found = split(cameras, mapping.focals_of_copies(again.models[0]))
    if found.items() <= zooms.items():
        return min(attempt, again, key=lambda tried: tried.rank)
    return attempt


def split(
    cameras: Mapping[int, str], focal_lengths: Mapping[int, float]
) -> dict[int, str]:
    """The camera of each view, and its zoom where a camera has several.

    Args:
        cameras: of views, by name.
        focal_lengths: of each view alone, in one unit for each camera.
    """
    zooms = {}
    for camera in dict.fromkeys(cameras.values()):
        views = [view for view in focal_lengths if cameras.get(view) == camera]
        views.sort(key=lambda view: focal_lengths[view])
        logs = np.log([focal_lengths[view] for view in views])
        numbers = np.append(0, np.cumsum(np.diff(logs) > np.log(STEP)))
        for view, number in zip(views, numbers.tolist(), strict=True):
            zooms[view] = f"{camera} at zoom {number}" if numbers[-1] else camera
    return zooms
