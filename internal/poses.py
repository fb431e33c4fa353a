# SPDX-License-Identifier: Apache-2.0
"""Geometry of a set of cameras: rotations, average pose, focus point, similarities.

Poses are camera-to-world ``[n, 3, 4]`` in OpenGL convention: columns are the
camera's right, up and backward axes and its centre, so the optical axis is minus
the third column. Similarities are ``[4, 4]``, scale times rotation and translation.
"""

import numpy as np
from jaxtyping import Float

# NDC bends rays by 1 / cos(angle to the mean axis): past these angles the scene is
# not one frustum any more.
WIDEST_AXIS = np.radians(45.0)
WIDEST_RAY = np.radians(80.0)
# Axes that differ by about 2 degrees or less do not meet at a point that is known.
_PARALLEL = 1e-3


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
    moved = transform_poses(forward_facing_frame(camtoworlds, near), camtoworlds)
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
) -> Float[np.ndarray, "4 4"]:
    """Similarity from the world to the average camera's frame, scaled so that depth
    0.75 ``near`` becomes 1: the scene is then safely beyond the near plane (LLFF)."""
    pose = average_pose(camtoworlds)
    return _similarity(1.0 / (0.75 * near), pose[:, :3].T, pose[:, 3])


def unbounded_frame(
    camtoworlds: Float[np.ndarray, "n 3 4"],
) -> Float[np.ndarray, "4 4"]:
    """Similarity that moves the focus point to the origin and the farthest camera
    to distance 1 from it; axes are kept."""
    focus = focus_point(camtoworlds)
    farthest = np.linalg.norm(camtoworlds[:, :, 3] - focus, axis=-1).max()
    return _similarity(1.0 / farthest, np.eye(3), focus)


def fit_similarity(
    source: Float[np.ndarray, "n 3"], target: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "4 4"]:
    """Least-squares similarity from source to target points (Umeyama 1991).

    Needs three points that are not on a line.
    """
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    centred = source - source_mean
    covariance = (target - target_mean).T @ centred
    u, singular, vt = np.linalg.svd(covariance)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    scale = (singular * signs).sum() / (centred**2).sum()
    rotation = (u * signs) @ vt
    similarity = _similarity(scale, rotation, source_mean)
    similarity[:3, 3] += target_mean
    return similarity


def scale_of(similarity: Float[np.ndarray, "4 4"]) -> float:
    """How many times longer a similarity makes distances."""
    return float(np.cbrt(np.linalg.det(similarity[:3, :3])))


def transform_points(
    similarity: Float[np.ndarray, "4 4"], points: Float[np.ndarray, "m 3"]
) -> Float[np.ndarray, "m 3"]:
    """Applies a similarity to points."""
    return points @ similarity[:3, :3].T + similarity[:3, 3]


def transform_poses(
    similarity: Float[np.ndarray, "4 4"], camtoworlds: Float[np.ndarray, "n 3 4"]
) -> Float[np.ndarray, "n 3 4"]:
    """Applies a similarity to cameras: centres move and scale, axes only turn."""
    moved = similarity[:3, :3] @ camtoworlds
    moved[:, :, :3] /= scale_of(similarity)
    moved[:, :, 3] += similarity[:3, 3]
    return moved


def _similarity(
    scale: float, rotation: np.ndarray, origin: np.ndarray
) -> Float[np.ndarray, "4 4"]:
    """Moves ``origin`` to 0, then turns and scales."""
    similarity = np.eye(4)
    similarity[:3, :3] = scale * rotation
    similarity[:3, 3] = -scale * rotation @ origin
    return similarity


def _unit(vector: np.ndarray) -> np.ndarray:
    """Zero stays zero: axes that cancel have no mean, and none is near to it."""
    return vector / max(np.linalg.norm(vector), np.finfo(float).tiny)
