# SPDX-License-Identifier: Apache-2.0
"""Image files, through OpenImageIO (the only module that imports it).

Pictures are ``[height, width, channels]`` float32 sRGB in [0, 1] unless a name
says otherwise; row 0 is the top row, as seen (EXIF orientation is applied).
"""

import dataclasses
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from jaxtyping import Float

from internal.errors import UserError
from internal.files import atomic

FONT = "DroidSans"
BEST_JPEG = 98
EXTENSIONS = frozenset(
    ".png .jpg .jpeg .tif .tiff .webp .bmp .exr .hdr .jp2 .jxl .tga .ppm".split()
)
RAW_EXTENSIONS = frozenset(
    ".dng .arw .cr2 .cr3 .nef .orf .raf .rw2 .pef .srw .x3f .raw".split()
)


@dataclasses.dataclass(frozen=True)
class Exif:
    """Which camera took a photo, and how wide it saw."""

    camera: str  # maker and model; "" if not stated
    focal_35mm: float  # focal length for the diagonal of 35 mm film, mm; 0 if unknown


def is_image(path: Path) -> bool:
    """Whether the name ends like an image this module reads (RAW does not)."""
    return path.suffix.lower() in EXTENSIONS


def read_srgb(path: Path) -> Float[np.ndarray, "height width 3"]:
    """Reads one picture, upright, as float32 sRGB in [0, 1].

    Grey is repeated to three channels. Alpha is composited onto black: in a dark
    capture a pixel that saw nothing is black.

    Raises:
        UserError: the file is missing, empty, truncated, corrupt, RAW, or not
            an image.
    """
    if path.suffix.lower() in RAW_EXTENSIONS:
        raise UserError(
            f"{path}: RAW photo; the method takes 8-bit sRGB: develop it to JPEG "
            "or PNG with a fixed exposure and white balance first"
        )
    if not path.is_file():
        raise UserError(f"{path}: image not found; check the path in the scene file")
    spec = oiio.ImageSpec()
    spec["oiio:UnassociatedAlpha"] = 1
    buffer = oiio.ImageBuf(str(path), 0, 0, spec)
    pixels = None if buffer.has_error else _upright(buffer).get_pixels(oiio.FLOAT)
    if pixels is None or buffer.has_error or pixels.size == 0:
        reason = " ".join(buffer.geterror().split()) or "no pixels"
        raise UserError(
            f"{path}: not a readable image ({reason}); expected a whole "
            "JPEG, PNG or TIFF: copy the file again or remove it from the scene"
        )
    return _to_rgb(np.asarray(pixels, np.float32))


def read_size(path: Path) -> tuple[int, int]:
    """Upright (width, height) from the file's header alone."""
    buffer = oiio.ImageBuf(str(path))
    if buffer.has_error:
        return read_srgb(path).shape[1::-1]  # raises with the reason
    spec = buffer.spec()
    turned = buffer.orientation >= 5
    return (spec.height, spec.width) if turned else (spec.width, spec.height)


def read_exif(path: Path) -> Exif:
    """What the camera wrote about the photo; empty for a file that is unreadable."""
    buffer = oiio.ImageBuf(str(path))
    if buffer.has_error:
        return Exif("", 0.0)
    spec = buffer.spec()
    words = (spec.get_string_attribute(key) for key in ("Make", "Model"))
    focal = float(spec.get_int_attribute("Exif:FocalLengthIn35mmFilm", 0))
    return Exif(" ".join(word.strip() for word in words if word.strip()), focal)


def write(
    path: Path,
    srgb: Float[np.ndarray, "height width channels"],
    jpeg_quality: int = BEST_JPEG,
) -> None:
    """Writes 8-bit (PNG, JPEG) or float (EXR) by the name's ending, atomically.

    Args:
        jpeg_quality: 1 to 100, of a JPEG, whose colours are at half the size (4:2:0)
            as in cameras.

    Raises:
        UserError: the folder cannot be written or the disk is full.
    """
    buffer = oiio.ImageBuf(np.ascontiguousarray(np.asarray(srgb, np.float32)))
    buffer.set_write_format("float" if path.suffix == ".exr" else "uint8")
    buffer.specmod()["Compression"] = f"jpeg:{jpeg_quality}"  # no other format heeds it
    with atomic.writing(path) as partial:
        if not buffer.write(str(partial)):
            reason = " ".join(buffer.geterror().split())
            raise UserError(
                f"{path}: cannot write ({reason}); free space or pick another folder"
            )


def resize_area(
    image: Float[np.ndarray, "height width channels"], width: int, height: int
) -> Float[np.ndarray, "{height} {width} channels"]:
    """Area average to a smaller size; exact block means for integer factors."""
    channels = image.shape[-1]
    roi = oiio.ROI(0, width, 0, height, 0, 1, 0, channels)
    buffer = oiio.ImageBuf(np.ascontiguousarray(image, np.float32))
    resized = oiio.ImageBufAlgo.resize(buffer, filtername="box", roi=roi)
    return np.asarray(resized.get_pixels(oiio.FLOAT), np.float32)


def draw_text(
    srgb: Float[np.ndarray, "height width 3"],
    text: str,
    position: tuple[int, int],
    size: int,
    ink: float,
) -> Float[np.ndarray, "height width 3"]:
    """The picture with a grey text whose baseline starts at ``position`` (x, y).

    Raises:
        UserError: the font of OpenImageIO's wheel is missing.
    """
    buffer = oiio.ImageBuf(np.ascontiguousarray(srgb, np.float32))
    color = (ink, ink, ink)
    if not oiio.ImageBufAlgo.render_text(buffer, *position, text, size, FONT, color):
        _raise_no_font(buffer.geterror())
    return np.asarray(buffer.get_pixels(oiio.FLOAT), np.float32)


def text_width(text: str, size: int) -> int:
    """Width in pixels of a text as ``draw_text`` draws it."""
    if not text:
        return 0
    roi = oiio.ImageBufAlgo.text_size(text, size, FONT)
    if not roi.defined:
        _raise_no_font(oiio.geterror())
    return roi.xend


def _raise_no_font(reason: str) -> None:
    raise UserError(
        f"cannot draw labels ({' '.join(reason.split())}): install OpenImageIO's own "
        "wheel, which brings its fonts: pip install --force-reinstall OpenImageIO"
    )


def _upright(buffer: oiio.ImageBuf) -> oiio.ImageBuf:
    """Applies the EXIF orientation."""
    return buffer if buffer.orientation == 1 else oiio.ImageBufAlgo.reorient(buffer)


def _to_rgb(
    pixels: Float[np.ndarray, "height width channels"],
) -> Float[np.ndarray, "height width 3"]:
    if pixels.shape[-1] in (2, 4):
        pixels = pixels[..., :-1] * pixels[..., -1:]
    if pixels.shape[-1] == 1:
        pixels = np.repeat(pixels, 3, axis=-1)
    return np.ascontiguousarray(pixels[..., :3])
