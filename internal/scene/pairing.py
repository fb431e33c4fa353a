# SPDX-License-Identifier: Apache-2.0
"""Folders of pictures, and which picture of one belongs to which of another.

Names are those of ``files.listing``. A dark folder and the folder of its
normal-light twins lie side by side: ``low`` (or ``images``, ...) and one of
``TRUTH_FOLDERS``.
"""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from internal.errors import UserError
from internal.files.listing import composed, list_pictures, say_once
from internal.scene.surface_normals import why_no_truth

DARK_FOLDER = "low"
SHOWN = 10  # names in a message
PAIR_BY = ("name", "number", "order")  # from strict to loose
TRUTH_FOLDERS = ("high", "normal", "gt", "images_normal")


def find_input_folder(data_dir: Path, images_dir: str) -> Path:
    """The folder of input pictures of a scene whose pose file names no folder.

    ``images_dir`` if given; else ``images``, ``low``, or the ``images_N`` of the
    highest resolution.

    Raises:
        UserError: there is none.
    """
    scaled = sorted(
        (int(match[1]), path)
        for path in data_dir.iterdir()
        if (match := re.fullmatch(r"images_(\d+)", path.name))
    )
    standard = [data_dir / "images", data_dir / DARK_FOLDER, *(p for _, p in scaled)]
    for folder in [data_dir / images_dir] if images_dir else standard:
        if folder.is_dir():
            return folder
    looked_for = images_dir or f"images, {DARK_FOLDER} or images_N"
    there = sorted(path.name for path in data_dir.iterdir() if path.is_dir())
    raise UserError(
        f"{data_dir}: no folder of pictures; looked for {looked_for}, there are "
        f"{some(there) or 'no folders'}: put the photos there or name their folder "
        "with Config.images_dir"
    )


def find_truth_folder(data_dir: Path, dark: Path) -> Path | None:
    """The folder of normal-light twins beside the dark one or in the scene.

    Says so if one of that name is none: without a picture, or of surface normals.
    """
    for parent in dict.fromkeys((dark.parent, data_dir)):
        for folder in (parent / name for name in TRUTH_FOLDERS):
            if folder.is_dir():
                fault = why_no_truth(folder)
                if not fault:
                    return folder
                say_once(f"{folder}: not taken as truth: {fault}")
    return None


def dark_twin(path: Path) -> Path:
    """The path in ``low`` of a picture listed in a truth folder beside it.

    LOM lists its test views by their normal-light pictures; the method's input is
    the dark one. Other paths are returned as they are.
    """
    dark = path.parent.parent / DARK_FOLDER
    has_twin = path.parent.name in TRUTH_FOLDERS and dark.is_dir()
    return dark / path.name if has_twin else path


def pair_poses(
    names: Sequence[str], folder: Path, pair_by: str, pose_file: Path
) -> dict[str, Path]:
    """The picture in a folder that the user chose for each posed view; prints how.

    By name as ``match_by_name`` does; where that is not enough, views and pictures
    may pair by the one number in their names or by order, as far as ``pair_by`` (of
    ``PAIR_BY``) allows.

    Raises:
        UserError: a view has no picture, or ``pair_by`` is unknown.
    """
    if pair_by not in PAIR_BY:
        raise UserError(
            f"Config.pair_by = {pair_by!r}: expected one of {', '.join(PAIR_BY)}"
        )
    listed = list_pictures(folder)
    matched = match_by_name(names, listed)
    if len(matched) == len(names):
        return {name: folder / matched[name] for name in names}
    if pair_by == "name":
        lonely = next(name for name in names if name not in matched)
        raise UserError(
            f"{folder}: {lonely!r} of {pose_file} is not among its {len(listed)} "
            f"pictures, e.g. {listed[0]!r}; give them the names of the photos, or "
            "allow other pairs with Config.pair_by = 'number' or 'order'"
        )
    paths, rule = pair_by_name(names, folder, by_order=pair_by == "order")
    say_once(
        f"{folder}: paired with the poses of {pose_file} by {rule}, as Config.pair_by "
        f"allows: {names[0]} -> {paths[0].name}, {names[-1]} -> {paths[-1].name}"
    )
    return dict(zip(names, paths, strict=True))


def pair_by_name(
    names: Sequence[str],
    folder: Path,
    population: Sequence[str] = (),
    *,
    by_order: bool = True,
) -> tuple[tuple[Path, ...], str]:
    """Finds the partner of each name in a folder, and says by which rule.

    One rule pairs all names: the first of equal names, equal stems, stems equal
    up to case, the same single number in the file name ("enh_1.png" and "1.JPG"),
    or the same place in natural order. The last only if ``by_order`` and where both
    sides count alike; ``population`` names the pictures on the side of ``names`` that
    have no pose, which also take a place.

    Raises:
        UserError: no rule gives every name one partner of its own.
    """
    candidates = list_pictures(folder)
    for rule, key in _KEYS:
        partners = _pair_by_key(names, candidates, key)
        if partners:
            return tuple(folder / partner for partner in partners), rule
    everyone = sorted({*names, *population}, key=_natural)
    if by_order and len(everyone) == len(candidates):
        place = dict(zip(everyone, sorted(candidates, key=_natural), strict=True))
        return tuple(folder / place[name] for name in names), "sorted order"
    stems = {_folded(candidate) for candidate in candidates}
    lonely = [name for name in names if _folded(name) not in stems] or list(names)
    alike = "file names, or the same number of pictures" if by_order else "file names"
    raise UserError(
        f"{folder}: cannot pair its {len(candidates)} pictures with {len(everyone)} "
        f"views by name, e.g. {lonely[0]!r} has no partner and {candidates[0]!r} is "
        f"there; give both the same {alike}"
    )


