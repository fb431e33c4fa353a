# SPDX-License-Identifier: Apache-2.0
"""Which pictures a folder holds: the one place that lists files of photos.

Links to files and folders are followed, each folder is entered once, and a real one
before a link to it. What systems and servers leave behind (thumbnails, metadata,
waste) is no photo. A picture that no program here reads is left out with a reason.

A *name* is a path relative to its folder, in POSIX spelling ("1.JPG",
"left/1.JPG"), as the disk spells it. ``composed`` is how names are compared: disks
and pose files write the same letter in one or in two characters.
"""

import contextlib
import dataclasses
import functools
import os
import unicodedata
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath

from internal import extras
from internal.errors import UserError, has_utf8
from internal.files import heif, image_io

# What systems and servers leave beside files, in lower case; and names with a dot.
METADATA = frozenset(
    [
        *("__macosx", "@eadir", "@__thumb", "@recycle", "@recently-snapshot"),
        *("#recycle", "#snapshot", "$recycle.bin", "recycler", "lost+found"),
        *("system volume information", "network trash folder", "temporary items"),
        *("thumbs.db", "ehthumbs.db", "desktop.ini", "icon\r"),
    ]
)
# Folders whose names may be the user's: what they hold is left out by name.
SET_ASIDE = frozenset("trash thumbs thumbnails thumbnail _thumbs _thumbnails".split())
# Endings of pictures that are not read.
OTHER_RAW = frozenset(".nrw .3fr .fff .iiq .erf .mef .mos .mrw .kdc .dcr .gpr".split())
OTHER = frozenset(
    ".gif .psd .psb .svg .ai .eps .ico .xcf .kra .pcx .fits .dds .pfm .jxr .wdp "
    ".jls .jpm .j2c .jpf .jpx .bpg .pict .rgbe .sgi .cin .dpx .tx".split()
)
LIKE_PICTURES = image_io.EXTENSIONS | image_io.RAW_EXTENSIONS | OTHER | OTHER_RAW


@dataclasses.dataclass(frozen=True)
class LeftOut:
    """A picture that is not taken."""

    name: str
    reason: str


@dataclasses.dataclass(frozen=True)
class Listing:
    """What a folder and its subfolders hold, each sorted by name."""

    pictures: tuple[str, ...]
    raw: tuple[str, ...]  # which must be developed
    left_out: tuple[LeftOut, ...]


def is_metadata(path: Path) -> bool:
    """Whether a name says that a system left the file or folder, not the user."""
    name = path.name.casefold()
    return name.startswith(".") or name in METADATA


def composed(name: str) -> str:
    """The name in Unicode's composed form (NFC), by which names are compared."""
    return unicodedata.normalize("NFC", name)


def is_file(path: Path) -> bool:
    """Whether there is such a file: no, and no error, also for a name that files are
    asked for but that no disk takes."""
    return os.path.isfile(path)


def find_file(path: Path) -> Path:
    """The path, or the one there that differs only in Unicode's form; else itself."""
    if os.path.exists(path):
        return path
    found = Path()
    for place, part in enumerate(path.parts):
        if not os.path.exists(found / part):
            has_forms = not part.isascii() and os.path.isdir(found)
            beside = sorted(found.iterdir()) if has_forms else []
            alike = [x for x in beside if composed(x.name) == composed(part)]
            if not alike:
                return found.joinpath(*path.parts[place:])
            part = alike[0].name
        found /= part
    return found


def list_files(folder: Path) -> Iterator[Path]:
    """All files in a folder and its subfolders that are the user's, as paths below
    ``folder``; also links to nothing, and what is no regular file."""
    entered: set[tuple[int, int]] = set()
    waiting = [folder]
    links: list[Path] = []
    while waiting or links:
        current = waiting.pop() if waiting else links.pop(0)
        with contextlib.suppress(OSError):  # gone, or not ours to read
            stat = current.stat()
            if (stat.st_dev, stat.st_ino) in entered:
                continue
            entered.add((stat.st_dev, stat.st_ino))
            for path in sorted(current.iterdir()):
                if is_metadata(path):
                    continue
                if path.is_dir():
                    (links if path.is_symlink() else waiting).append(path)
                else:
                    yield path


