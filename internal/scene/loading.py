# SPDX-License-Identifier: Apache-2.0
"""What ``scene.load_scene`` takes from files: lens sizes, split, pictures, truth.

Pictures are read as float sRGB in [0, 1] and returned as uint16, 65535 being 1.0.
"""

import dataclasses
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, UInt16

from internal import color
from internal.cameras import Lens
from internal.errors import UserError
from internal.files import image_io
from internal.files.listing import list_pictures, say_once
from internal.scene import colmap
from internal.scene.masks import Mask, blackened, is_of_shape
from internal.scene.pairing import find_truth_folder, pair_truth, some
from internal.scene.readers.base import SceneFiles
from internal.scene.unround import is_rounded, unround

BRIGHTER = 4.0  # times the light of dark photos: exposures of one series differ less
LOOKED_AT = 3  # photos of each
LEAST_LIGHT = 1e-4  # for the ratio that is printed


@dataclasses.dataclass(frozen=True)
class Truth:
    """Normal-light twins of views, by view."""

    paths: dict[int, Path]
    reason: str  # for messages
    is_alone: bool = False  # the test views have no dark photos, these instead


def fit_lenses(files: SceneFiles, factor: int) -> tuple[Lens, ...]:
    """The lenses at the size of the pictures as found, divided by ``factor``.

    Raises:
        UserError: a picture has another shape than its lens.
    """
    if factor < 1:
        raise UserError(f"Config.factor = {factor}: expected 1 or more")
    fitted = []
    for path, lens in zip(files.image_paths, files.lenses, strict=True):
        width, height = image_io.read_size(path, files.upright)
        if not _has_shape(width, height, lens):
            turned = " as stored" * (not files.upright)
            if files.upright and image_io.read_header(path).orientation != 1:
                turned = " turned by EXIF orientation"
            raise UserError(
                f"{path}: {width}x{height} pixels{turned}, but its lens is stated for "
                f"{lens.width}x{lens.height}, another shape; use the photos that the "
                "poses were estimated from, not turned or cropped since"
            )
        if factor > min(width, height):
            raise UserError(f"{path}: {width}x{height} pixels over factor {factor}")
        fitted.append(colmap.scale_lens(lens, width // factor, height // factor))
    return tuple(fitted)


def held_out(files: SceneFiles, holdout: int) -> Bool[np.ndarray, " n"]:
    """Which views are for testing: as the files say, else views 0, holdout, ..."""
    if files.test_names is not None:
        return np.array([name in files.test_names for name in files.names])
    index = np.arange(len(files.names))
    return index % holdout == 0 if holdout > 0 else np.zeros(len(index), bool)


def find_truth(
    files: SceneFiles, data_dir: Path, gt_dir: str, is_test: Bool[np.ndarray, " n"]
) -> Truth:
    """Pairs views with their normal-light twins, if there is a folder of them.

    Test views are truth themselves where they show that they are: in other folders
    than all training photos, and ``BRIGHTER`` times as bright.

    Raises:
        UserError: the folder's pictures cannot be paired with any view.
    """
    alone = _bright_alone(files, is_test) if not gt_dir else 0.0
    if alone:
        paths = {v: files.image_paths[v] for v in np.flatnonzero(is_test).tolist()}
        first = paths[min(paths)]
        return Truth(
            paths,
            f"the test views' own photos ({first.parent.name}/{first.name}, ...), "
            f"which have {alone:.0f} times the light of the training photos; they "
            "have no dark photos",
            is_alone=True,
        )
    dark_folders = {path.parent for path in files.image_paths}
    first_dark = files.image_paths[0].parent
    folder = data_dir / gt_dir if gt_dir else find_truth_folder(data_dir, first_dark)
    if folder is None:
        return Truth({}, "none found; Config.gt_dir names its folder")
    if len(dark_folders) == 1:
        names = tuple(path.name for path in files.image_paths)
        found, rule = pair_truth(names, folder, list_pictures(first_dark))
    else:
        names = files.names
        found, rule = pair_truth(names, folder)
    paths = {view: found[name] for view, name in enumerate(names) if name in found}
    pairs = [(names[view], path.name) for view, path in list(paths.items())[:3]]
    shown = ", ".join(f"{dark} -> {bright}" for dark, bright in pairs)
    reason = f"{folder}, paired by {rule}: {shown}"
    lonely = [files.names[v] for v in np.flatnonzero(is_test) if v not in paths]
    if lonely:
        reason += f"; none for {some(lonely)} of {is_test.sum()} test views"
    return Truth(paths, reason)


def _bright_alone(files: SceneFiles, is_test: Bool[np.ndarray, " n"]) -> float:
    """How many times the light of training photos test photos have, if they are no
    dark photos; else 0. A few of each tell."""
    trained = [p for p, t in zip(files.image_paths, is_test, strict=True) if not t]
    tested = [p for p, t in zip(files.image_paths, is_test, strict=True) if t]
    if not tested or {p.parent for p in trained} & {p.parent for p in tested}:
        return 0.0
    dark, bright = (
        np.mean([color.photo_to_linear(image_io.read_srgb(p)).mean() for p in paths])
        for paths in (trained[:LOOKED_AT], tested[:LOOKED_AT])
    )
    return float(bright / max(dark, LEAST_LIGHT)) if bright > BRIGHTER * dark else 0.0


def load_picture(
    path: Path, lens: Lens, mask: Mask, upright: bool = True, *, unrounded: bool = False
) -> UInt16[np.ndarray, "_h _w 3"]:
    """A picture, upright or as stored, at the size of its lens, black where masked;
    ``unrounded``: see ``internal/scene/unround``.

    Unrounded after shrinking, which keeps the bounds of rounding and costs less.
    """
    srgb = blackened(image_io.read_srgb(path, upright), mask)
    shrunk = _fit(srgb, lens)
    if unrounded and is_rounded(srgb):
        shrunk = unround(shrunk)
    return color.to_uint16(shrunk)


def load_truth(
    path: Path, dark_path: Path, lens: Lens, mask: Mask, upright: bool
) -> UInt16[np.ndarray, "_h _w 3"]:
    """A normal-light twin at the size of the dark picture's lens, black where masked.

    Where the dark pictures are taken as stored, so is a twin whose stored pixels
    have their shape; another lost its orientation or got one: it is taken upright. A
    larger twin of their shape is brought to their size.

    Raises:
        UserError: it is smaller than the dark picture, or of another shape, by more
            than one pixel.
    """
    as_stored = not upright and _has_shape(*image_io.read_size(path, False), lens)
    truth = blackened(image_io.read_srgb(path, not as_stored), mask)
    height, width, _ = truth.shape
    dark_width, dark_height = image_io.read_size(dark_path, upright)
    difference = max(abs(width - dark_width), abs(height - dark_height))
    if width > dark_width + 1 and _has_shape(width, height, lens):
        say_once(
            f"{path.parent}: truth of {width}x{height} pixels is brought to the "
            f"{dark_width}x{dark_height} of its photos by area average"
        )
    elif difference > 1:
        raise UserError(
            f"{path}: {width}x{height} pixels, but the dark {dark_path} has "
            f"{dark_width}x{dark_height}; truth must show the same pixels: "
            "resize it or point Config.gt_dir elsewhere"
        )
    elif difference == 1:
        print(f"warning: {path}: one pixel off {dark_path}; resized to its size")
    return color.to_uint16(_fit(truth, lens))


def _has_shape(width: int, height: int, lens: Lens) -> bool:
    """Whether a picture shows what its lens does: not one that was cropped, which is
    of another shape by more than a pixel of the smaller of the two sizes."""
    across, down = width * lens.height, height * lens.width
    pixel = max(width + height, lens.width + lens.height)
    is_near = is_of_shape((width, height), (lens.width, lens.height))
    return is_near and abs(across - down) <= pixel


def _fit(
    srgb: Float[np.ndarray, "_h _w 3"], lens: Lens
) -> Float[np.ndarray, "_h2 _w2 3"]:
    if srgb.shape[:2] == (lens.height, lens.width):
        return srgb
    return image_io.resize_area(srgb, lens.width, lens.height)
