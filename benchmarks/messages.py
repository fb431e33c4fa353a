# SPDX-License-Identifier: Apache-2.0
"""Sends the viewer what no browser sends: does it go on serving, without a traceback?

python -m benchmarks.messages [--messages 100] [--seed 0]

Starts ``view.py`` on a tiny run, opens pages and sends each of them something wrong:
bytes that are no message, messages without or with strange fields, values of every
wrong kind and size for every control, a page of another origin. After each a whole
page must still get a picture. Prints how many of each kind were sent and exits with 1
if the server died, hung or printed a traceback. Last run: 100 messages, no fault.
"""

import argparse
import random
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import msgspec
import viser
import websockets
import zstandard
from viser import _messages
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from benchmarks import trials, workload

SECONDS = 60.0
ODD_VALUES: tuple[Any, ...] = (
    None, True, "", "text", "../../x", [], {}, [[]], 0, -1, 1e-320, 1e308, 2**63,
    float("nan"), float("inf"), -float("inf"), [1, 2], {"a": 1}, "\u0000", "x" * 10**6,
    [float("nan")] * 3, [0.0] * 4, b"bytes",
)  # fmt: skip
CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1.0, 0, 0, 0], "position": [0.0, 0, 0],
    "fov": 0.8, "near": 0.01, "far": 1000.0, "image_height": 15, "image_width": 20,
    "look_at": [0.0, 0, 1], "up_direction": [0.0, 1, 0],
}  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--messages", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    rng = random.Random(args.seed)
    sent: Counter[str] = Counter()
    faults = []
    with trials.trials() as folder, served(folder / "run") as (address, printed):
        for number in range(args.messages):
            name, send = rng.choice(list(KINDS.items()))
            sent[name] += 1
            said = send(address, rng)
            if not gets_a_picture(address):
                faults.append(f"{number}: no picture after {name}: {said}")
                break
            text = printed.read_text()
            if "Traceback" in text:
                faults.append(f"{number}: {name} {said}: {text[-2000:]}")
                printed.write_text("")
    print(workload.markdown(("kind", "messages"), sorted(sent.items())))
    print("\n".join(faults) or f"{sum(sent.values())} messages: no fault")
    return bool(faults)


@contextmanager
def served(run: Path) -> Iterator[tuple[str, Path]]:
    """The address of a viewer of a run, and the file of what it prints."""
    with tempfile.TemporaryDirectory() as name:
        printed = Path(name) / "printed"
        with printed.open("a") as file:
            process = subprocess.Popen(
                [sys.executable, "view.py", "--run", str(run), "--port", "0"],
                cwd=trials.ROOT, stdout=subprocess.PIPE, stderr=file, text=True,
            )  # fmt: skip
        try:
            assert process.stdout
            line = next(x for x in process.stdout if "is shown at" in x)
            yield line.split()[-1].replace("http", "ws"), printed
        finally:
            process.kill()
            process.wait()


def opened(address: str, **options: Any) -> Connection:
    """A page's connection."""
    protocol = websockets.Subprotocol(f"viser-v{viser.__version__}")
    return connect(address, subprotocols=[protocol], max_size=None, **options)


def gets_a_picture(address: str) -> bool:
    """Whether a new page is shown something."""
    with opened(address) as socket:
        socket.send(msgspec.msgpack.encode(CAMERA))
        return any(map(is_picture, received(socket)))


def is_picture(message: dict) -> bool:
    """Whether the server shows something; it starts with an empty background."""
    return bool(message["type"] == "BackgroundImageMessage" and message["rgb_data"])


def received(socket: Connection, seconds: float = SECONDS) -> Iterator[dict]:
    """What the server says, until it is silent for so long."""
    with suppress(TimeoutError, websockets.ConnectionClosed):
        while True:
            raw = socket.recv(seconds)
            assert isinstance(raw, bytes)
            size = int.from_bytes(raw[8:16], "little")
            inner = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + size])
            yield from msgspec.msgpack.decode(inner)["messages"]


def send_garbage(address: str, rng: random.Random) -> str:
    """Bytes or text that are no message, or half of one."""
    content = rng.choice(
        (rng.randbytes(rng.randrange(200)), msgspec.msgpack.encode(CAMERA)[:-9],
         "text", b"", msgspec.msgpack.encode([1, 2]), msgspec.msgpack.encode({}))
    )  # fmt: skip
    return send_all(address, [content])


def send_any_kind(address: str, rng: random.Random) -> str:
    """A message of any kind viser has, with odd fields, or without some."""
    kind = rng.choice(_messages.Message.get_subclasses())
    fields = list(getattr(kind, "__dataclass_fields__", {}))
    fields = rng.sample(fields, rng.randint(len(fields) // 2, len(fields)))
    message = {name: rng.choice(ODD_VALUES) for name in fields}
    return send_all(address, [encoded({**message, "type": kind.__name__})])


def send_camera(address: str, rng: random.Random) -> str:
    """A camera with an odd field, first or after a whole one."""
    odd = {rng.choice(list(CAMERA)[1:]): rng.choice(ODD_VALUES)}
    first = [encoded(CAMERA)] * rng.randrange(2)
    return send_all(address, [*first, encoded(CAMERA | odd)])


def send_to_control(address: str, rng: random.Random) -> str:
    """An odd value for one control, or for what is no value of it; or a press."""
    with opened(address) as socket:
        socket.send(encoded(CAMERA))
        control = rng.choice(controls(socket))
        name = rng.choice(("value", "value", "value", "order", "update_cb", "nothing"))
        update = {name: rng.choice((True, *ODD_VALUES))}
        message = {
            "type": "GuiUpdateMessage", "uuid": control["uuid"], "updates": update,
        }  # fmt: skip
        with suppress(websockets.ConnectionClosed):
            socket.send(encoded(message))
            list(received(socket, 0.3))
    return f"{control['type']} {str(update)[:80]}"


def controls(socket: Connection) -> list[dict]:
    """What a new page was given to set and press, up to its first picture."""
    found = []
    for message in received(socket):
        if is_picture(message):
            break
        if "uuid" in message and "props" in message:
            found.append(message)
    return found


def send_from_elsewhere(address: str, rng: random.Random) -> str:
    """What a page of another origin sends: it must be shown nothing."""
    with (
        suppress(websockets.InvalidHandshake, websockets.ConnectionClosed),
        opened(address, origin=websockets.Origin("http://elsewhere")) as socket,
    ):
        socket.send(encoded(CAMERA))
        shown = any(map(is_picture, received(socket, 1.0)))
        assert not shown, "a foreign page got a picture"
    return ""


def send_all(address: str, contents: list[bytes | str]) -> str:
    """Sends on a connection of its own, and reads a moment of the answer."""
    with suppress(websockets.ConnectionClosed), opened(address) as socket:
        for content in contents:
            socket.send(content)
        list(received(socket, 0.3))
    return str(contents[-1][:120])


def encoded(message: dict[str, Any]) -> bytes:
    return msgspec.msgpack.encode(message)


KINDS: dict[str, Callable[[str, random.Random], str]] = {
    "garbage": send_garbage,
    "any kind": send_any_kind,
    "camera": send_camera,
    "control": send_to_control,
    "other origin": send_from_elsewhere,
}


if __name__ == "__main__":
    sys.exit(main())
