# SPDX-License-Identifier: Apache-2.0
"""Image files, through OpenImageIO (the only module that imports it).

Pictures are ``[height, width, channels]`` float32 sRGB in [0, 1] unless a name
says otherwise; row 0 is the top row. ``upright`` pixels are as seen: the EXIF
orientation is applied. Without it they are as stored, which is what the poses of
programs that ignore the tag (COLMAP, LLFF) mean.
"""

import contextlib
import dataclasses
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from jaxtyping import Bool, Float

from internal.errors import UserError, has_utf8
from internal.files import atomic, color_profile, heif, metadata
from internal.files.color_profile import Encoding

FONT = "DroidSans"
BEST_JPEG = 98
TRANSPOSED = range(5, 9)  # EXIF orientations that swap width and height
EXTENSIONS = heif.EXTENSIONS | frozenset(
    ".png .jpg .jpeg .jpe .jfif .jif .jfi .tif .tiff .webp .bmp .dib .exr .hdr .jp2 "
    ".j2k .jxl .tga .ppm .pgm .pnm".split()
)
WRITTEN = frozenset(".png .jpg .jpeg .jpe .jfif .tif .tiff .bmp".split())
# Their values are light, not sRGB.
LINEAR_EXTENSIONS = frozenset([".exr", ".hdr"])
LINEAR_FORMATS = ("openexr", "hdr")
# Their colours are multiplied by alpha, unless the file says that they are not.
ASSOCIATED_FORMATS = ("tiff", "openexr")
# Many a writer leaves their fourth channel at 0 and means nothing by it.
UNSET_FORMATS = ("bmp", "targa")
PAGED_FORMATS = ("tiff", "gif")
FLOATS = ("float", "half", "double")
LONG = ("int", "uint", "int64", "uint64")
MOVING = "a moving picture; save its frames as photos"
COLOR_KEYS = ("jpeg:ColorSpace", "tiff:ColorSpace")
PRINT_COLORS = ("CMYK", "YCCK", "CIELAB", "ICCLAB", "ITULAB")
JPEG_MARKER = re.compile(rb"\xff[\x02-\xcf\xd8-\xfe]")  # not in coded pixels
JPEG_END = 0xD9
UNSTATED = (2, 2)  # codes of H.273
LEAST_GAMMA = 0.1  # of a PNG: others are mistakes
EXIF_SRGB = 1
EXIF_TEXTS = ("Make", "Model", "Exif:LensModel")
EXIF_NUMBERS = ("Exif:FocalLength", "Exif:FocalLengthIn35mmFilm")
ADOBE_RGB_ENTRIES = (
    b"\x01\0\x02\0\x04\0\0\0R03\0",
    b"\0\x01\0\x02\0\0\0\x04R03\0",
)
MOST_HEADER = 1 << 12  # bytes of a JPEG beside its pixels
RAW_EXTENSIONS = frozenset(
    ".dng .arw .cr2 .cr3 .nef .orf .raf .rw2 .pef .srw .x3f .raw".split()
)


@dataclasses.dataclass(frozen=True)
class Exif:
    """Which camera took a photo, and how wide it saw."""

    camera: str  # maker and model; "" if not stated
    lens: str = ""  # likewise
    focal: float = 0.0  # focal length, mm; 0 if unknown
    focal_35mm: float = 0.0  # for the diagonal of 35 mm film, mm; likewise


@dataclasses.dataclass(frozen=True)
class Header:
    """What a photo's file says before its pixels."""

    stored_size: tuple[int, int]  # width, height
    orientation: int = 1  # of EXIF, 1 to 8; 1: the stored pixels are upright
    has_alpha: bool = False
    is_deep: bool = False  # integers of 16 bits

    def size(self, upright: bool = True) -> tuple[int, int]:
        """(width, height) in pixels, upright or as stored."""
        turned = upright and self.orientation in TRANSPOSED
        width, height = self.stored_size
        return (height, width) if turned else (width, height)


def is_image(path: Path) -> bool:
    """Whether the name ends like an image this module reads (RAW does not)."""
    return path.suffix.lower() in EXTENSIONS


