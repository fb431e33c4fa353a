# SPDX-License-Identifier: Apache-2.0
"""The files of a prepared scene, in the formats that other programs read as well."""

import shutil
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from internal.cameras import Lens
from internal.errors import UserError
from internal.files import atomic, image_io
from internal.prepare.photos import (
    DEVELOPED_EXTENSIONS,
    Photo,
    name_in_scene,
    read_photo,
)
from internal.scene.colmap import Reconstruction
from internal.scene.masks import is_of_shape
from internal.scene.pairing import pair_by_name
from internal.scene.transforms_file import View, write_single

PICTURES = "images"
TRUTH = "high"
MODEL = "sparse/0"
HOLDOUT = 8  # every eighth view, from the first, is a test view

README = """A scene prepared from {photos} photos of {source}; {registered} have poses.

images/          the photos themselves, not brightened (RAW, EXR, HEIC: as PNG)
{truth}transforms.json  OpenGL camera-to-world poses, lenses in pixels of the upright
                 photos, and the split into train_filenames and test_filenames
sparse/0/        the same cameras and the sparse points as a COLMAP model
exposures.json   how much more light one photo took than another
report/          index.html shows how it went; report.json has the numbers

Units are arbitrary: structure-from-motion knows no metres. z is up.
"""


def place_photo(photo: Photo, scene: Path) -> None:
    """Copies a photo into the scene byte by byte, or develops it.

    Raises:
        UserError: the folder cannot be written or the disk is full.
    """
    _copy_or_develop(photo.path, scene / PICTURES / photo.scene_name)


def pair_twins(photos: Sequence[Photo], folder: Path) -> tuple[tuple[Path, ...], str]:
    """The normal-light twin of each photo, and the rule that paired them.

    Raises:
        UserError: they cannot be paired, or a twin has another shape.
    """
    paths, rule = pair_by_name([photo.name for photo in photos], folder)
    for photo, path in zip(photos, paths, strict=True):
        width, height = image_io.read_size(path)
        if not is_of_shape((width, height), (photo.width, photo.height)):
            raise UserError(
                f"{path}: {width}x{height} pixels, but its dark twin {photo.path} has "
                f"{photo.width}x{photo.height}, another shape; expected the same view"
            )
    return paths, rule


def place_truth(photo: Photo, truth: Path, scene: Path) -> None:
    """Copies or develops a normal-light picture under the name of its dark photo."""
    name = name_in_scene(PurePosixPath(photo.name).with_suffix(truth.suffix))
    _copy_or_develop(truth, scene / TRUTH / name)


def _copy_or_develop(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.suffix.lower() in DEVELOPED_EXTENSIONS:
        image_io.write(target, read_photo(source))
        return
    with atomic.writing(target) as partial:
        shutil.copyfile(source, partial)


def write_transforms(model: Reconstruction, scene: Path) -> None:
    """Writes ``transforms.json`` (nerfstudio's custom) for a model's images.

    Raises:
        UserError: the folder cannot be written or the disk is full.
    """
    views = [
        View(f"{PICTURES}/{name}", in_opencv_terms(lens), pose)
        for name, lens, pose in zip(
            model.names, model.lenses, model.camtoworlds, strict=True
        )
    ]
    write_single(scene, views, test=[view.file for view in views[::HOLDOUT]])


def write_readme(
    scene: Path, source: str, photos: int, registered: int, *, has_truth: bool
) -> None:
    """Explains the folder."""
    truth = "high/            normal-light truth, paired by name, for scores only\n"
    text = README.format(
        source=source,
        photos=photos,
        registered=registered,
        truth=truth if has_truth else "",
    )
    atomic.write_text(scene / "README.txt", text)


def in_opencv_terms(lens: Lens) -> Lens:
    """A lens of one focal length and one radial term (COLMAP's SIMPLE_RADIAL)."""
    focal, cx, cy, k1 = lens.params
    params = (focal, focal, cx, cy, k1, 0.0, 0.0, 0.0)
    return Lens("OPENCV", lens.width, lens.height, params)
