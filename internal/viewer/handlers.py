# SPDX-License-Identifier: Apache-2.0
"""What a browser's message sets off, and what becomes of its errors."""

import functools
from collections.abc import Callable, Coroutine
from typing import Any

from internal.errors import one_line

Handler = Callable[[Any], Coroutine[Any, Any, None]]
Guard = Callable[[Handler], Handler]


def guard(say: Callable[[str], None]) -> Guard:
    """Wraps handlers: their errors are told to their own user and end nothing."""

    def guarded(handler: Handler) -> Handler:
        @functools.wraps(handler)
        async def run(event: Any) -> None:
            try:
                await handler(event)
            except Exception as error:  # whatever a browser sends
                say(one_line(error))

        return run

    return guarded


def on_change(handler: Handler, *controls: Any) -> None:
    """Calls a handler whenever one of viser's controls has a new value."""
    for control in controls:
        control.on_update(handler)
