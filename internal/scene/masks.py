# SPDX-License-Identifier: Apache-2.0
"""Masks: which pixels of a photo count. The others are neither trained, metered nor
scored.

A mask is a picture, black where the photo is ignored (``mask_files`` finds it), or the
other way round where a scene's masks hide. A
photo's own alpha is one too: what is not opaque is ignored, but in Blender's scenes,
whose transparent pixels are known to be empty. In memory a mask is bool, True where the
pixel counts; it follows the photo to any size, where a pixel counts if all counts that
it covers.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from internal.cameras import Lens
from internal.errors import UserError
from internal.files import image_io
from internal.files.listing import say_once
from internal.scene.readers.base import SceneFiles

Mask = Bool[np.ndarray, "_h _w"]

ASPECT_TOLERANCE = 0.02  # of pictures that show the same
OPAQUE = 0.999  # the faintest level of transparency in 8 bits is below
MOST = 0.5  # of the pixels; more are masked by mistake as often as not
ALL = np.ones((1, 1), bool)  # broadcasts to the mask of which every pixel counts
STRIPE, PERIOD = 2, 6  # pixels, of what stands for masked ones
STRIPE_LEVEL = 0.45  # sRGB, on black


def load_masks(
    files: SceneFiles, lenses: Sequence[Lens], is_test: Bool[np.ndarray, " n"]
) -> tuple[Mask, ...]:
    """The masks of all views at the sizes of their lenses; () if all pixels count.

    A test view that is masked as a whole is named: it has no scores.

    Raises:
        UserError: a mask is missing, unreadable or of another shape than its photo, or
            masks all of a training photo, or of all test views.
    """
    masks = []
    for view, lens in enumerate(lenses):
        mask = resize_mask(read_mask(files, view), lens.width, lens.height)
        masks.append(mask)
    seen = np.array([mask.any() for mask in masks])
    scored = bool((seen & is_test).any())
    for view in np.flatnonzero(~seen):
        photo = files.image_paths[view]
        fault = f"{files.mask_paths[view] or photo}: all of {photo.name} is masked"
        if not (is_test[view] and scored):
            raise UserError(
                f"{fault}; black is ignored, white is used: correct the mask, or take "
                "the photo out of the scene"
            )
        say_once(f"WARNING: {fault}: this test view is not scored")
    return () if all(mask.all() for mask in masks) else tuple(masks)


def read_mask(files: SceneFiles, view: int) -> Mask:
    """Which pixels of a view's photo count, at the photo's size.

    Raises:
        UserError: as ``load_masks``.
    """
    photo, path = files.image_paths[view], files.mask_paths[view]
    width, height = image_io.read_size(photo, files.upright)
    mask = everything(width, height)
    if path:
        counts = _read_hiding if files.masks_hide else _read
        mask = mask & counts(path, photo, (width, height), files.upright)
    return mask & opaque(files, view)


def opaque(files: SceneFiles, view: int) -> Mask:
    """Which pixels of a view's photo are not masked by its own alpha."""
    photo = files.image_paths[view]
    if files.transparent_is_black or not image_io.read_header(photo).has_alpha:
        return ALL
    return image_io.read_alpha(photo, files.upright) > OPAQUE


def everything(width: int, height: int) -> Mask:
    """The mask of a photo of which every pixel counts, in one byte of memory."""
    return np.broadcast_to(np.True_, (height, width))


def resize_mask(mask: Mask, width: int, height: int) -> Mask:
    """The mask at another size: True where all pixels are that the new one covers."""
    if mask.all():
        return everything(width, height)
    for axis, size in enumerate((height, width)):
        old = mask.shape[axis]
        if old != size:
            place = np.arange(size)
            first, last = place * old // size, -(-(place + 1) * old // size)
            false = np.cumsum(~mask, axis=axis, dtype=np.int32)
            none = np.zeros_like(false.take([0], axis=axis))
            false = np.concatenate([none, false], axis=axis)
            mask = false.take(last, axis=axis) == false.take(first, axis=axis)
    return mask


