# SPDX-License-Identifier: Apache-2.0
"""Gaussian splats and how a camera sees them (3D Gaussian Splatting, Kerbl 2023).

The parameters are those of the 3DGS files. A splat is a Gaussian with standard
deviations ``exp(log_scales)`` along the axes that its quaternion turns, seen with
opacity ``sigmoid(opacity_logits)`` in a colour that spherical harmonics state: sRGB,
0.5 plus their sum. Camera frames are OpenGL (x right, y up, z towards the viewer).

``n`` counts splats, ``k`` harmonics: 1 is one colour for all directions, 4 is degree 1.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import Array
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from internal.cameras import Lens
from internal.poses import Similarity

SH0 = 0.28209479177387814  # 1 / (2 sqrt(pi))
SH1 = 0.4886025119029199  # sqrt(3 / (4 pi))
DILATION = 0.3  # square pixels that every renderer of 3DGS adds to a footprint
CUTOFF = 9.0  # squared standard deviations: a footprint ends at 3 (ellipse kernel)
FAINTEST = 1.0 / 255.0  # less alpha than that is not drawn
OPAQUEST = 0.99  # the largest alpha: gradients divide by what is left
# The linearised projection of a splat is taken at most this far outside the picture.
OUTSIDE = 1.3


@struct.dataclass
class Splats:
    """Splats in some frame; NumPy or JAX arrays."""

    points: Float[Array | np.ndarray, "n 3"]
    quaternions: Float[Array | np.ndarray, "n 4"]  # unit, w x y z
    log_scales: Float[Array | np.ndarray, "n 3"]
    opacity_logits: Float[Array | np.ndarray, " n"]
    harmonics: Float[Array | np.ndarray, "n k 3"]  # order: 1, y, z, x

    def __len__(self) -> int:
        return self.points.shape[0]

    @property
    def opacities(self) -> Float[Array, " n"]:
        """In (0, 1)."""
        return jax.nn.sigmoid(self.opacity_logits)


@struct.dataclass
class Pinhole:
    """A camera without distortion; pixel (0, 0) has its centre at (0.5, 0.5)."""

    camtoworld: Float[Array | np.ndarray, "3 4"]
    focal: Float[Array | np.ndarray, " 2"]  # pixels
    center: Float[Array | np.ndarray, " 2"]  # principal point, pixels
    near: Float[Array | np.ndarray | np.floating, ""]  # depth before which none is seen
    width: int = struct.field(pytree_node=False)
    height: int = struct.field(pytree_node=False)


@struct.dataclass
class Footprints:
    """Splats as ellipses on a picture."""

    means: Float[Array, "n 2"]  # pixels
    conics: Float[Array, "n 3"]  # xx, xy, yy of the inverse covariance
    opacities: Float[Array, " n"]
    srgb: Float[Array, "n 3"]
    depths: Float[Array, " n"]  # along the camera's axis
    extents: Float[Array, "n 2"]  # half sides of the box around it; 0: not seen


def pinhole_camera(
    lens: Lens, camtoworld: Float[np.ndarray, "3 4"], near: float
) -> Pinhole:
    """The camera of a lens whose model is PINHOLE."""
    fx, fy, cx, cy = lens.params
    return Pinhole(
        np.asarray(camtoworld, np.float32),
        np.array([fx, fy], np.float32),
        np.array([cx, cy], np.float32),
        np.float32(near),
        lens.width,
        lens.height,
    )


def rotations(quaternions: Float[Array, "n 4"]) -> Float[Array, "n 3 3"]:
    """Rotation matrices of quaternions w x y z, whose length does not matter."""
    unit = quaternions / jnp.linalg.norm(quaternions, axis=-1, keepdims=True)
    w, x, y, z = jnp.moveaxis(unit, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)


def base_colors(
    harmonics: Float[Array | np.ndarray, "n k 3"],
) -> Float[Array | np.ndarray, "n 3"]:
    """sRGB of splats but for what depends on the direction; not clipped."""
    return 0.5 + SH0 * harmonics[:, 0]


def colors_towards(
    harmonics: Float[Array, "n k 3"], directions: Float[Array, "n 3"]
) -> Float[Array, "n 3"]:
    """sRGB of splats in unit directions from the camera to them; not negative."""
    srgb: Any = base_colors(harmonics)
    if harmonics.shape[1] > 1:
        x, y, z = jnp.split(directions, 3, axis=-1)
        srgb += SH1 * (-y * harmonics[:, 1] + z * harmonics[:, 2] - x * harmonics[:, 3])
    return jnp.maximum(srgb, 0.0)


def project_splats(splats: Splats, camera: Pinhole) -> Footprints:
    """EWA splatting: the Jacobian of the projection carries each Gaussian over."""
    rotation, origin = camera.camtoworld[:, :3], camera.camtoworld[:, 3]
    offsets = jnp.asarray(splats.points - origin)
    local = offsets @ rotation
    depths = -local[:, 2]
    safe = jnp.maximum(depths, camera.near)
    fx, fy = camera.focal[0], camera.focal[1]
    slopes = jnp.stack([local[:, 0], -local[:, 1]], axis=-1) / safe[:, None]
    means = jnp.asarray(camera.focal) * slopes + camera.center

    size = jnp.array([camera.width, camera.height], jnp.float32)
    limit = OUTSIDE * 0.5 * size / camera.focal
    x, y = jnp.moveaxis(jnp.clip(slopes, -limit, limit), -1, 0)
    zero = jnp.zeros_like(x)
    # d(pixel) / d(local point), y down in pixels and up in the camera.
    jacobian = jnp.stack(
        [
            jnp.stack([fx / safe, zero, fx * x / safe], axis=-1),
            jnp.stack([zero, -fy / safe, fy * y / safe], axis=-1),
        ],
        axis=-2,
    )
    axes = (
        rotations(jnp.asarray(splats.quaternions))
        * jnp.exp(splats.log_scales)[:, None, :]
    )
    flat = jnp.einsum("nij,kj,nkl->nil", jacobian, rotation, axes)
    xx = jnp.sum(flat[:, 0] ** 2, axis=-1) + DILATION
    yy = jnp.sum(flat[:, 1] ** 2, axis=-1) + DILATION
    xy = jnp.sum(flat[:, 0] * flat[:, 1], axis=-1)
    determinant = xx * yy - xy**2
    conics = jnp.stack([yy, -xy, xx], axis=-1) / determinant[:, None]

    opacities = splats.opacities
    reach = jnp.minimum(CUTOFF, 2.0 * jnp.log(opacities / FAINTEST))
    extents = jnp.sqrt(jnp.maximum(reach, 0.0)[:, None] * jnp.stack([xx, yy], axis=-1))
    seen = (depths > camera.near) & (reach > 0.0)
    unit = offsets / jnp.linalg.norm(offsets, axis=-1, keepdims=True)
    return Footprints(
        means,
        conics,
        opacities,
        colors_towards(jnp.asarray(splats.harmonics), unit),
        depths,
        jnp.where(seen[:, None], extents, 0.0),
    )


def carry_over(splats: Splats, similarity: Similarity) -> Splats:
    """The same splats in another frame; NumPy arrays."""
    rotation = Rotation.from_matrix(similarity.rotation)
    turned = rotation * Rotation.from_quat(splats.quaternions, scalar_first=True)
    harmonics = np.array(splats.harmonics, np.float32)
    if harmonics.shape[1] > 1:
        # Degree 1 is a vector: its product with the direction is added to the colour.
        y, z, x = harmonics[:, 1:4].transpose(1, 0, 2)
        vectors = np.stack([-x, -y, z], axis=-2)
        x, y, z = np.moveaxis(rotation.as_matrix() @ vectors, -2, 0)
        harmonics[:, 1:4] = np.stack([-y, z, -x], axis=1)
    points = similarity.points(np.asarray(splats.points, np.float64))
    return Splats(
        points.astype(np.float32),
        turned.as_quat(canonical=True, scalar_first=True).astype(np.float32),
        np.asarray(splats.log_scales + np.float32(np.log(similarity.scale))),
        np.asarray(splats.opacity_logits),
        harmonics,
    )


def take(splats: Splats, index: np.ndarray) -> Splats:
    """Some of the splats; NumPy arrays."""
    return jax.tree.map(lambda values: np.asarray(values)[index], splats)
