# SPDX-License-Identifier: Apache-2.0
"""A COLMAP model beside poses of another format, brought onto them by its names."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from internal.poses import fit_similarity
from internal.scene import colmap
from internal.scene.pairing import match_by_name


@dataclasses.dataclass(frozen=True)
class Beside:
    """What a model says, in the frame of the poses that it was brought onto."""

    folder: Path
    moved: Float[np.ndarray, "k 3 4"]  # its poses of the views that both have
    stated: Float[np.ndarray, "k 3 4"]  # the others' poses of the same views
    points: Float[np.ndarray, "m 3"]

    def is_misplaced(self, share: float) -> bool:
        """Whether a camera is off by more than a share of the spread of them all."""
        off = np.abs(self.moved - self.stated)[:, :, 3].max()
        spread = np.linalg.norm(np.std(self.stated[:, :, 3], axis=0))
        return bool(off > share * spread)

    def turned(self, *, opencv: bool = False) -> float:
        """The largest difference between the cameras' axes, as unit vectors; were the
        stated poses in OpenCV's, if so asked."""
        moved = colmap.other_axes(self.moved) if opencv else self.moved
        return float(np.abs(moved - self.stated)[:, :, :3].max())


def find_beside(
    data_dir: Path,
    names: Sequence[str],
    camtoworlds: Float[np.ndarray, "n 3 4"],
    fewest: int,
) -> Beside | str:
    """The scene's COLMAP model under the similarity that takes its camera centres to
    those of the views of these names.

    Args:
        fewest: cameras that both must have.

    Returns:
        Why there is none, where there is none: "" without a model.

    Raises:
        UserError: the model cannot be read.
    """
    folder = colmap.find_model(data_dir)
    if folder is None:
        return ""
    model = colmap.read_model(folder)
    found = match_by_name(names, model.names)
    stated = camtoworlds[[names.index(name) for name in found]]
    theirs = model.camtoworlds[[model.names.index(name) for name in found.values()]]
    if len(found) < fewest or not np.isfinite(stated).all():
        return f"{folder}: fewer than {fewest} images have poses"
    if not np.ptp(theirs[:, :, 3], axis=0).any():
        return f"{folder}: its cameras are at one place"
    similarity = fit_similarity(theirs[:, :, 3], stated[:, :, 3])
    return Beside(
        folder, similarity.poses(theirs), stated, similarity.points(model.points)
    )
