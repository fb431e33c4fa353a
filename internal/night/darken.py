# SPDX-License-Identifier: Apache-2.0
"""Turns a normal-light dataset into a paired low-light one of the same format.

Pictures are 8-bit sRGB files; they are decoded to linear light, captured by
``capture.capture`` and encoded again under the same names. The originals become
the truth, in the folder ``high``.
"""

import dataclasses
import os
import shutil
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import numpy as np
from jaxtyping import Float

from internal import color, progress
from internal.errors import UserError
from internal.files import image_io
from internal.files.listing import list_files
from internal.files.made_folder import Facts, make_folder
from internal.files.scratch import scratch_folder
from internal.night.capture import CaptureModel, capture, view_key
from internal.scene import readers
from internal.scene.masks import Mask, opaque
from internal.scene.pairing import find_truth_folder
from internal.scene.readers.base import SceneFiles

TRUTH = "high"
POSE_FILES = ("transforms*.json", "poses_bounds.npy", "sparse", "colmap")

NO_JPEG = """Names that end in .jpg are
JPEG files, whose compression adds its own small error."""
JPEG = """Every picture went through a
JPEG file of quality {quality}, whose colours are at half the size."""

README = """A low-light version of {source}.

Dark pictures lie where that dataset has its pictures: the same light at exposure
{exposure:.4g}, with photon noise (full well {full_well:g} electrons), read noise
({read_noise:g} electrons), channel gains {channel_gains}, clipping, sRGB curve and 8
bits; seed {seed}. high/ holds the originals as the truth. {compression}
"""


def darken(
    data_dir: Path,
    folder: Path,
    model: CaptureModel,
    *,
    images_dir: str = "",
    jpeg_quality: int = 0,
    overwrite: bool = False,
) -> Facts:
    """Writes the dark twin of a dataset, or reuses the one made with these settings.

    Args:
        data_dir: normal-light dataset in any format that ``readers`` know.
        folder: appears whole: pose files, masks and dark pictures under their paths,
            ``high``. What is transparent in a picture stays so.
        model: of the dark captures; a view's noise depends on its place by name.
        images_dir: folder in ``data_dir`` of the pictures to take, e.g. images_8;
            "" takes the ones that the pose files state.
        jpeg_quality: 1 to 100, of a JPEG file that every dark picture goes through,
            whatever it is stored as; 0 for none.
        overwrite: writes anew over a folder with other settings.

    Returns:
        ``dark_level`` and ``truth_level``: means in 8-bit levels; ``views``.

    Raises:
        UserError: no dataset, one with truth already, or ``folder`` is in use.
    """
    files = readers.read_files(data_dir, "auto", images_dir)
    _check(data_dir, folder, files)
    settings = {
        **{"darkened": str(data_dir.resolve()), "images_dir": images_dir},
        **({"jpeg_quality": jpeg_quality} if jpeg_quality else {}),
        **dataclasses.asdict(model),
    }

    def fill(partial: Path) -> Facts:
        _copy_pose_files(data_dir, partial)
        _write_readme(partial, data_dir.name, model, jpeg_quality)
        _copy_truth(data_dir, files, partial)
        return _darken_pictures(data_dir, files, partial, model, jpeg_quality)

    return make_folder(folder, settings, fill, overwrite=overwrite)


def _darken_pictures(
    data_dir: Path,
    files: SceneFiles,
    folder: Path,
    model: CaptureModel,
    jpeg_quality: int,
) -> Facts:
    """Writes the dark pictures under their paths; mean levels of both, and how many."""
    levels, sources = [], files.image_paths
    track = progress.track(sources, len(sources), "darkening", "photo")
    for view, source in enumerate(track):
        srgb = image_io.read_srgb(source, files.upright)
        dark = capture(color.srgb_to_linear(srgb), model, view_key(model, view))
        target = folder / image_io.writable(_inside(data_dir, source))
        srgb_dark = color.quantize(dark / 255.0)
        _store(target, srgb_dark, opaque(files, view), jpeg_quality)
        levels.append((float(dark.mean()), 255.0 * float(srgb.mean())))
    dark_level, truth_level = np.mean(levels, axis=0).tolist()
    facts: Facts = {"dark_level": dark_level, "truth_level": truth_level}
    return facts | {"views": len(sources)}


def _store(
    path: Path, srgb: Float[np.ndarray, "_h _w 3"], opaque: Mask, jpeg_quality: int
) -> None:
    """Writes a picture, through a JPEG file if there is a quality for it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not jpeg_quality:
        image_io.write(path, image_io.with_alpha(srgb, opaque))
    elif path.suffix.lower() in (".jpg", ".jpeg"):
        image_io.write(path, srgb, jpeg_quality=jpeg_quality)
    else:
        with scratch_folder() as scratch:
            compressed = scratch / "photo.jpg"
            image_io.write(compressed, srgb, jpeg_quality=jpeg_quality)
            srgb = image_io.read_srgb(compressed)
            image_io.write(path, image_io.with_alpha(srgb, opaque))


def _check(data_dir: Path, folder: Path, files: SceneFiles) -> None:
    truth = find_truth_folder(data_dir, files.image_paths[0].parent)
    if truth:
        raise UserError(f"{truth}: the scene has normal-light truth already")
    if folder.resolve().is_relative_to(data_dir.resolve()):
        raise UserError(f"{folder}: lies in the dataset itself; choose another folder")
    written = {image_io.writable(path) for path in files.image_paths}
    if len(written) < len(files.image_paths):
        raise UserError(
            f"{data_dir}: two of its pictures differ only in their ending; rename one"
        )
    masks = [path for path in files.mask_paths if path]
    for path in (*files.image_paths, *masks):
        if not _absolute(path).is_relative_to(_absolute(data_dir)):
            raise UserError(f"{path}: lies outside of {data_dir}; move it there")


def _write_readme(
    folder: Path, source: str, model: CaptureModel, jpeg_quality: int
) -> None:
    compression = JPEG.format(quality=jpeg_quality) if jpeg_quality else NO_JPEG
    capture = dataclasses.asdict(model)
    text = README.format(source=source, compression=compression, **capture)
    (folder / "README.txt").write_text(text)


def _copy_truth(data_dir: Path, files: SceneFiles, folder: Path) -> None:
    """The pictures as they are become the truth; their masks hold for both."""
    names = _truth_names(files.names, files.image_paths)
    for source, name in zip(files.image_paths, names, strict=True):
        _copy(source, folder / TRUTH / name)
    for mask in filter(None, files.mask_paths):
        _copy(mask, folder / _inside(data_dir, mask))


def _truth_names(names: Sequence[str], image_paths: Sequence[Path]) -> list[str]:
    """Names in ``high`` by which the loader pairs: bare where one folder has all."""
    if len({path.parent for path in image_paths}) == 1:
        return [path.name for path in image_paths]
    pairs = zip(names, image_paths, strict=True)
    return [str(PurePosixPath(name).with_suffix(path.suffix)) for name, path in pairs]


def _copy_pose_files(data_dir: Path, folder: Path) -> None:
    for pattern in POSE_FILES:
        for source in data_dir.glob(pattern):
            for path in list_files(source) if source.is_dir() else [source]:
                if path.is_file() and not image_io.is_image(path):
                    _copy(path, folder / path.relative_to(data_dir))


def _inside(data_dir: Path, path: Path) -> Path:
    return _absolute(path).relative_to(_absolute(data_dir))


def _absolute(path: Path) -> Path:
    """Without "..", but through links as they are called: a linked folder of
    pictures is a part of the dataset."""
    return Path(os.path.abspath(path))


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target)
