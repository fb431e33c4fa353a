# SPDX-License-Identifier: Apache-2.0
"""Variants of one configuration, as sweep.py's command line gives them."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from internal import configs
from internal.configs import Config
from internal.errors import UserError

Settings = tuple[list[str], list[str]]  # gin files, then bindings


def check_variants(variants: Sequence[tuple[str, Settings]]) -> None:
    """Refuses, before the first training, what would fail or be trained twice.

    Raises:
        UserError: a variant's settings are wrong, or two have one name or the same
            settings.
    """
    seen: dict[Config, str] = {}
    names: set[str] = set()
    for name, (files, bindings) in variants:
        if name in names:
            raise UserError(f"variant {name!r}: two are called so; rename one")
        names.add(name)
        try:
            config = configs.load_config(files, bindings)
        except UserError as error:
            raise UserError(f"variant {name!r}: {error}") from error
        config = dataclasses.replace(config, checkpoint_dir="")
        twin = seen.setdefault(config, name)
        if twin != name:
            raise UserError(
                f"variant {name!r}: its settings are those of {twin!r}, so both would "
                "train the same; take one of them out"
            )


def parse_variant(text: str) -> tuple[str, Settings]:
    """(name, (gin files, bindings)) of a variant in the command's words."""
    if text.endswith(".gin"):
        return Path(text).stem, ([text], [])
    name, colon, bindings = text.partition(":")
    if not colon or "/" in name or name.strip() in ("", ".", ".."):
        raise UserError(
            f"variant {text!r}: expected a .gin file or 'NAME: BINDING; BINDING'"
        )
    return name.strip(), ([], [binding.strip() for binding in bindings.split(";")])
