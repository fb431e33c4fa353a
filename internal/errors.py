# SPDX-License-Identifier: Apache-2.0
"""The one exception that means "the user can fix this"."""


class UserError(Exception):
    """Bad input or a full disk: one line that names the file, what was expected
    and what to do. Scripts print it without a traceback and exit with code 2."""


class Diverged(Exception):
    """Training met a NaN or an infinity: one line that names the loss and step."""
