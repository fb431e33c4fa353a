# SPDX-License-Identifier: Apache-2.0
"""HEIC, HEIF and AVIF photos, through pillow-heif and Pillow (the only module that
imports them).

The optional extra ``heif`` brings both. What turns such a photo is a part of its
format, not a tag beside it: all programs see the same pixels, so "as stored" and
"upright" mean the same here.
"""

import contextlib
import dataclasses
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from internal import extras
from internal.errors import UserError, one_line

EXTENSIONS = frozenset(".heic .heif .hif .avif".split())
BRANDS = tuple(b"heic heix hevc hevx heim heis mif1 msf1 avif avis".split())
CAMERA_TAGS = (0x010F, 0x0110)  # of EXIF: maker, model
EXIF_FOLDER = 0x8769
LENS_TAG = 0xA434
FOCAL_TAGS = (0x920A, 0xA405)  # in mm; of 35 mm film
STATED = b"colrnclx"  # before the codes of H.273


@dataclasses.dataclass(frozen=True)
class Decoded:
    """A decoded photo."""

    pixels: Float[np.ndarray, "h w channels"]  # 1 to 4 channels in [0, 1], alpha last
    icc: bytes  # empty if there is no profile
    codes: tuple[int, int]  # primaries and transfer of H.273; 2, 2 if not stated


def is_heif(path: Path) -> bool:
    """Whether the file's first bytes say so, whatever its name is."""
    with path.open("rb") as file:
        start = file.read(12)
    return start[4:8] == b"ftyp" and start[8:12] in BRANDS


def read(path: Path) -> Decoded:
    """Decodes the photo: HEIF at its full depth, AVIF at 8 bits.

    Raises:
        UserError: the extra is missing, the file is cut short or broken, or moves.
    """
    with _opened(path) as image:
        pixels = np.asarray(image)
        one = _white(image.info.get("bit_depth", 8), pixels.dtype)
        icc = image.info.get("icc_profile") or b""
    pixels = pixels.astype(np.float32) / np.float32(one)
    return Decoded(np.atleast_3d(pixels), icc, _codes(path))


def read_header(path: Path) -> tuple[tuple[int, int], bool]:
    """(width, height) in pixels, and whether there is an alpha channel.

    Raises:
        UserError: as ``read``, as far as the header tells.
    """
    with _opened(path) as image:
        return image.size, "A" in image.mode


def read_camera(path: Path) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """Maker, model and lens, and the focal lengths in mm, its own and for 35 mm film,
    as EXIF states them; "" and 0 where it does not."""
    from PIL import Image

    with _opened(path) as image:
        tags = Image.Exif()
        tags.load(image.info.get("exif") or b"")
    more = tags.get_ifd(EXIF_FOLDER)
    texts = [*(tags.get(tag, "") for tag in CAMERA_TAGS), more.get(LENS_TAG, "")]
    numbers = (more.get(tag) or 0.0 for tag in FOCAL_TAGS)
    return tuple(map(str, texts)), tuple(map(float, numbers))


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The photo, upright, which is decoded when its pixels are asked for."""
    what = f"{path}: a HEIC, HEIF or AVIF photo"
    extras.need("heif", "pillow_heif", to=what, otherwise="export it to JPEG")
    import pillow_heif
    from PIL import Image, ImageOps

    try:
        if _is_avif(path):
            with Image.open(path) as image:
                if getattr(image, "is_animated", False):
                    raise UserError(f"{path}: a moving picture; save its frames")
                yield ImageOps.exif_transpose(image)
        else:
            yield pillow_heif.open_heif(path, convert_hdr_to_8bit=False)
    except (OSError, ValueError, SyntaxError, RuntimeError, EOFError) as error:
        raise UserError(
            f"{path}: not a readable image ({one_line(error)}); expected a whole HEIC, "
            "HEIF or AVIF: copy the file again or remove it from the scene"
        ) from error


def _is_avif(path: Path) -> bool:
    with path.open("rb") as file:
        return b"avi" in file.read(32)[8:]


def _white(bits: int, dtype: np.dtype) -> int:
    """The stored value of white: deep photos fill 16 bits from the top."""
    return 255 if dtype == np.uint8 else (2**bits - 1) << (16 - bits)


def _codes(path: Path) -> tuple[int, int]:
    """Primaries and transfer that the header states."""
    with path.open("rb") as file:
        header = file.read(65536)
    start = header.find(STATED)
    if start < 0:
        return 2, 2
    return struct.unpack_from(">HH", header.ljust(65544), start + len(STATED))