def pair_truth(
    names: Sequence[str], folder: Path, population: Sequence[str] = ()
) -> tuple[dict[str, Path], str]:
    """The truth of each view that has one, and by which rule they are paired.

    As ``pair_by_name`` where that pairs all; else the views whose names are there, as
    ``match_by_name`` says, or whose one number is in the name of one picture.

    Raises:
        UserError: no rule pairs any.
    """
    try:
        paths, rule = pair_by_name(names, folder, population)
        return dict(zip(names, paths, strict=True)), rule
    except UserError:
        candidates = list_pictures(folder)
        found, rule = match_by_name(names, candidates), "names"
        if not found:
            found, rule = _pair_some(names, candidates, _number), "numbers in the names"
        if not found:
            raise
        return {name: folder / found[name] for name in found}, rule


def match_by_name(names: Sequence[str], candidates: Sequence[str]) -> dict[str, str]:
    """The candidate that each name means; names that mean none are left out.

    Equal names first; then names equal up to slash direction, "./", URL escapes and
    Unicode's form, then also up to extension and case, each with its folders or,
    last, without them, as far as both sides have one name of that kind.
    """
    found: dict[str, str] = {}
    for key in _LOOSER:
        taken = set(found.values())
        waiting = [name for name in names if name not in found]
        free = [name for name in candidates if name not in taken]
        found |= _pair_some(waiting, free, key)
    return {name: found[name] for name in names if name in found}


def _pair_some(
    names: Sequence[str], candidates: Sequence[str], key: Callable[[str], str]
) -> dict[str, str]:
    """Partners of one name each, as far as keys are equal and not empty."""
    waiting, free = _by_key(names, key), _by_key(candidates, key)
    return {
        waiting[shared][0]: free[shared][0]
        for shared in waiting
        if shared and len(waiting[shared]) == len(free.get(shared, ())) == 1
    }


def counts_up(names: Sequence[str]) -> bool:
    """Whether names in the order of text are in that of their numbers too."""
    return sorted(names) == sorted(names, key=_natural)


def some(names: Sequence[str]) -> str:
    """The names, as many as fit into a message."""
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more


def _by_key(names: Sequence[str], key: Callable[[str], str]) -> dict[str, list[str]]:
    by_key: dict[str, list[str]] = {}
    for name in dict.fromkeys(names):
        by_key.setdefault(key(name), []).append(name)
    return by_key


def _plain(name: str) -> str:
    """A name as the file system would show it: slashes, no "./", no URL escapes."""
    return PurePosixPath(composed(unquote(name).replace("\\", "/"))).as_posix()


def _pair_by_key(
    names: Sequence[str], candidates: Sequence[str], key: Callable[[str], str]
) -> list[str]:
    """Partners with equal keys, or none if a key is missing, empty or shared."""
    keys = [key(composed(name)) for name in names]
    counts = Counter(key(composed(candidate)) for candidate in candidates)
    if len(set(keys)) < len(keys) or any(not k or counts[k] != 1 for k in keys):
        return []
    by_key = {key(composed(candidate)): candidate for candidate in candidates}
    return [by_key[k] for k in keys]


def _stem(name: str) -> str:
    path = PurePosixPath(name)
    return (path.with_suffix("") if path.name else path).as_posix()


def _folded(name: str) -> str:
    return _stem(name).casefold()


def _number(name: str) -> str:
    """The one number in a file name, without leading zeros; "" if not just one."""
    numbers = re.findall(r"\d+", PurePosixPath(name).stem)
    return str(int(numbers[0])) if len(numbers) == 1 else ""


def _natural(name: str) -> list[tuple[int, int, str]]:
    """Sort key under which "2.png" comes before "10.png"."""
    parts = re.findall(r"\d+|\D+", name)
    return [(0, int(p), "") if p.isdecimal() else (1, 0, p.casefold()) for p in parts]


_LOOSER: tuple[Callable[[str], str], ...] = (
    str,
    _plain,
    lambda name: _stem(_plain(name)),
    lambda name: _folded(_plain(name)),
    lambda name: PurePosixPath(_plain(name)).name,
    lambda name: PurePosixPath(_stem(_plain(name))).name,
    lambda name: PurePosixPath(_folded(_plain(name))).name,
)
_KEYS: tuple[tuple[str, Callable[[str], str]], ...] = (
    ("equal names", str),
    ("equal names up to the extension", _stem),
    ("equal names up to case and extension", _folded),
    ("equal numbers in the names", _number),
)