def find_pictures(folder: Path) -> Listing:
    """Lists the pictures of a folder and its subfolders.

    Raises:
        UserError: the folder is missing.
    """
    if not folder.is_dir():
        raise UserError(f"{folder}: folder of pictures not found; check the path")
    pictures, raw, left_out = [], [], []
    for path in list_files(folder):
        if path.suffix.lower() not in LIKE_PICTURES:
            continue
        inside = path.relative_to(folder)
        name = inside.as_posix()
        reason = _why_not(path)
        if not has_utf8(name):
            reason = "its name or a folder's is not UTF-8; rename it"
            name = name.encode(errors="backslashreplace").decode()
        elif "\n" in name or "\r" in name:
            reason = "a line break in its name; rename it"
            name = repr(name)[1:-1]
        if not reason and SET_ASIDE.intersection(map(str.casefold, inside.parts[:-1])):
            reason = "in a folder of thumbnails or waste"
        if reason:
            left_out.append(LeftOut(name, reason))
        elif path.suffix.lower() in image_io.RAW_EXTENSIONS:
            raw.append(name)
        else:
            pictures.append(name)
    left_out.sort(key=lambda entry: entry.name)
    return Listing(tuple(sorted(pictures)), tuple(sorted(raw)), tuple(left_out))


def list_pictures(folder: Path) -> tuple[str, ...]:
    """Sorted names of all pictures in a folder and its subfolders that can be read
    as they are; names those that are left out, once.

    Raises:
        UserError: the folder is missing or holds no picture.
    """
    found = find_pictures(folder)
    raw = [LeftOut(name, "RAW, to be developed first") for name in found.raw]
    left_out = [*found.left_out, *raw]
    if not found.pictures:
        hint = "copy the photos there"
        if raw:
            hint = "RAW photos must be developed to JPEG or PNG first"
        if found.left_out:
            hint = f"left out: {by_reason(found.left_out)}"
        raise UserError(f"{folder}: no picture (PNG, JPEG, TIFF, ...) in it; {hint}")
    if left_out:
        say_once(f"{folder}: left out: {by_reason(left_out)}")
    return found.pictures


def by_reason(left_out: Sequence[LeftOut]) -> str:
    """All names, by reason."""
    reasons = dict.fromkeys(entry.reason for entry in left_out)
    return "; ".join(
        f"{', '.join(entry.name for entry in left_out if entry.reason == reason)} "
        f"({reason})"
        for reason in reasons
    )


def flat_pngs(names: Sequence[str]) -> tuple[str, ...]:
    """File names of PNGs of these pictures where there are no folders, all different
    on any disk: "1.JPG" is "1.png", "left/1.JPG" is "left_1.png".

    Of names that would meet, those after the first keep their ending ("1_jpg.png")
    or, if that is taken too, get a number.
    """
    taken: set[str] = set()
    flat = []
    for name in names:
        path = PurePosixPath(name)
        parts = (*path.parent.parts, path.stem)
        stem = "_".join(part for part in parts if part.strip("/.")) or "picture"
        ending = path.suffix.lstrip(".")
        numbered = (f"{stem}_{ending}_{count}" for count in range(2, len(names) + 2))
        choices = (stem, f"{stem}_{ending}", *numbered)
        free = next(c for c in choices if composed(c).casefold() not in taken)
        taken.add(composed(free).casefold())
        flat.append(f"{free}.png")
    return tuple(flat)


def _why_not(path: Path) -> str:
    """Why a file that ends like a picture is not taken; "" if it is."""
    ending = path.suffix.lower()
    if ending in OTHER | OTHER_RAW:
        what = "RAW of a kind" if ending in OTHER_RAW else "a kind of picture"
        return f"{what} that is not read; export it to JPEG or PNG"
    if not path.is_file():
        is_dangling = path.is_symlink() and not path.exists()
        return "a link to nothing" if is_dangling else "not a file"
    if ending in heif.EXTENSIONS and not extras.has("pillow_heif"):
        return f"needs the extra: {extras.install('heif')}"
    return ""


@functools.cache
def say_once(line: str) -> None:
    """Prints a line that several steps would print."""
    print(line, flush=True)
