# SPDX-License-Identifier: Apache-2.0
"""What makes a frozen dataclass bindable: gin fills it, beartype checks its types.

Only this module and ``configs.py`` know gin.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import gin
from beartype import BeartypeConf, beartype

T = TypeVar("T")

NAMES: dict[type, str] = {}  # of all bindable dataclasses, as gin calls them
_named_by_gin: Any = gin.configurable
typed: Any = beartype(conf=BeartypeConf(is_pep484_tower=True))


def configurable(name: str) -> Callable[[T], T]:
    """Lets gin fill a dataclass under that name."""

    def register(dataclass: T) -> T:
        registered: Any = _named_by_gin(name)(dataclass)
        NAMES[registered] = name
        return registered

    return register
