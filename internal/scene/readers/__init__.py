# SPDX-License-Identifier: Apache-2.0
"""Scene formats: detection by what a folder contains, or by a forced name.

Where several formats match, the first of ``READERS`` wins: the more specific a
file is to NeRF, the earlier it comes.
"""

from pathlib import Path

from internal import flags
from internal.errors import UserError
from internal.files.listing import say_once
from internal.scene.readers import colmap, foreign, llff, transforms
from internal.scene.readers.base import Reader, SceneFiles

READERS: tuple[Reader, ...] = (
    transforms.BLENDER,
    transforms.NERFSTUDIO,
    llff.LLFF,
    colmap.COLMAP,
)
SHOWN_ENTRIES = 8


def read_files(
    data_dir: Path, dataset_loader: str, images_dir: str, pair_by: str = "name"
) -> SceneFiles:
    """Reads a scene's folder as ``dataset_loader`` says ("auto" detects).

    ``pair_by``: how pictures of ``images_dir`` may find their poses, as in
    ``pairing.pair_poses``.

    Raises:
        UserError: the folder is missing, is no scene of that format, or is broken.
    """
    flags.check_folder(data_dir)
    names = [reader.name for reader in READERS]
    if dataset_loader not in ("auto", *names):
        raise UserError(
            f"unknown dataset_loader {dataset_loader!r}; choose auto, "
            f"{', '.join(names)}"
        )
    asked = [r for r in READERS if dataset_loader in ("auto", r.name)]
    fitting = [reader for reader in asked if reader.matches(data_dir)]
    if len(fitting) > 1:
        others = ", ".join(reader.name for reader in fitting[1:])
        say_once(
            f"{data_dir}: read as {fitting[0].name}; it has the files of {others} too: "
            "Config.dataset_loader chooses"
        )
    if fitting:
        return fitting[0].read(data_dir, images_dir, pair_by)
    looked_for = "; ".join(f"{r.name}: {r.looked_for}" for r in asked)
    raise UserError(
        f"{data_dir}: no scene found. Looked for {looked_for}. "
        f"The folder contains {_contents(data_dir)}"
        + "".join(f"; {hint}" for hint in [_hint(data_dir, asked)] if hint)
    )


def _hint(folder: Path, asked: list[Reader]) -> str:
    """Where scenes are, if a folder of one or of several was named; else what other
    poses are there."""
    above = list(folder.resolve().parents)[:2]
    below, further = (
        sorted(path for path in folder.glob(pattern) if path.is_dir())
        for pattern in ("*", "*/*")
    )
    for places in (above, below, further):
        found = [p for p in places if any(reader.matches(p) for reader in asked)]
        if found:
            are = "the scene is" if len(found) == 1 else "scenes are"
            return f"{are} {', '.join(map(str, found[:SHOWN_ENTRIES]))}"
    return foreign.describe(folder) if len(asked) > 1 else ""


def _contents(folder: Path) -> str:
    names = sorted(p.name + "/" * p.is_dir() for p in folder.iterdir())
    more = len(names) - SHOWN_ENTRIES
    shown = ", ".join(names[:SHOWN_ENTRIES]) or "nothing"
    return f"{shown} and {more} more" if more > 0 else shown
