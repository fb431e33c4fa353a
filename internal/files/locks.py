# SPDX-License-Identifier: Apache-2.0
"""Locks of the system's on files and folders: they end with the process, however that
ends."""

import fcntl


def take_lock(handle: int) -> bool:
    """Whether no other process holds the lock of an open file or folder; until the
    handle is closed, this one does.

    Raises:
        OSError: the file system has no locks.
    """
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
