# SPDX-License-Identifier: Apache-2.0
"""COLMAP: lens models and reconstructions.

``prepare/matching.py`` and ``prepare/mapping.py`` run it, ``colmap_files`` reads its
files; no other module imports pycolmap.

Frames: COLMAP cameras are OpenCV (x right, y down, z forwards); everything that
leaves this module is OpenGL (x right, y up, z backwards). Pixel coordinates are
(x, y) with (0.5, 0.5) at the centre of the top-left pixel.
"""

import dataclasses
import math
import signal
import threading
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pycolmap
from jaxtyping import Float, UInt8
from scipy.spatial.transform import Rotation

from internal.cameras import Lens, node_positions
from internal.errors import UserError
from internal.files.listing import say_once
from internal.scene import colmap_files

# It reports every file it reads and every attempt that fails on stderr.
pycolmap.logging.minloglevel = 3
# And a stack of its own where a program is asked to end: what Python had set holds.
if threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGTERM, signal.getsignal(signal.SIGTERM))

# A model lies in one of these or in a numbered folder of it.
MODEL_ROOTS = ("sparse", "colmap_sparse", "colmap/sparse")
# Beyond this angle from the axis, depth is no measure of distance along a ray.
WIDEST_DEPTH_ANGLE = math.radians(84.0)
SHORTEST = 1 / 20  # of a picture's side: 169 degrees, or a focal length not in pixels
ROUND_TRIP_TOLERANCE = 0.05  # pixels
OPENGL_FROM_OPENCV = np.array([1.0, -1.0, -1.0])

# A lens with one focal length, the lens of two that contains it, and the zeros
# which that one appends: scaling the axes apart is then exact.
_TWO_FOCALS = {
    "SIMPLE_PINHOLE": ("PINHOLE", 0),
    "SIMPLE_RADIAL": ("OPENCV", 3),
    "RADIAL": ("OPENCV", 2),
    "SIMPLE_RADIAL_FISHEYE": ("OPENCV_FISHEYE", 3),
    "RADIAL_FISHEYE": ("OPENCV_FISHEYE", 2),
    "SIMPLE_DIVISION": ("DIVISION", 0),
    "SIMPLE_FISHEYE": ("FISHEYE", 0),
}


@dataclasses.dataclass(frozen=True)
class Reconstruction:
    """The registered images of a COLMAP model, sorted by name."""

    names: tuple[str, ...]  # as COLMAP stores them, with any subfolder
    lenses: tuple[Lens, ...]
    camtoworlds: Float[np.ndarray, "n 3 4"]  # OpenGL
    points: Float[np.ndarray, "m 3"]


def lens_directions(lens: Lens) -> Float[np.ndarray, "pixels 3"]:
    """Directions through all pixel centres, row by row from the top-left one.

    OpenGL camera frame, float32. They have depth 1 (z = -1) if ``has_depth``,
    else unit length: a lens that sees sideways has no plane at depth 1.

    Raises:
        UserError: the lens is invalid, or a pixel has no direction.
    """
    return directions_at(lens, _pixel_centres(lens).reshape(-1, 2))


def lens_table(lens: Lens) -> Float[np.ndarray, "nodes 3"]:
    """The directions of ``lens_directions`` at the nodes of a table, row by row.

    Raises:
        UserError: the lens is invalid, or a node has no direction.
    """
    x, y = node_positions(lens.width), node_positions(lens.height)
    return directions_at(lens, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))


def directions_at(
    lens: Lens, pixels: Float[np.ndarray, "m 2"]
) -> Float[np.ndarray, "m 3"]:
    """The directions of ``lens_directions`` at pixel coordinates (x, y).

    Raises:
        UserError: the lens is invalid, or a pixel has no direction.
    """
    rays = pixel_rays(lens, pixels)
    if has_depth(lens):
        rays = rays / -rays[:, 2:]
    return rays.astype(np.float32)


def has_depth(lens: Lens) -> bool:
    """Whether every pixel looks forwards, so that depth measures its ray."""
    return half_angle(lens) < WIDEST_DEPTH_ANGLE


def half_angle(lens: Lens) -> float:
    """Largest angle in radians between the optical axis and a border pixel's ray.

    Raises:
        UserError: the lens is invalid, or a border pixel has no direction.
    """
    if _camera(lens).is_spherical():
        return math.pi
    depths = -pixel_rays(lens, _border(lens))[:, 2]
    return float(np.arccos(np.clip(depths, -1.0, 1.0)).max())


