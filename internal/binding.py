# SPDX-License-Identifier: Apache-2.0
"""What makes a frozen dataclass bindable: gin fills it, beartype checks its types.

Only this module knows gin. A binding is ``Section.name = value``; its name is what
stands before the equals sign.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import gin
from beartype import BeartypeConf, beartype
from beartype.roar import BeartypeCallHintViolation
from gin.config_parser import BindingStatement, ConfigParser, ParserDelegate

from internal.errors import UserError
from internal.flags import check_gin_file

T = TypeVar("T")

NAMES: dict[type, str] = {}  # of all bindable dataclasses, as gin calls them
_named_by_gin: Any = gin.configurable
typed: Any = beartype(conf=BeartypeConf(is_pep484_tower=True))

# What gin raises for unknown names, bad syntax, missing includes.
_GIN_ERRORS = (
    ValueError, TypeError, SyntaxError, OSError, RuntimeError, ImportError,
)  # fmt: skip


def configurable(name: str) -> Callable[[T], T]:
    """Lets gin fill a dataclass under that name."""

    def register(dataclass: T) -> T:
        registered: Any = _named_by_gin(name)(dataclass)
        NAMES[registered] = name
        return registered

    return register


def parsed(
    files: Sequence[str],
    bindings: Sequence[str],
    base: Sequence[str],
    then: Callable[[], T],
) -> T:
    """The result of ``then`` while gin knows ``base``, then files, then bindings.

    Raises:
        UserError: a file is missing, a name is unknown or a value has a wrong type.
    """
    gin.clear_config()
    for file in files:
        check_gin_file(file)
    try:
        gin.parse_config(list(base))
        gin.parse_config_files_and_bindings(list(files), list(bindings))
        return then()
    except (BeartypeCallHintViolation, *_GIN_ERRORS) as error:
        raise UserError(f"gin: {' '.join(str(error).split())[:400]}") from error
    finally:
        gin.clear_config()


def value_of(name: str) -> str:
    """Inside ``parsed``: what is bound to a name, as text; "" if nothing."""
    try:
        return str(gin.query_parameter(name))
    except ValueError:
        return ""


def read_names() -> frozenset[str]:
    """Inside ``parsed``, once dataclasses were made: the bindings that these read.
    What is read in a scope may be bound in it or around it."""
    names = set(stated_names(gin.operative_config_str()))
    for name in tuple(names):
        *scopes, own = name.split("/")
        names |= {"/".join([*scopes[:n], own]) for n in range(len(scopes))}
    return frozenset(names)


def stated_names(text: str) -> frozenset[str]:
    """The names that a text in gin's language binds itself, not in what it includes."""
    statements = ConfigParser(text, _NamesOnly())
    return frozenset(_name(x) for x in statements if isinstance(x, BindingStatement))


def _name(statement: BindingStatement) -> str:
    """``Section.name`` without modules, with its scope; of a macro its name."""
    section = statement.selector.rpartition(".")[2]
    parts = (section, statement.arg_name) if statement.arg_name else (section,)
    return "/".join([*filter(None, [statement.scope]), ".".join(parts)])


class _NamesOnly(ParserDelegate):
    """Leaves open what @ and % refer to."""

    def configurable_reference(self, scoped_configurable_name, evaluate):
        return None

    def macro(self, macro_name):
        return None