def read_header(path: Path) -> Header:
    """What the file says of its picture, which is not decoded.

    Raises:
        UserError: as ``read_srgb``, as far as the header tells.
    """
    _check_kind(path)
    if heif.is_heif(path):
        size, has_alpha = heif.read_header(path)
        return Header(size, has_alpha=has_alpha)
    with _open(path) as file:
        spec = file.spec()
    return Header(
        (spec.width, spec.height),
        _orientation(path, spec),
        has_alpha=_alpha_channel(spec) >= 0,
        is_deep=str(spec.format) == "uint16",
    )


def read_srgb(path: Path, upright: bool = True) -> Float[np.ndarray, "height width 3"]:
    """Reads one picture, upright or as stored, as float32 sRGB in [0, 1].

    Colours are brought to sRGB from what the file states (``color_profile``); values
    of EXR and HDR files are light. sRGB is not changed by a bit. Grey is repeated to
    three channels. Alpha is composited onto black: in a dark capture a pixel that saw
    nothing is black.

    Raises:
        UserError: the file is missing, empty, cut short, corrupt, RAW, not a picture,
            or one of another kind than a photo.
    """
    pixels, encoding, orientation = _read(path)
    return _to_rgb(_turn(pixels, orientation) if upright else pixels, encoding)


def read_values(path: Path) -> Float[np.ndarray, "height width channels"]:
    """What the file stores, as stored: for pictures of other things than light.

    Values of integers are in [0, 1]; grey or three channels, without alpha.

    Raises:
        UserError: as ``read_srgb``.
    """
    pixels, _, _ = _read(path)
    return pixels[..., : 1 if pixels.shape[-1] < 3 else 3]


def read_alpha(path: Path, upright: bool = True) -> Float[np.ndarray, "height width"]:
    """The last channel of a file whose ``Header.has_alpha``: 1 is opaque.

    Raises:
        UserError: as ``read_srgb``.
    """
    pixels, _, orientation = _read(path)
    return (_turn(pixels, orientation) if upright else pixels)[..., -1]


def read_size(path: Path, upright: bool = True) -> tuple[int, int]:
    """``Header.size`` of a file.

    Raises:
        UserError: as ``read_header``.
    """
    return read_header(path).size(upright)


def read_exif(path: Path) -> Exif:
    """What the camera wrote about the photo; empty for a file that is unreadable."""
    try:
        if heif.is_heif(path):
            texts, numbers = heif.read_camera(path)
        else:
            with _open(path) as file:
                spec = file.spec()
            texts = tuple(map(spec.get_string_attribute, EXIF_TEXTS))
            numbers = tuple(float(spec.getattribute(x) or 0.0) for x in EXIF_NUMBERS)
    except (UserError, OSError):
        return Exif("")
    maker, model, lens = (text.strip() for text in texts)
    return Exif(" ".join(filter(None, (maker, model))), lens, *numbers)


def write(
    path: Path,
    srgb: Float[np.ndarray, "height width channels"],
    *,
    bits: int = 8,
    jpeg_quality: int = BEST_JPEG,
) -> None:
    """Writes integers of 8 bits (or 16, in PNG and TIFF), or in EXR the values as
    they are, by the name's ending, atomically.

    Args:
        jpeg_quality: 1 to 100, of a JPEG, whose colours are at half the size (4:2:0)
            as in cameras.

    Raises:
        UserError: the folder cannot be written or the disk is full.
    """
    buffer = oiio.ImageBuf(np.ascontiguousarray(np.asarray(srgb, np.float32)))
    buffer.set_write_format("float" if path.suffix == ".exr" else f"uint{bits}")
    buffer.specmod()["Compression"] = f"jpeg:{jpeg_quality}"  # no other format heeds it
    with atomic.writing(path) as partial:
        if _kind(path) == "jpeg":  # libjpeg ends the process on a full disk
            atomic.take_room(path.parent, buffer.spec().image_bytes() + MOST_HEADER)
        is_written = buffer.write(str(partial))
        if not is_written or not _is_whole(partial):  # a full disk may be no error
            reason = " ".join(buffer.geterror().split()) or "it is not whole there"
            raise UserError(
                f"{path}: cannot write ({reason}); free space or pick another folder"
            )


