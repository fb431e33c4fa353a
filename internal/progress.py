# SPDX-License-Identifier: Apache-2.0
"""Progress of long work: what is done, how fast, how long it still takes.

On a terminal a moving bar; in a log file a plain line every few seconds.
"""

import sys
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

from tqdm import tqdm

T = TypeVar("T")

SECONDS_BETWEEN_LOG_LINES = 10.0


class _LogLines(tqdm):
    """A tqdm that ends each refresh with a new line instead of moving."""

    @staticmethod
    def status_printer(file):
        def print_status(text: str) -> None:
            if text:
                file.write(text + "\n")

        return print_status


def bar(total: int, label: str, unit: str, initial: int = 0) -> tqdm:
    """A progress bar with rate and ETA; ``update(n)``, ``set_postfix_str``, ``close``.

    Args:
        total: count of ``unit`` that is the end.
        initial: how many an earlier run already did.
    """
    if sys.stderr.isatty():
        return tqdm(
            total=total, desc=label, unit=unit, initial=initial, dynamic_ncols=True
        )
    return _LogLines(
        total=total,
        desc=label,
        unit=unit,
        initial=initial,
        mininterval=SECONDS_BETWEEN_LOG_LINES,
        ncols=150,
        ascii=True,
    )


def show(shown: tqdm, text: str) -> None:
    """Shows the bar with new words behind it; in a log file not more often than its
    other lines come, and only if they are new."""
    passed = time.time() - shown.last_print_t
    if sys.stderr.isatty() or (
        passed > SECONDS_BETWEEN_LOG_LINES and text not in (shown.postfix or "")
    ):
        shown.set_postfix_str(text)
        shown.last_print_t = time.time()


def track(items: Iterable[T], total: int, label: str, unit: str) -> Iterator[T]:
    """Yields items and shows how many are done."""
    with bar(total, label, unit) as shown:
        for item in items:
            yield item
            shown.update()