def blackened(
    srgb: Float[np.ndarray, "height width 3"], mask: Mask
) -> Float[np.ndarray, "height width 3"]:
    """The picture, black where a mask of any size ignores it: what was there is in
    nothing that is computed from it."""
    if mask.all():
        return srgb
    hidden = resize_mask(~mask, srgb.shape[1], srgb.shape[0])
    return np.where(hidden[..., None], np.float32(0.0), srgb)


def filled(
    srgb: Float[np.ndarray, "height width 3"],
    mask: Bool[np.ndarray, "#height #width"],
) -> Float[np.ndarray, "height width 3"]:
    """The picture, where a mask ignores it as the nearest pixel that counts: for what
    looks at neighbours and has to look at something."""
    if mask.all():
        return srgb
    hidden = ~np.broadcast_to(mask, srgb.shape[:2])
    nearest = ndimage.distance_transform_edt(
        hidden, return_distances=False, return_indices=True
    )
    row, column = np.asarray(nearest)
    return srgb[row, column]


def hatched(
    srgb: Float[np.ndarray, "height width 3"], mask: Mask
) -> Float[np.ndarray, "height width 3"]:
    """The picture, with diagonal stripes where a mask ignores it: for people."""
    row, column = np.indices(mask.shape)
    stripes = np.where((row + column) % PERIOD < STRIPE, STRIPE_LEVEL, 0.0)
    return np.where(mask[..., None], srgb, np.float32(stripes[..., None]))


def count_masked(masks: Sequence[Mask]) -> str:
    """How many photos and pixels are masked."""
    masked = sum(not mask.all() for mask in masks)
    share = 100.0 * masked_share(masks)
    return f"{masked} of {len(masks)} photos, {share:.1f} % of the pixels"


def masked_share(masks: Sequence[Mask]) -> float:
    """The masked part of all pixels, 0 to 1."""
    counted = sum(int(np.count_nonzero(mask)) for mask in masks)
    return 1.0 - counted / sum(mask.size for mask in masks)


def report(masks: Sequence[Mask]) -> None:
    """Prints how much is masked, where anything is."""
    if masks:
        print(f"  masks: {count_masked(masks)}")
        if masked_share(masks) > MOST:
            print(
                "WARNING: masks cover more than half of the pixels. Black is ignored, "
                "white is used: invert masks that mean the opposite"
            )


def is_of_shape(size: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether two pictures, (width, height) each, can show the same at two sizes."""
    ratio = size[0] * other[1] / (size[1] * other[0])
    return abs(ratio - 1.0) <= ASPECT_TOLERANCE


def _read(path: Path, photo: Path, size: tuple[int, int], upright: bool) -> Mask:
    """A mask file at the size of its photo.

    Black is ignored. A file that has white is cut halfway to it, so that neither soft
    edges nor what JPEG leaves around them count; in one that has none, whose values are
    numbers of classes, all but 0 counts.
    """
    srgb = _read_shape(path, photo, size, upright)
    least = 0.5 if srgb.max() > 0.5 else 0.0
    return resize_mask(np.asarray((srgb > least).any(axis=-1)), *size)


def _read_hiding(path: Path, photo: Path, size: tuple[int, int], upright: bool) -> Mask:
    """A mask file of the other custom: all that is not black is ignored."""
    srgb = _read_shape(path, photo, size, upright)
    return resize_mask(np.asarray((srgb == 0.0).all(axis=-1)), *size)


def _read_shape(
    path: Path, photo: Path, size: tuple[int, int], upright: bool
) -> Float[np.ndarray, "_h _w 3"]:
    """The picture of a mask, which must have the shape of its photo."""
    srgb = image_io.read_srgb(path, upright)
    height, width = srgb.shape[:2]
    if not is_of_shape((width, height), size):
        raise UserError(
            f"{path}: {width}x{height} pixels, but its photo {photo} has "
            f"{size[0]}x{size[1]}, another shape; make the mask from this photo"
        )
    return srgb
