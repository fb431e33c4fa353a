# SPDX-License-Identifier: Apache-2.0
"""How far the cameras of two scenes of the same photos lie apart.

Poses are OpenGL camera-to-world. The similarity between the frames takes its rotation
from the cameras' axes and its scale and shift from their centres: centres alone fix
no rotation about a line or plane on which the cameras nearly stand.
"""

import dataclasses
from pathlib import Path, PurePosixPath

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from internal.errors import UserError
from internal.scene import readers


@dataclasses.dataclass(frozen=True)
class Difference:
    """Errors of cameras: degrees, and fractions of the extent of the centres."""

    rotations: Float[np.ndarray, " n"]  # degrees
    centres: Float[np.ndarray, " n"]  # over the diagonal of the box around them


def compare_poses(
    camtoworlds: Float[np.ndarray, "n 3 4"], reference: Float[np.ndarray, "n 3 4"]
) -> Difference:
    """Differences of two or more cameras after the best similarity."""
    turns = reference[:, :, :3] @ camtoworlds[:, :, :3].swapaxes(1, 2)
    rotations = Rotation.from_matrix(turns)
    mean = rotations.mean()
    ours = camtoworlds[:, :, 3] - camtoworlds[:, :, 3].mean(axis=0)
    ours = mean.apply(ours)
    theirs = reference[:, :, 3] - reference[:, :, 3].mean(axis=0)
    scale = (ours * theirs).sum() / (ours**2).sum()
    extent = np.linalg.norm(np.ptp(theirs, axis=0))
    return Difference(
        rotations=np.degrees((rotations * mean.inv()).magnitude()),
        centres=np.linalg.norm(scale * ours - theirs, axis=-1) / extent,
    )


def compare_scenes(scene: Path, reference: Path) -> str:
    """One line on the cameras that both scenes have, paired by picture name.

    Raises:
        UserError: they share fewer than three pictures.
    """
    ours, theirs = (readers.read_files(s, "auto", "") for s in (scene, reference))
    names, other = (
        {PurePosixPath(name).stem: i for i, name in enumerate(files.names)}
        for files in (ours, theirs)
    )
    common = sorted(names.keys() & other.keys())
    if len(common) < 3:
        raise UserError(
            f"{reference}: {len(common)} pictures named as in {scene}; expected at "
            "least 3 of the same names"
        )
    difference = compare_poses(
        ours.camtoworlds[[names[name] for name in common]],
        theirs.camtoworlds[[other[name] for name in common]],
    )
    turned, moved = difference.rotations, 100.0 * difference.centres
    return (
        f"{len(common)} cameras against {reference}: rotation median "
        f"{np.median(turned):.3f}, largest {turned.max():.3f} degrees; centre median "
        f"{np.median(moved):.2f}, largest {moved.max():.2f} % of their extent"
    )
