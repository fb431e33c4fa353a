# SPDX-License-Identifier: Apache-2.0
"""Packages that come with an extra of ours: whether they are there, and what to say
where they are not."""

import importlib.util

from internal.errors import UserError


def has(*packages: str) -> bool:
    """Whether all of these can be imported."""
    return all(importlib.util.find_spec(package) is not None for package in packages)


def install(extra: str) -> str:
    """The command that brings an extra."""
    return f"pip install -e '.[{extra}]'"


def need(extra: str, *packages: str, to: str, otherwise: str = "") -> None:
    """Refuses to go on without the packages of an extra.

    Args:
        to: what cannot be done without them.
        otherwise: what can be done instead.

    Raises:
        UserError: names the first package that is missing and how to install it.
    """
    missing = [package for package in packages if not has(package)]
    if missing:
        instead = f", or {otherwise}" if otherwise else ""
        raise UserError(f"{to} needs {missing[0]}: run {install(extra)}{instead}")
