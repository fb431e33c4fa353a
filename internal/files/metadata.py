# SPDX-License-Identifier: Apache-2.0
"""What picture files state beside their pixels and OpenImageIO does not pass on: the
chunks of a PNG, and the XMP packet of JPEG, PNG, WebP and TIFF.

Files are walked from chunk to chunk; what is broken states nothing.
"""

import contextlib
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

PNG_START = b"\x89PNG\r\n\x1a\n"
PNG_PIXELS = (b"IDAT", b"fdAT")
PNG_XMP = b"XML:com.adobe.xmp\0"
JPEG_START, JPEG_XMP = b"\xff\xd8", b"http://ns.adobe.com/xap/1.0/\0"
JPEG_APP1, JPEG_SCAN = 0xE1, 0xDA
TIFF_STARTS = {b"II*\0": "<", b"MM\0*": ">"}
TIFF_XMP = 700
LARGEST = 1 << 22  # bytes of a chunk that is read
MOST_CHUNKS = 10_000
XMP_ORIENTATION = re.compile(rb"tiff:Orientation\s*(?:=\s*[\"']|>)\s*([1-8])\s*[\"'<]")

Chunk = tuple[bytes, bytes]  # name, content


def png_chunks(path: Path) -> list[Chunk]:
    """The chunks of a PNG in their order, those of pixels without content."""
    with path.open("rb") as file:
        if file.read(len(PNG_START)) != PNG_START:
            return []
        return list(_png(file))


def xmp_orientation(path: Path) -> int:
    """The orientation, 1 to 8, that a picture's XMP states; 0 for none."""
    found = XMP_ORIENTATION.search(_xmp(path))
    return int(found[1]) if found else 0


def _xmp(path: Path) -> bytes:
    with path.open("rb") as file, contextlib.suppress(struct.error):
        start = file.read(12)
        if start.startswith(PNG_START):
            file.seek(len(PNG_START))
            texts = (content for name, content in _png(file) if name == b"iTXt")
            return next((text for text in texts if text.startswith(PNG_XMP)), b"")
        if start.startswith(JPEG_START):
            file.seek(len(JPEG_START))
            return b"".join(_jpeg_packets(file))
        if start[:4] == b"RIFF" and start[8:] == b"WEBP":
            return dict(_riff(file)).get(b"XMP ", b"")
        if start[:4] in TIFF_STARTS:
            return _tiff_packet(file, TIFF_STARTS[start[:4]])
    return b""


def _png(file: BinaryIO) -> Iterator[Chunk]:
    for _ in range(MOST_CHUNKS):
        head = file.read(8)
        if len(head) < 8:
            return
        size, name = struct.unpack(">I4s", head)
        yield name, _content(file, 0 if name in PNG_PIXELS else size, size + 4)


def _riff(file: BinaryIO) -> Iterator[Chunk]:
    for _ in range(MOST_CHUNKS):
        head = file.read(8)
        if len(head) < 8:
            return
        name, size = struct.unpack("<4sI", head)
        yield name, _content(file, size if name == b"XMP " else 0, size + size % 2)


def _content(file: BinaryIO, size: int, whole: int) -> bytes:
    """The first bytes of a chunk, none of a huge one; the file is then behind it."""
    start = file.tell()
    content = file.read(size) if size <= LARGEST else b""
    file.seek(start + whole)
    return content


def _jpeg_packets(file: BinaryIO) -> Iterator[bytes]:
    """What XMP segments hold, up to the pixels."""
    for _ in range(MOST_CHUNKS):
        marker, kind, size = struct.unpack(">BBH", file.read(4))
        if marker != 0xFF or kind == JPEG_SCAN:
            return
        content = file.read(size - 2) if size > 2 else b""
        if kind == JPEG_APP1 and content.startswith(JPEG_XMP):
            yield content


def _tiff_packet(file: BinaryIO, order: str) -> bytes:
    """The XMP of the first page; none of a file of more than 4 GB (BigTIFF)."""
    file.seek(4)
    file.seek(*struct.unpack(f"{order}I", file.read(4)))
    (count,) = struct.unpack(f"{order}H", file.read(2))
    for _ in range(count):
        tag, _kind, size, place = struct.unpack(f"{order}HHII", file.read(12))
        if tag == TIFF_XMP and 4 < size <= LARGEST:
            file.seek(place)
            return file.read(size)
    return b""