def _is_whole(path: Path) -> bool:
    """Whether all of a picture that was written is in its file."""
    has_end = END_CHECKS.get(_kind(path))
    if has_end:
        return has_end(path.read_bytes())
    return oiio.ImageBuf(str(path)).read()


def _kind(path: Path) -> str:
    """The format that is written to a file of that name, as in ``END_CHECKS``."""
    return path.suffix.lower().lstrip(".").replace("jpg", "jpeg")


def with_alpha(
    srgb: Float[np.ndarray, "height width 3"],
    opaque: Bool[np.ndarray, "#height #width"],
) -> Float[np.ndarray, "height width channels"]:
    """The picture with an alpha channel, or as it is if all of it is opaque."""
    if opaque.all():
        return srgb
    alpha = np.broadcast_to(opaque, srgb.shape[:2])[..., None]
    return np.concatenate([srgb, alpha.astype(np.float32)], axis=-1)


def writable(name: Path) -> Path:
    """The name, or that of a PNG where its ending is of a format that ``write`` does
    not write without loss of what the method needs."""
    return name if name.suffix.lower() in WRITTEN else name.with_suffix(".png")


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


def _read(
    path: Path,
) -> tuple[Float[np.ndarray, "height width channels"], Encoding | None, int]:
    """Pixels as stored, with alpha last, by which colours are not multiplied; what they
    mean; and how they are turned."""
    _check_kind(path)
    if heif.is_heif(path):
        photo = heif.read(path)
        encoding = _encoding(path, photo.icc, photo.codes, photo.pixels.shape[-1])
        return photo.pixels, encoding, 1
    with _open(path) as file:
        spec = file.spec()
        pixels = file.read_image(0, 0, 0, spec.nchannels, oiio.FLOAT)
        # What libjpeg only warns about leaves rows grey: it counts as an error.
        error = file.geterror()
        kind = file.format_name()
        encoding = _stated_encoding(path, kind, spec)
        has_end = END_CHECKS.get(kind, lambda _: True)
        if not error and not has_end(path.read_bytes()):
            error = "its end is missing"
    if pixels is None or error:
        raise _unreadable(path, error)
    pixels = np.asarray(pixels, np.float32)[..., _used_channels(spec)]
    if not np.isfinite(pixels).all():
        raise UserError(f"{path}: has pixels that are not numbers; write it again")
    if _alpha_channel(spec) >= 0:
        pixels = _with_plain_alpha(pixels, kind, spec)
    return pixels, encoding, _orientation(path, spec)


def _with_plain_alpha(
    pixels: Float[np.ndarray, "height width channels"], kind: str, spec: oiio.ImageSpec
) -> Float[np.ndarray, "height width channels"]:
    """Pixels whose colours are not multiplied by their alpha, the last channel."""
    colors, alpha = pixels[..., :-1], pixels[..., -1:]
    if kind in UNSET_FORMATS and not alpha.any():
        alpha = np.ones_like(alpha)
    is_straight = spec.get_int_attribute("oiio:UnassociatedAlpha")
    if kind in ASSOCIATED_FORMATS and not is_straight:
        colors = colors / np.where(alpha > 0.0, alpha, 1.0)
    return np.concatenate([colors, alpha], axis=-1)


def _check_kind(path: Path) -> None:
    if path.suffix.lower() in RAW_EXTENSIONS:
        raise UserError(
            f"{path}: RAW photo; the method takes 8-bit sRGB: develop it to JPEG "
            "or PNG with a fixed exposure and white balance first"
        )
    if not path.is_file():
        raise UserError(f"{path}: image not found; check the path in the scene file")
    if not has_utf8(str(path)):
        raise UserError(f"{path}: its name or a folder's is not UTF-8; rename it")
    try:
        with path.open("rb") as file:
            is_empty = not file.read(1)
    except OSError as error:
        raise _unreadable(path, str(error.strerror)) from error
    if is_empty:
        raise _unreadable(path, "the file is empty")


