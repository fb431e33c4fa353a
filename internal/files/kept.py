# SPDX-License-Identifier: Apache-2.0
"""Arrays that take a minute or more to find, kept in a file for the next time, under a
key of all that they depend on: with another key they are found anew."""

import contextlib
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from internal.errors import UserError, one_line
from internal.files import atomic

KEY = "key"


def find(
    name: str, key: str, folders: Sequence[Path]
) -> tuple[Path, dict[str, np.ndarray]] | None:
    """The first file of that name that holds what is kept under this key, and what it
    holds. Says so of files that are broken."""
    for path in (folder / name for folder in folders):
        try:
            # Opened here: of a torn archive NumPy leaves the file open.
            with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
                arrays = dict(stored)
            if str(arrays.pop(KEY)) == key:
                return path, arrays
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            if path.exists():
                print(f"{path}: not used ({one_line(error)})")
    return None


def keep(
    name: str, key: str, folders: Sequence[Path], arrays: Mapping[str, np.ndarray]
) -> None:
    """Writes arrays into the first folder that can be written, and says where."""
    stored: dict[str, Any] = {KEY: np.array(key), **arrays}
    for folder in folders:
        with contextlib.suppress(UserError, OSError):
            atomic.ensure_folder(folder)
            with atomic.writing(folder / name) as partial:
                np.savez(partial, **stored)
            print(f"  kept in {folder / name}", flush=True)
            return
