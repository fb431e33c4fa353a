# SPDX-License-Identifier: Apache-2.0
"""What a reader is and what it returns.

A reader turns one kind of folder into ``SceneFiles``. Readers decode no picture
and move no camera: poses stay in the frame of the file that states them.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float

from internal.cameras import Lens

POINTS_OF_MODEL = "sparse points"


@dataclasses.dataclass(frozen=True)
class SceneFiles:
    """What a reader finds in a folder. Nothing is decoded, poses are as stored.

    All tuples have one entry per view, in the order of the views' names.
    """

    format: str  # name of the reader, for messages
    names: tuple[str, ...]  # unique: file name, with folder only where needed
    pose_paths: tuple[Path, ...]  # the file that states each pose, for messages
    image_paths: tuple[Path, ...]  # dark input pictures
    lenses: tuple[Lens, ...]  # at the size the pose file states
    camtoworlds: Float[np.ndarray, "n 3 4"]  # OpenGL
    points: Float[np.ndarray, "m 3"]  # points in the same frame; m may be 0
    bounds: Float[np.ndarray, "b 2"]  # near, far along the axis: b is 0, 1 or n
    test_names: frozenset[str] | None  # None: the files state no split
    mask_paths: tuple[Path | None, ...]  # None: no file masks the view
    masks_hide: bool = False  # what is not black in them is ignored, else what is
    upright: bool = True  # poses mean photos turned by EXIF, else pixels as stored
    points_source: str = POINTS_OF_MODEL  # what the points are, for messages
    transparent_is_black: bool = False  # else what a photo has transparent is masked


@dataclasses.dataclass(frozen=True)
class Reader:
    """One scene format. ``read`` takes the scene's folder, the name of the folder in
    it to take pictures from ("" for the one the format states), and how these may
    find their poses (of ``pairing.PAIR_BY``)."""

    name: str
    looked_for: str  # what makes a folder a scene of this format, for messages
    matches: Callable[[Path], bool]
    read: Callable[[Path, str, str], SceneFiles]