@contextlib.contextmanager
def _open(path: Path) -> Iterator[oiio.ImageInput]:
    """The file, at its first picture; refuses what is no photo by its header."""
    wanted = oiio.ImageSpec()
    wanted["oiio:UnassociatedAlpha"] = 1
    file = oiio.ImageInput.open(str(path), wanted)
    if file is None:
        raise _unreadable(path, oiio.geterror())
    try:
        kind = file.format_name()
        fault = _fault(kind, file.spec())
        if not fault and kind in PAGED_FORMATS:
            fault = _further_pages(file)
        if not fault and kind == "png" and _is_moving_png(path):
            fault = MOVING
        if fault:
            raise UserError(f"{path}: {fault}")
        yield file
    finally:
        file.close()


def _unreadable(path: Path, error: str) -> UserError:
    reason = " ".join(error.replace(f'("{path}")', "").split()) or "no pixels"
    instead = "copy the file again or remove it from the scene"
    if "not configured" in reason:
        instead = "save it with LZW or Deflate, or without compression"
    return UserError(
        f"{path}: not a readable image ({reason}); expected a whole "
        f"JPEG, PNG or TIFF: {instead}"
    )


def _fault(kind: str, spec: oiio.ImageSpec) -> str:
    """Why a file with this header is no photo that can be taken; "" if it is one."""
    colors = spec.nchannels - (_alpha_channel(spec) >= 0)
    if min(spec.width, spec.height, colors) < 1:
        return "no pixels; expected a picture"
    if any(spec.get_string_attribute(key) in PRINT_COLORS for key in COLOR_KEYS):
        return "colours for print (CMYK or Lab), not for light; save it as sRGB"
    if spec.get_int_attribute("oiio:Movie"):
        return MOVING
    if str(spec.format) in FLOATS and kind not in LINEAR_FORMATS:
        return (
            f"numbers of floating point in a {kind} file, which may be light or sRGB; "
            "save light as EXR, sRGB with 8 or 16 bits"
        )
    if str(spec.format) in LONG:
        return (
            "integers of 32 bits, of which nothing tells how many they use; save it "
            "with 8 or 16 bits"
        )
    size = spec.full_width, spec.full_height
    if kind == "openexr" and (spec.width, spec.height) != size:
        return (
            f"holds {spec.width}x{spec.height} pixels of a picture of "
            f"{size[0]}x{size[1]}; save the whole picture"
        )
    names = spec.channelnames
    if colors != 1 and tuple(names[:3]) != ("R", "G", "B"):
        return f"its channels are {', '.join(names[:6])}; expected R, G, B or grey"
    return ""


def _alpha_channel(spec: oiio.ImageSpec) -> int:
    """Its index, -1 without one. Of a GIF the library states one past the last."""
    stated = spec.alpha_channel
    return min(stated, spec.nchannels - 1) if stated > 0 else stated


def _used_channels(spec: oiio.ImageSpec) -> list[int]:
    """Grey or R, G, B, and alpha: not the depths, infrared, ... beside them."""
    channel = _alpha_channel(spec)
    alpha = [channel] if channel >= 0 else []
    return list(range(1 if spec.nchannels - len(alpha) == 1 else 3)) + alpha


def _png_has_end(content: bytes) -> bool:
    """Whether the closing chunk is there; other things may follow it."""
    return b"IEND\xaeB`\x82" in content


def _jpeg_has_end(content: bytes) -> bool:
    """Whether the end marker is there; other pictures may be before and after it.

    A decoder does not miss it where zeros follow, as in a file that was given its
    size before its content came.
    """
    place = 2
    while marker := JPEG_MARKER.search(content, place):
        kind, place = marker[0][1], marker.end()
        if kind == JPEG_END:
            return True
        place += int.from_bytes(content[place : place + 2])
    return False


END_CHECKS = {"jpeg": _jpeg_has_end, "png": _png_has_end}


def _further_pages(file: oiio.ImageInput) -> str:
    """Refuses more than one picture in a file; smaller ones after it are previews."""
    size = file.spec().image_pixels()
    largest, page = 0, 1
    while file.seek_subimage(page, 0):
        largest, page = max(largest, file.spec().image_pixels()), page + 1
    file.seek_subimage(0, 0)
    file.geterror()  # that there is no further one
    return "several pictures in one file; save each of its own" * (largest >= size)


