# SPDX-License-Identifier: Apache-2.0
"""Pictures of a scene: in memory, or in a nameless file when they are too many.

The file is gone when the process ends. Pixels are read from it one by one, so memory
does not grow with the number of photos.
"""

import os
import tempfile
import weakref
from collections.abc import Iterable, Sequence
from typing import overload

import numpy as np
from jaxtyping import Int, UInt16

from internal.files import scratch

StoredPicture = UInt16[np.ndarray, "_h _w 3"]


def hold(
    pictures: Iterable[StoredPicture], max_gigabytes: float
) -> Sequence[StoredPicture]:
    """The pictures as a tuple or, from the first that does not fit, in a file.

    Raises:
        UserError: the disk is full.
    """
    held: list[StoredPicture] = []
    total = 0
    rest = iter(pictures)
    for picture in rest:
        held.append(picture)
        total += picture.nbytes
        if total > 1e9 * max_gigabytes:
            return PictureStore(held, rest)
    return tuple(held)


def gigabytes(pictures: Sequence[StoredPicture]) -> float:
    """Size of all pictures together."""
    if isinstance(pictures, PictureStore):
        return pictures.nbytes / 1e9
    return sum(picture.nbytes for picture in pictures) / 1e9


class PictureStore(Sequence[StoredPicture]):
    """A sequence of pictures that lie on disk."""

    def __init__(self, *parts: Iterable[StoredPicture]) -> None:
        self._shapes: list[tuple[int, ...]] = []
        starts = [0]
        try:
            self._file = tempfile.TemporaryFile()  # noqa: SIM115, lives with the store
            weakref.finalize(self, self._file.close)
            for part in parts:
                for picture in part:
                    self._file.write(np.ascontiguousarray(picture).data)
                    self._shapes.append(picture.shape)
                    starts.append(starts[-1] + picture.size)
            self._file.flush()
        except OSError as error:
            raise scratch.refusal(error) from error
        self._starts = np.array(starts[:-1])
        self._widths = np.array([shape[1] for shape in self._shapes])
        self.nbytes = 2 * starts[-1]

    def __len__(self) -> int:
        return len(self._shapes)

    @overload
    def __getitem__(self, index: int) -> StoredPicture: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[StoredPicture]: ...
    def __getitem__(
        self, index: int | slice
    ) -> StoredPicture | Sequence[StoredPicture]:
        """A copy of one picture, or of several."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        shape = self._shapes[index]
        offset = 2 * int(self._starts[index])
        return np.array(np.memmap(self._file, np.uint16, "r", offset, shape))

    def pixels(
        self,
        view: Int[np.ndarray, "*b"],
        x: Int[np.ndarray, "*b"],
        y: Int[np.ndarray, "*b"],
    ) -> UInt16[np.ndarray, "*b 3"]:
        """Single pixels, by view, column and row."""
        first = self._starts[view] + 3 * (y * self._widths[view] + x)
        handle = self._file.fileno()
        pixels = [os.pread(handle, 6, 2 * start) for start in first.ravel().tolist()]
        return np.frombuffer(b"".join(pixels), np.uint16).reshape(*first.shape, 3)
