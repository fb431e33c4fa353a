# SPDX-License-Identifier: Apache-2.0
"""Room on the disk for what COLMAP writes.

Its threads end the whole process where a disk is full, and its models are cut short
without a word. So the room is taken, and given back, before it starts.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from internal.errors import UserError, one_line
from internal.files.atomic import take_room


@contextlib.contextmanager
def room(folder: Path, size: int) -> Iterator[None]:
    """Runs COLMAP where ``size`` bytes can be written into ``folder``.

    Raises:
        UserError: they cannot, or COLMAP stopped.
    """
    try:
        take_room(folder, size)
        yield
    except OSError as error:
        raise cannot_write(folder, error) from error
    except (RuntimeError, ValueError) as error:
        raise UserError(
            f"{folder}: COLMAP stopped ({one_line(error)}); run the same command "
            "again, with --overwrite if it stops again"
        ) from error


def cannot_write(folder: Path, error: OSError) -> UserError:
    """The error of a step that could not write; what was written before stays."""
    return UserError(
        f"{folder}: cannot write ({error.strerror}); free space and run the same "
        "command again: it goes on from here"
    )