def project(lens: Lens, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 2"]:
    """Pixel coordinates of points in the OpenGL camera frame.

    NaN for points at wider angles than any border pixel: behind the camera, or
    where a distortion polynomial would fold them back into the picture.
    """
    if len(points) == 0:
        return np.empty((0, 2))
    pixels = np.asarray(_camera(lens).img_from_cam(points * OPENGL_FROM_OPENCV))
    distances = np.linalg.norm(points, axis=-1, keepdims=True)
    seen = -points[:, 2:] >= math.cos(half_angle(lens)) * distances
    return np.where(seen, pixels, np.nan)


def pixel_rays(
    lens: Lens, pixels: Float[np.ndarray, "m 2"]
) -> Float[np.ndarray, "m 3"]:
    """Unit rays (OpenGL camera frame) through pixels, checked by projecting them back.

    pycolmap inverts distortions by Newton steps, which may end at a wrong root or
    nowhere when a polynomial leaves the range that it was fitted on.

    Raises:
        UserError: the lens is invalid, or a pixel has no direction.
    """
    camera = _camera(lens)
    rays = np.asarray(camera.cam_ray_from_img(pixels))
    error = np.abs(np.asarray(camera.img_from_cam(rays)) - pixels).max(axis=-1)
    lost = ~(error < ROUND_TRIP_TOLERANCE)
    if lost.any():
        x, y = pixels[lost][0]
        raise UserError(
            f"lens {lens.model} {lens.params}: {lost.sum()} of {len(pixels)} pixels "
            f"have no direction, e.g. ({x:g}, {y:g}) of {lens.width}x{lens.height}; "
            "calibrate with fewer distortion terms, or undistort the photos first "
            "(colmap image_undistorter)"
        )
    return rays * OPENGL_FROM_OPENCV


def scale_lens(lens: Lens, width: int, height: int) -> Lens:
    """The lens of the same view sampled at ``width`` by ``height`` pixels.

    Exact when the axes scale apart: a model with a single focal length becomes
    the equivalent model with two.
    """
    if (width, height) == (lens.width, lens.height):
        return lens
    if width * lens.height != height * lens.width:
        lens = _with_two_focals(lens)
    camera = _camera(lens)
    camera.rescale(width, height)
    return _lens(camera)


def focal_lengths(lens: Lens) -> tuple[float, float]:
    """(fx, fy) in pixels; for a panorama, pixels per radian at its centre."""
    camera = _camera(lens)
    if camera.is_spherical():  # pycolmap crashes when asked for its focal length
        return lens.width / (2.0 * math.pi), lens.height / math.pi
    return float(camera.focal_length_x), float(camera.focal_length_y)


def pinhole(lens: Lens) -> Lens:
    """The same view without distortion: equal size, focal lengths, principal point.

    Raises:
        UserError: it is a panorama, which no pinhole sees.
    """
    camera = _camera(lens)
    if camera.is_spherical():
        raise UserError(f"lens {lens.model}: a panorama has no pinhole camera")
    centre = camera.principal_point_x, camera.principal_point_y
    params = (*focal_lengths(lens), *map(float, centre))
    return Lens("PINHOLE", lens.width, lens.height, params)


def find_models(data_dir: Path) -> tuple[Path, ...]:
    """The whole models of the first of ``MODEL_ROOTS`` that holds any, in order of
    their numbers; one that has no number comes last."""
    for root in (data_dir / name for name in MODEL_ROOTS):
        numbered = [path for path in root.glob("*") if path.name.isdecimal()]
        folders = [*sorted(numbered, key=lambda path: int(path.name)), root]
        found = tuple(path for path in folders if colmap_files.model_ending(path))
        if found:
            return found
    return ()


def find_model(data_dir: Path) -> Path | None:
    """The model of most registered images, text or binary; says so if others are
    there: COLMAP writes several where it cannot join all photos.

    Raises:
        UserError: there are several, and the images of one cannot be read.
    """
    folders = find_models(data_dir)
    if len(folders) < 2:
        return folders[0] if folders else None
    counts = {folder: len(colmap_files.read_images(folder)) for folder in folders}
    largest = max(folders, key=lambda folder: counts[folder])
    others = [f"{f.name} has {counts[f]}" for f in folders if f != largest]
    say_once(
        f"{largest}: taken, the largest of {len(folders)} COLMAP models, with "
        f"{counts[largest]} photos; {', '.join(others)}"
    )
    return largest


def read_model(folder: Path) -> Reconstruction:
    """Reads a sparse model, binary or text, of any COLMAP version.

    Raises:
        UserError: files are missing or broken, or no image is registered.
    """
    model = colmap_files.read_stored(folder)
    images = model.images
    if not images:
        raise UserError(
            f"{folder}: the COLMAP model has no registered image; run the mapper "
            "again, on brightened copies of the photos if they are very dark"
        )
    quaternions = [image.quaternion for image in images]
    rotations = Rotation.from_quat(quaternions, scalar_first=True).inv().as_matrix()
    translations = np.array([image.translation for image in images])
    centres = -rotations @ translations[:, :, None]
    camtoworlds = np.concatenate([rotations, centres], axis=-1)
    return Reconstruction(
        names=tuple(image.name for image in images),
        lenses=tuple(model.cameras[image.camera] for image in images),
        camtoworlds=other_axes(camtoworlds),
        points=model.points,
    )


def other_axes(camtoworlds: Float[np.ndarray, "*n 3 4"]) -> Float[np.ndarray, "*n 3 4"]:
    """OpenCV's poses with OpenGL's axes, or back: y and z point the other way."""
    return camtoworlds * np.append(OPENGL_FROM_OPENCV, 1.0)


def reconstruction(
    names: Sequence[str],
    lenses: Sequence[Lens],
    camtoworlds: Float[np.ndarray, "n 3 4"],
) -> pycolmap.Reconstruction:
    """pycolmap's twin of posed views without points; numbers count from 1."""
    written = pycolmap.Reconstruction()
    camera_ids = {lens: i for i, lens in enumerate(dict.fromkeys(lenses), 1)}
    for lens, camera_id in camera_ids.items():
        camera = _camera(lens)
        camera.camera_id = camera_id
        written.add_camera_with_trivial_rig(camera)
    views = zip(names, lenses, camtoworlds, strict=True)
    for image_id, (name, lens, camtoworld) in enumerate(views, 1):
        opencv = other_axes(camtoworld)
        image = pycolmap.Image(name=name, camera_id=camera_ids[lens], image_id=image_id)
        cam_from_world = pycolmap.Rigid3d(opencv).inverse()
        written.add_image_with_trivial_frame(image, cam_from_world)
    return written


def write_model(
    folder: Path, model: Reconstruction, colors: UInt8[np.ndarray, "m 3"]
) -> None:
    """Writes a sparse model as text into an existing folder.

    Args:
        colors: of the model's points, which no image is said to observe.
    """
    written = reconstruction(model.names, model.lenses, model.camtoworlds)
    for point, color in zip(model.points, colors, strict=True):
        written.add_point3D(point, pycolmap.Track(), color)
    written.write_text(str(folder))


def _camera(lens: Lens) -> pycolmap.Camera:
    """The pycolmap twin of a lens, checked: pycolmap accepts anything."""
    described = f"lens {lens.model} {lens.params}"
    if lens.model not in pycolmap.CameraModelId.__members__ or lens.model == "INVALID":
        known = sorted(set(pycolmap.CameraModelId.__members__) - {"INVALID"})
        raise UserError(f"{described}: unknown model; COLMAP has {', '.join(known)}")
    camera = pycolmap.Camera(
        model=lens.model,
        width=lens.width,
        height=lens.height,
        params=list(lens.params),
    )
    if not camera.verify_params():
        raise UserError(f"{described}: expected parameters ({camera.params_info})")
    focals = [lens.params[i] for i in camera.focal_length_idxs()]
    if not all(map(math.isfinite, lens.params)) or min(focals, default=1.0) <= 0.0:
        raise UserError(
            f"{described}: parameters ({camera.params_info}) must be finite and "
            "focal lengths positive; calibrate again"
        )
    if min(lens.width, lens.height) <= 0:
        raise UserError(f"{described}: empty picture {lens.width}x{lens.height}")
    if max(lens.width, lens.height) > colmap_files.LARGEST_SIDE:
        raise UserError(
            f"{described}: a picture of {lens.width}x{lens.height}; expected at most "
            f"{colmap_files.LARGEST_SIDE} pixels a side"
        )
    return camera


def _lens(camera: pycolmap.Camera) -> Lens:
    return Lens(
        camera.model.name,
        camera.width,
        camera.height,
        tuple(float(param) for param in camera.params),
    )


def _pixel_centres(lens: Lens) -> Float[np.ndarray, "height width 2"]:
    x, y = np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5
    return np.stack(np.meshgrid(x, y), axis=-1)


def _border(lens: Lens) -> Float[np.ndarray, "pixels 2"]:
    """Centres of the border pixels alone: a size may be a mistake and huge."""
    x, y = np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5
    rows = [np.stack([x, np.full_like(x, at)], axis=-1) for at in (y[0], y[-1])]
    columns = [np.stack([np.full_like(y, at), y], axis=-1) for at in (x[0], x[-1])]
    return np.concatenate([*rows, *columns])


def _with_two_focals(lens: Lens) -> Lens:
    if lens.model not in _TWO_FOCALS:
        return lens
    model, zeros = _TWO_FOCALS[lens.model]
    params = (lens.params[0], *lens.params, *(0.0,) * zeros)
    return dataclasses.replace(lens, model=model, params=params)
