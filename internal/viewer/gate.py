# SPDX-License-Identifier: Apache-2.0
"""What browsers send is looked at before anything acts on it.

Whoever reaches the port can send anything. viser itself trusts its own page: it sets
any property of a control to any value, shows the server to the whole internet when a
message asks for that, and prints a traceback for what it cannot read. Here a message
that no page of ours sends is dropped, a page of another origin is sent away, and
whatever fails all the same is one line.
"""

import asyncio
import logging
import math
from collections import defaultdict
from collections.abc import Awaitable, Callable, Sequence
from typing import Any
from urllib.parse import urlsplit

import viser
from viser import _messages, infra

from internal.errors import one_line

ACCEPTED = (
    _messages.ViewerCameraMessage,
    _messages.ScenePointerMessage,
    _messages.SceneNodeClickMessage,
    _messages.SceneNodeDragMessage,
    _messages.GuiUpdateMessage,
)
MOST_PIXELS = 100_000  # of a window's side
FARTHEST = 1e9  # model units: squares of it are numbers still

Handle = Callable[[infra.ClientId, infra.Message], Awaitable[None]]


class Gate:
    """Guards a running server of viser's, from its next page on."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._clients = server.get_clients
        self._connections = server._websock_server
        guarded: Any = self._guarded(self._connections._handle_incoming_message)
        self._connections._handle_incoming_message = guarded
        self._connections._client_connect_cb.insert(0, self._open)
        self._connections._client_disconnect_cb.insert(0, self._end)
        self._running: defaultdict[int, set[Any]] = defaultdict(set)
        logging.getLogger("websockets.server").addFilter(_in_one_line)

    async def _open(self, connection: infra.WebsockClientConnection) -> None:
        """Raises for a page that was not served here: its connection then ends."""
        number = connection.client_id
        request = self._connections._live_connections[number].request
        if request and is_foreign(request.headers):
            self._connections._client_state_from_id.pop(number, None)
            self._connections._live_connections.pop(number, None)
            origin = request.headers["Origin"][:100]
            raise PermissionError(f"it is no page of this viewer but of {origin!r}")
        guarded: Any = self._guarded(connection._handle_incoming_message)
        connection._handle_incoming_message = guarded

    async def _end(self, connection: infra.WebsockClientConnection) -> None:
        """Ends what a page that has gone still wanted done: nobody waits for it, and
        viser forgets it half done when it stops."""
        tasks = self._running.pop(connection.client_id, set())
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _guarded(self, handle: Handle) -> Handle:
        async def run(client_id: infra.ClientId, message: infra.Message) -> None:
            running, task = self._running[client_id], asyncio.current_task()
            running.add(task)
            try:
                if self._is_sound(client_id, message):
                    await handle(client_id, message)
            except Exception as error:  # whatever a browser sends
                print(
                    f"a page's message was not understood: {one_line(error)}",
                    flush=True,
                )
            finally:
                running.discard(task)

        return run

    def _is_sound(self, client_id: infra.ClientId, message: infra.Message) -> bool:
        """Whether a page of ours sends that."""
        if not isinstance(message, ACCEPTED) or not is_finite(vars(message)):
            return False
        if isinstance(message, _messages.ViewerCameraMessage):
            return is_camera(message)
        if isinstance(message, _messages.GuiUpdateMessage):
            client = self._clients().get(client_id)
            controls = client.gui._gui_input_handle_from_uuid if client else {}
            control = controls.get(message.uuid)
            return message.updates.keys() == {"value"} and fits(
                control, message.updates["value"]
            )
        return True


def is_foreign(headers: Any) -> bool:
    """Whether a request comes from a page that another server sent. A program that is
    no browser states no origin."""
    origin = headers.get("Origin")
    return origin is not None and urlsplit(origin).netloc != headers.get("Host")


def is_finite(value: Any) -> bool:
    """Whether all numbers in a message, however deep, are numbers."""
    if isinstance(value, dict):
        return all(map(is_finite, value.values()))
    if isinstance(value, (list, tuple)):
        return all(map(is_finite, value))
    return not isinstance(value, (int, float)) or math.isfinite(value)


def is_camera(message: _messages.ViewerCameraMessage) -> bool:
    """Whether somebody can look through it."""
    places = [*message.position, *message.look_at, *message.up_direction]
    sides = message.image_width, message.image_height
    return (
        [len(x) for x in (message.position, message.look_at, message.up_direction)]
        == [3, 3, 3]
        and max(map(abs, places)) < FARTHEST
        and len(message.wxyz) == 4
        and 0.5 < math.hypot(*message.wxyz) < 2.0
        and 0.0 < message.fov < math.pi
        and all(0 < side <= MOST_PIXELS for side in sides)
    )


def fits(control: Any, value: Any) -> bool:
    """Whether a value is one that a control of ours can be set to."""
    if isinstance(control, viser.GuiButtonHandle):
        return True
    if control is None or not _is_kind_of(value, control.value):
        return False
    if isinstance(control, viser.GuiDropdownHandle):
        return value in control.options
    low, high = getattr(control, "min", None), getattr(control, "max", None)
    return (low is None or low <= value) and (high is None or value <= high)


def _is_kind_of(value: Any, own: Any) -> bool:
    """Whether a browser means a value like ``own``; it has one kind of number."""
    if isinstance(own, bool) or isinstance(value, bool):
        return isinstance(own, bool) and isinstance(value, bool)
    if isinstance(own, (int, float)):
        return isinstance(value, (int, float))
    if isinstance(own, Sequence) and not isinstance(own, str):
        return isinstance(value, (list, tuple)) and len(value) == len(own)
    return isinstance(value, type(own))


def _in_one_line(record: logging.LogRecord) -> bool:
    """Says in a line why a connection failed, in place of a traceback."""
    if not record.exc_info or not isinstance(record.exc_info[1], Exception):
        return True
    print(f"a page was sent away: {one_line(record.exc_info[1])}", flush=True)
    return False
