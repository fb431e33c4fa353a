# SPDX-License-Identifier: Apache-2.0
"""The list of methods that compare.py compares: TOML files, an entry per method.

``configs/methods/photos.toml`` explains the entries to users.
"""

import dataclasses
import tomllib
from collections.abc import Sequence
from pathlib import Path

from internal.comparison import enhancers
from internal.errors import UserError
from internal.files.listing import is_metadata
from internal.scoring.evaluation import BASELINES

OUTPUTS = (*BASELINES, "enhanced")
FOLDER = "{folder}"


@dataclasses.dataclass(frozen=True)
class Method:
    """One row of the comparison."""

    name: str
    photos: str = ""  # "": the dark ones; an enhancer; a folder in the scene
    train: tuple[str, ...] = ()  # gin files; (): the photos are the result
    output: str = "unchanged"  # what is scored, of ``OUTPUTS``


def read_methods(files: Sequence[Path]) -> tuple[Method, ...]:
    """The methods of all lists, in their order.

    Raises:
        UserError: a list is missing or broken, or a name comes twice.
    """
    methods = [method for file in files for method in _read_list(file)]
    names = [method.name for method in methods]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice:
        raise UserError(f'methods: ["{twice}"] comes twice; rename one')
    return tuple(methods)


def methods_for(methods: Sequence[Method], data_dir: Path) -> tuple[Method, ...]:
    """The methods as they apply to one scene: a * becomes a method per folder found.

    Raises:
        UserError: a folder without * is not there, or OpenCV is missing.
    """
    found = []
    for method in methods:
        if "*" in method.photos:
            found_here = data_dir.glob(method.photos)
            folders = sorted(p for p in found_here if p.is_dir() and not is_metadata(p))
            found += [
                dataclasses.replace(
                    method,
                    name=method.name.replace(FOLDER, folder.name),
                    photos=folder.relative_to(data_dir).as_posix(),
                )
                for folder in folders
            ]
            continue
        if method.photos in enhancers.ENHANCERS:
            enhancers.check_available(method.photos)
        elif not (data_dir / method.photos).is_dir():
            raise UserError(
                f"{data_dir / method.photos}: no such folder of enhanced photos; put "
                f'them there or take ["{method.name}"] out of the list'
            )
        found.append(method)
    return tuple(found)


def _read_list(file: Path) -> list[Method]:
    try:
        entries = tomllib.loads(file.read_text())
    except (OSError, ValueError) as error:
        raise UserError(
            f"{file}: not a list of methods ({error}); see configs/methods/photos.toml"
        ) from error
    return [_method(file, name, entry) for name, entry in entries.items()]


def _method(file: Path, name: str, entry: object) -> Method:
    where = f'{file}: ["{name}"]'
    if not isinstance(entry, dict):
        raise UserError(f"{where}: expected a table with photos, train, output")
    unknown = entry.keys() - {"photos", "train", "output"}
    if unknown:
        raise UserError(f"{where}: no {min(unknown)} there; photos, train, output")
    photos, output = entry.get("photos", ""), entry.get("output", "unchanged")
    train = entry.get("train", [])
    if not isinstance(photos, str) or output not in OUTPUTS:
        raise UserError(
            f"{where}: photos is a text, output one of {', '.join(OUTPUTS)}"
        )
    if not isinstance(train, list) or not all(isinstance(x, str) for x in train):
        raise UserError(f"{where}: train is a list of gin files")
    if output == "enhanced" and not train:
        raise UserError(f"{where}: output enhanced needs a model to train")
    if ("*" in photos) != (FOLDER in name):
        raise UserError(
            f"{where}: photos with a * and {FOLDER} in the name go together"
        )
    missing = [x for x in train if not Path(x).is_file()]
    if missing:
        raise UserError(f"{where}: {missing[0]}: no such gin file")
    return Method(name, photos, tuple(train), output)