def _is_moving_png(path: Path) -> bool:
    """Whether it is an animation, of whose frames the stored picture may be none."""
    names = [name for name, _ in metadata.png_chunks(path)]
    return b"acTL" in names and (
        names.count(b"fcTL") > 1 or b"fcTL" not in names[: names.index(b"IDAT")]
    )


def _stated_encoding(path: Path, kind: str, spec: oiio.ImageSpec) -> Encoding | None:
    """What the header says its values mean."""
    if kind in LINEAR_FORMATS:
        stated = spec.getattribute("chromaticities")
        return color_profile.from_gamma(1.0, *([tuple(stated)] if stated else []))
    icc = spec.getattribute("ICCProfile")
    codes = (spec.getattribute("CICP") or UNSTATED)[:2]
    colors = spec.nchannels - (_alpha_channel(spec) >= 0)
    encoding = _encoding(path, bytes(icc) if icc is not None else b"", codes, colors)
    if encoding or icc is not None or codes != UNSTATED:
        return encoding
    if kind == "png":
        return _png_encoding(dict(reversed(metadata.png_chunks(path))))
    if kind == "jpeg" and spec.get_int_attribute("Exif:ColorSpace") != EXIF_SRGB:
        return color_profile.adobe_rgb() if _names_adobe_rgb(path) else None
    return None


def _encoding(
    path: Path, icc: bytes, codes: tuple[int, int], channels: int
) -> Encoding | None:
    """Codes before a profile, as PNG and HEIF rank HDR; None for sRGB."""
    try:
        if codes[1] in color_profile.HDR or not icc:
            return color_profile.from_codes(*codes)
        return color_profile.from_icc(icc, 1 if channels < 3 else 3)
    except color_profile.ProfileError as error:
        raise UserError(f"{path}: {error}; save it as sRGB") from error


def _png_encoding(chunks: Mapping[bytes, bytes]) -> Encoding | None:
    """What a PNG states by a gamma and primaries, where it does not say sRGB.

    A gamma of 1/2.2 stands for sRGB's curve, and so does one that nobody means."""
    if b"sRGB" in chunks:
        return None
    gamma = int.from_bytes(chunks.get(b"gAMA", b"")) / 1e5
    is_meant = LEAST_GAMMA < gamma < 1.0 / LEAST_GAMMA and abs(gamma - 1 / 2.2) > 0.002
    power = 1.0 / gamma if is_meant else 0.0
    stated = np.frombuffer(chunks.get(b"cHRM", b"")[:32], ">u4") / 1e5
    white_first = tuple(map(float, stated))
    primaries = (*white_first[2:], *white_first[:2])
    if not color_profile.are_primaries(primaries):
        return color_profile.from_gamma(power) if power else None
    return color_profile.from_primaries(primaries, power)


def _names_adobe_rgb(path: Path) -> bool:
    """Whether EXIF's interoperability index is R03, as cameras say Adobe RGB."""
    with path.open("rb") as file:
        start = file.read(65536)
    return any(entry in start for entry in ADOBE_RGB_ENTRIES)


def _orientation(path: Path, spec: oiio.ImageSpec) -> int:
    """The orientation that EXIF states, or where it has none XMP; 1, as stored, where
    that is none of the eight."""
    stated = spec.getattribute("Orientation")
    orientation = metadata.xmp_orientation(path) if stated is None else int(stated)
    return orientation if orientation in range(1, 9) else 1


def _turn(
    pixels: Float[np.ndarray, "h w channels"], orientation: int
) -> Float[np.ndarray, "h2 w2 channels"]:
    """Stored pixels as seen under an EXIF orientation of 1 to 8."""
    if orientation in TRANSPOSED:
        pixels = pixels.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    return pixels


def _to_rgb(
    pixels: Float[np.ndarray, "height width channels"], encoding: Encoding | None
) -> Float[np.ndarray, "height width 3"]:
    """sRGB on black of 1 to 4 channels, of which the second and fourth are alpha."""
    colors = 1 if pixels.shape[-1] < 3 else 3
    srgb = color_profile.to_srgb(pixels[..., :colors], encoding)
    if pixels.shape[-1] > colors:
        srgb = srgb * pixels[..., colors : colors + 1]
    if colors == 1:
        srgb = np.repeat(srgb, 3, axis=-1)
    return np.ascontiguousarray(srgb)
