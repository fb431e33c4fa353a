# SPDX-License-Identifier: Apache-2.0
"""Geometry of a set of cameras: rotations, average pose, focus point, similarities.

Poses are camera-to-world ``[n, 3, 4]`` in OpenGL convention: columns are the
camera's right, up and backward axes and its centre, so the optical axis is minus
the third column.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

# NDC bends rays by 1 / cos(angle to the mean axis): past these angles the scene is
# not one frustum any more.
WIDEST_AXIS = np.radians(45.0)
WIDEST_RAY = np.radians(80.0)
# Axes that differ by about 2 degrees or less do not meet at a point that is known.
_PARALLEL = 1e-3


@dataclasses.dataclass(frozen=True)
class Similarity:
    """Takes a point x to ``scale * rotation x + shift``, float64."""

    scale: float  # of lengths; above 0
    rotation: Float[np.ndarray, "3 3"]
    shift: Float[np.ndarray, " 3"]

    @classmethod
    def about(
        cls,
        origin: Float[np.ndarray, " 3"],
        scale: float,
        rotation: Float[np.ndarray, "3 3"],
    ) -> "Similarity":
        """Moves ``origin`` to 0, then turns and scales."""
        return cls(scale, rotation, -scale * rotation @ origin)

    @property
    def matrix(self) -> Float[np.ndarray, "4 4"]:
        """For homogeneous coordinates."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.scale * self.rotation
        matrix[:3, 3] = self.shift
        return matrix

    def inverse(self) -> "Similarity":
        """The way back."""
        rotation = self.rotation.T
        return Similarity(
            1.0 / self.scale, rotation, rotation @ -self.shift / self.scale
        )

    def __matmul__(self, first: "Similarity") -> "Similarity":
        """``first``, then this."""
        (shift,) = self.points(first.shift[None])
        return Similarity(
            self.scale * first.scale, self.rotation @ first.rotation, shift
        )

    def points(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """Where points go."""
        return self.scale * points @ self.rotation.T + self.shift

    def poses(
        self, camtoworlds: Float[np.ndarray, "n 3 4"]
    ) -> Float[np.ndarray, "n 3 4"]:
        """Where cameras go: centres as points do, axes only turn."""
        centres = self.points(camtoworlds[:, :, 3])
        axes = self.rotation @ camtoworlds[:, :, :3]
        return np.concatenate([axes, centres[:, :, None]], axis=-1)


def rotation_errors(camtoworlds: Float[np.ndarray, "n 3 4"]) -> Float[np.ndarray, " n"]:
    """How far each pose is from a rotation: largest entry of |R^T R - I|.

    Infinite for mirrored or non-finite poses; a scale s gives |s^2 - 1|.
    """
    finite = np.isfinite(camtoworlds).all(axis=(1, 2), keepdims=True)
    rotations = np.where(finite, camtoworlds[:, :, :3], 0.0)
    gram = np.einsum("nji,njk->nik", rotations, rotations)
    errors = np.abs(gram - np.eye(3)).max(axis=(1, 2))
    # A pose with a hole became a zero matrix, which has no determinant either.
    return np.where(np.linalg.det(rotations) > 0.0, errors, np.inf)


def average_pose(camtoworlds: Float[np.ndarray, "n 3 4"]) -> Float[np.ndarray, "3 4"]:
    """Mean centre and mean backward axis, turned so that the mean up is up (LLFF)."""
    backward = _unit(camtoworlds[:, :, 2].sum(axis=0))
    right = _unit(np.cross(camtoworlds[:, :, 1].sum(axis=0), backward))
    up = np.cross(backward, right)
    return np.stack([right, up, backward, camtoworlds[:, :, 3].mean(axis=0)], axis=-1)


def axis_angles(camtoworlds: Float[np.ndarray, "n 3 4"]) -> Float[np.ndarray, " n"]:
    """Angles in radians between each optical axis and the mean of all."""
    backward = camtoworlds[:, :, 2]
    cosines = backward @ _unit(backward.sum(axis=0))
    return np.arccos(np.clip(cosines, -1.0, 1.0))


def focus_point(camtoworlds: Float[np.ndarray, "n 3 4"]) -> Float[np.ndarray, " 3"]:
    """The point nearest to all optical axes in the least-squares sense.

    Along directions in which the axes do not tell (parallel cameras), the mean of
    the centres.
    """
    backward, centres = camtoworlds[:, :, 2], camtoworlds[:, :, 3]
    across = np.eye(3) - backward[:, :, None] * backward[:, None, :]
    mean = centres.mean(axis=0)
    offsets = np.einsum("nij,nj->i", across, centres - mean)
    inverse = np.linalg.pinv(across.sum(axis=0), rcond=_PARALLEL, hermitian=True)
    return mean + inverse @ offsets


def fits_one_frustum(
    camtoworlds: Float[np.ndarray, "n 3 4"],
    half_angles: Float[np.ndarray, " n"],
    near: float,
) -> bool:
    """Whether NDC is defined for every ray of these cameras.

    True if all pixels (``half_angles`` radians from their camera's axis) look along
    the mean axis, and all cameras stand behind the near plane of the average one.
    """
    if (axis_angles(camtoworlds) + half_angles).max() >= np.pi / 2.0:
        return False
    moved = forward_facing_frame(camtoworlds, near).poses(camtoworlds)
    return bool(moved[:, 2, 3].min() > -1.0)


def is_forward_facing(
    camtoworlds: Float[np.ndarray, "n 3 4"],
    half_angles: Float[np.ndarray, " n"],
    near: float,
) -> bool:
    """Whether NDC suits these cameras: they look one way, from before the scene.

    True if they fit one frustum with all optical axes within ``WIDEST_AXIS`` and all
    pixels within ``WIDEST_RAY`` of the mean axis. Cameras that surround the scene
    fail on the axes, or stand past the near plane.
    """
    angles = axis_angles(camtoworlds)
    narrow = angles.max() < WIDEST_AXIS and (angles + half_angles).max() < WIDEST_RAY
    return bool(narrow) and fits_one_frustum(camtoworlds, half_angles, near)


def forward_facing_frame(
    camtoworlds: Float[np.ndarray, "n 3 4"], near: float
) -> Similarity:
    """From the world to the average camera's frame, scaled so that depth 0.75
    ``near`` becomes 1: the scene is then safely beyond the near plane (LLFF)."""
    pose = average_pose(camtoworlds)
    return Similarity.about(pose[:, 3], 1.0 / (0.75 * near), pose[:, :3].T)


def unbounded_frame(camtoworlds: Float[np.ndarray, "n 3 4"]) -> Similarity:
    """Moves the focus point to the origin and the farthest camera to distance 1 from
    it; axes are kept."""
    focus = focus_point(camtoworlds)
    farthest = float(np.linalg.norm(camtoworlds[:, :, 3] - focus, axis=-1).max())
    return Similarity.about(focus, 1.0 / farthest, np.eye(3))


def fit_similarity(
    source: Float[np.ndarray, "n 3"], target: Float[np.ndarray, "n 3"]
) -> Similarity:
    """Least-squares similarity from source to target points (Umeyama 1991).

    Needs three points that are not on a line.
    """
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    centred = source - source_mean
    covariance = (target - target_mean).T @ centred
    u, singular, vt = np.linalg.svd(covariance)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    scale = float((singular * signs).sum() / (centred**2).sum())
    about_mean = Similarity.about(source_mean, scale, (u * signs) @ vt)
    return Similarity(1.0, np.eye(3), target_mean) @ about_mean


def _unit(vector: np.ndarray) -> np.ndarray:
    """Zero stays zero: axes that cancel have no mean, and none is near to it."""
    return vector / max(np.linalg.norm(vector), np.finfo(float).tiny)
