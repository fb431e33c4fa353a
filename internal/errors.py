# SPDX-License-Identifier: Apache-2.0
"""Errors that a user is told in one line."""


class UserError(Exception):
    """Bad input or a full disk: one line that names the file, what was expected
    and what to do. Scripts print it without a traceback and exit with code 2."""


class Diverged(Exception):
    """Training met a NaN or an infinity: one line that names the loss and step."""


def one_line(error: Exception) -> str:
    """The start of any error's message, or its kind."""
    return " ".join(str(error).split())[:300] or type(error).__name__


def has_utf8(name: str) -> bool:
    """Whether a name of the file system is a text that can be written as UTF-8."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True
