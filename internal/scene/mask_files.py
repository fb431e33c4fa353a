# SPDX-License-Identifier: Apache-2.0
"""Where the masks of photos lie: nerfstudio's ``mask_path`` names them, else they are
found by name in a folder ``masks``, as COLMAP and nerfstudio lay them out.

The mask of ``1.jpg`` is ``1.png`` or ``1.jpg.png``; ``masks.py`` says what is in it.
Those of instant-ngp, ``dynamic_mask_1.png`` beside ``1.jpg``, mean the opposite.
"""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from internal.errors import UserError
from internal.files.listing import (
    composed,
    find_pictures,
    is_file,
    list_files,
    list_pictures,
    say_once,
)
from internal.scene.pairing import match_by_name

FOLDER = "masks"
ALIKE = re.compile(r"(images?[ _-]?)?masks?|masks?[ _-]images?")
SHOWN = 10  # names in a message
HIDING = "dynamic_mask_"  # instant-ngp's: what is black in it counts


def find_masks(
    data_dir: Path, folder: Path, names: Sequence[str]
) -> tuple[Path | None, ...]:
    """The mask of each photo in a folder ``masks`` beside the photos' folder, by name;
    None for photos without, of which every pixel counts.

    Beside ``images_4`` it may be called ``masks_4``.

    Args:
        folder: of the photos; masks beside one that lies elsewhere are not looked for,
            only those of the scene.
        names: of the photos, from that folder on.

    Raises:
        UserError: no mask of a folder is called like a photo.
    """
    inside = folder.is_relative_to(data_dir)
    own = folder.relative_to(data_dir) if inside else Path("images")
    places = [_place(data_dir, own / name) for name in names]
    if not any(masks for masks, _ in places):
        _name_alike(data_dir)
    found: dict[Path, dict[str, Path]] = {}
    for masks in dict.fromkeys(masks for masks, _ in places if masks):
        found[masks] = pair_masks([n for m, n in places if m == masks], masks)
    return tuple(found[m].get(name) if m else None for m, name in places)


def find_hiding(photos: Sequence[Path]) -> tuple[Path | None, ...]:
    """instant-ngp's mask of each photo, None for photos without."""
    paths = [photo.with_name(f"{HIDING}{photo.stem}.png") for photo in photos]
    return tuple(path if is_file(path) else None for path in paths)


def _name_alike(data_dir: Path) -> None:
    """Says of folders called nearly so that they are not read."""
    for path in sorted(data_dir.iterdir()):
        if ALIKE.fullmatch(path.name.casefold()) and path.is_dir():
            say_once(
                f"WARNING: {path}: not read; masks are read from a folder called "
                f"{FOLDER}: rename it if these are masks"
            )


def pair_masks(names: Sequence[str], folder: Path) -> dict[str, Path]:
    """The masks of a folder by the name of their photo; says which have none.

    Raises:
        UserError: none belongs to a photo.
    """
    listing = find_pictures(folder)
    if not (listing.pictures or listing.raw or listing.left_out):
        if any(list_files(folder)):
            say_once(f"{folder}: no picture in it, so nothing is masked")
        return {}
    listed = list_pictures(folder)
    found = match_masks(names, listed)
    if not found:
        raise UserError(
            f"{folder}: none of its {len(listed)} masks, e.g. {listed[0]!r}, is called "
            f"like a photo, e.g. {names[0]!r}: name it {names[0]}.png, or rename the "
            "folder if these are no masks"
        )
    lonely = sorted(set(listed) - set(found.values()))
    if lonely:
        more = f" and {len(lonely) - SHOWN} more" if len(lonely) > SHOWN else ""
        say_once(
            f"{folder}: {len(lonely)} of {len(listed)} masks belong to no photo: "
            f"{', '.join(lonely[:SHOWN])}{more}"
        )
    return {name: folder / mask for name, mask in found.items()}


def match_masks(names: Sequence[str], masks: Sequence[str]) -> dict[str, str]:
    """The mask of each photo: its name and an ending more, else its name up to the
    ending (``pairing.match_by_name``)."""
    longer = {mask: _folded(PurePosixPath(mask).with_suffix("")) for mask in masks}
    counts = Counter(longer.values())
    unique = {key: mask for mask, key in longer.items() if counts[key] == 1}
    found = {n: unique[key] for n in names if (key := _folded(n)) in unique}
    taken = set(found.values())
    rest = [name for name in names if name not in found]
    return found | match_by_name(rest, [mask for mask in masks if mask not in taken])


def _place(data_dir: Path, photo: Path) -> tuple[Path | None, str]:
    """The folder of the mask of a photo of that path in the scene, and the photo's name
    from there; of several the nearest, None if there is none."""
    parts = photo.parts
    for depth in range(len(parts) - 1, 0, -1):
        base = data_dir.joinpath(*parts[: depth - 1])
        size = re.findall(r"_\d+$", parts[depth - 1])
        for masks in (base / f"{FOLDER}{end}" for end in (*size, "")):
            if masks.is_dir():
                return masks, "/".join(parts[depth:])
    masks = data_dir / FOLDER
    return (masks if masks.is_dir() else None), "/".join(parts)


def _folded(name: str | PurePosixPath) -> str:
    return composed(str(name)).casefold()
