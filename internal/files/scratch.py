# SPDX-License-Identifier: Apache-2.0
"""The temporary folder: where what is not kept lies while a script runs."""

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path

from internal.errors import UserError, one_line


@contextlib.contextmanager
def scratch_folder() -> Iterator[Path]:
    """A folder that is gone afterwards.

    Raises:
        UserError: it cannot be made, or what belongs there not be written: names the
            temporary folder.
    """
    name = ""
    try:
        with tempfile.TemporaryDirectory() as name:
            yield Path(name)
    except (OSError, UserError) as error:
        is_nameless = isinstance(error, OSError) and error.filename is None
        if name and name not in str(error) and not is_nameless:
            raise
        raise refusal(error) from error


def refusal(error: Exception) -> UserError:
    """What to say where the temporary folder does not take a file."""
    folder = "/tmp"
    with contextlib.suppress(OSError):  # none of those that Python tries can be written
        folder = tempfile.gettempdir()
    return UserError(
        f"{folder}: the temporary folder does not take what is needed meanwhile; free "
        f"space, or set TMPDIR to a folder on another disk ({one_line(error)})"
    )
