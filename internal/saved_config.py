# SPDX-License-Identifier: Apache-2.0
"""``config.json``: a configuration as a file that gives the same one back.

Each of its dataclasses is an object with the name that gin knows it by under "@":
``{"@": "HashGrid", "levels": 8, ...}``.
"""

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from beartype.roar import BeartypeCallHintViolation

from internal import configs
from internal.binding import NAMES
from internal.configs import Config
from internal.errors import UserError, one_line

KIND = "@"


def to_json(config: Config) -> str:
    """The whole configuration, for the run folder."""
    return json.dumps(_encode(config), indent=2) + "\n"


def read(path: Path) -> Config:
    """The configuration that ``to_json`` wrote.

    Raises:
        UserError: the file is missing or torn, or another version of the program,
            with other settings, wrote it.
    """
    configs.register()
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is cut short"
        raise UserError(
            f"{path}: cannot be read ({reason}); restore the file, or train into "
            "another folder"
        ) from error
    try:
        config = _decode(tree)
        if not isinstance(config, Config):
            raise TypeError("it holds no Config")
    except (BeartypeCallHintViolation, KeyError, TypeError) as error:
        raise UserError(
            f"{path}: written by another version of this program ({one_line(error)}); "
            "use that version, or train into another folder"
        ) from error
    return config


def as_bindings(config: Config) -> list[str]:
    """Gin bindings of every value, which give the same configuration back."""
    return list(_bindings(config))


def differences(old: Config, new: Config) -> dict[str, str]:
    """What differs, by its name in gin (``Losses.gray``): "was 0.1, is 0.5"."""
    before, after = _values(old), _values(new)
    return {
        name: f"was {before.get(name, 'not there')}, is {after.get(name, 'not there')}"
        for name in [*before, *(name for name in after if name not in before)]
        if before.get(name) != after.get(name)
    }


def _encode(value: Any) -> Any:
    if not dataclasses.is_dataclass(value):
        return value
    fields = {f.name: _encode(getattr(value, f.name)) for f in _fields(value)}
    return {KIND: NAMES[type(value)], **fields}


def _decode(tree: Any) -> Any:
    if isinstance(tree, list):
        return tuple(map(_decode, tree))
    if not isinstance(tree, dict):
        return tree
    if KIND not in tree:
        raise KeyError(f"no {KIND} among {', '.join(sorted(tree)[:3])}")
    kinds = {name: kind for kind, name in NAMES.items()}
    name = tree.pop(KIND)
    if name not in kinds:
        raise KeyError(f"no {name} here")
    names = {f.name for f in _fields(kinds[name])}
    if names != tree.keys():
        raise KeyError(f"{name}.{min(names ^ tree.keys())} is new or gone")
    return kinds[name](**{key: _decode(value) for key, value in tree.items()})


def _bindings(section: Any) -> Iterator[str]:
    owner = NAMES[type(section)]
    for field in _fields(section):
        value = getattr(section, field.name)
        if dataclasses.is_dataclass(value):
            yield f"{owner}.{field.name} = @{NAMES[type(value)]}()"
            yield from _bindings(value)
        else:
            yield f"{owner}.{field.name} = {value!r}"


def _values(config: Config) -> dict[str, str]:
    """Every value as gin writes it, by its name in gin."""
    pairs = (binding.partition(" = ") for binding in _bindings(config))
    return {name: value for name, _, value in pairs}


def _fields(kind: Any) -> tuple[dataclasses.Field, ...]:
    return dataclasses.fields(kind)
