# SPDX-License-Identifier: Apache-2.0
"""The viewer's server: a page per browser, one thread that renders for all.

The optional extra ``view`` brings viser.
"""

import contextlib
import socket
import threading
from pathlib import Path

import numpy as np
import viser

from internal.configs import Config
from internal.errors import UserError, one_line
from internal.viewer.baking import Bakery
from internal.viewer.gate import Gate
from internal.viewer.panel import Panel
from internal.viewer.session import Session
from internal.viewer.studio import Studio

SECONDS_BETWEEN_LOOKS = 3.0  # for a newer checkpoint


class Server:
    """Serves until ``close``. Pages that come and go do not disturb each other."""

    def __init__(
        self,
        config: Config,
        studio: Studio,
        host: str,
        port: int,
        bakery: Bakery | None = None,
    ) -> None:
        """``bakery``: of splats to walk on, if people shall."""
        check_free(host, port)
        self._config, self._studio, self._bakery = config, studio, bakery
        self._pages: dict[int, tuple[Panel, Session]] = {}
        self._gone: set[int] = set()  # closed while they were opened
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._server = viser.ViserServer(host, port, label="LLNeRF", verbose=False)
        Gate(self._server)
        self.address = f"http://{host}:{self._server.get_port()}"
        self._set_the_stage()
        self._server.on_client_connect(self._open)
        self._server.on_client_disconnect(self._shut)
        self._worker = threading.Thread(target=studio.turns.run_forever, daemon=True)
        self._worker.start()
        self._watcher = threading.Thread(target=self._watch, daemon=True)
        self._watcher.start()

    def wait(self) -> None:
        """Returns when it is closed; Ctrl-C interrupts."""
        while not self._closed.wait(1.0):
            pass

    def close(self) -> None:
        """Ends all pages and both threads."""
        self._closed.set()
        self._studio.turns.stop()
        for thread in (self._worker, self._watcher):
            thread.join()  # the interpreter must not end while JAX compiles
        self._server.stop()

    def _set_the_stage(self) -> None:
        """Every page starts at the first photo's place, upright as the photos are."""
        first = self._studio.view_camera(0)
        poses = np.asarray(self._studio.scene.cameras.camtoworlds)
        up = poses[:, :, 1].mean(axis=0)
        self._server.scene.set_up_direction(up / np.linalg.norm(up))
        start = self._server.initial_camera
        centre = first.camtoworld[:, 3]
        start.position = centre
        start.look_at = centre - self._studio.focus_depth() * first.camtoworld[:, 2]
        start.fov = first.fov
        self._server.gui.configure_theme(
            dark_mode=True, show_logo=False, show_share_button=False
        )
        self._server.gui.main_panel.dock_right()

    def _open(self, client: viser.ClientHandle) -> None:
        session = Session(self._studio, lambda f: panel.show(f), lambda t: panel.say(t))
        folder = Path(self._config.checkpoint_dir) / "view"
        render, bakery = self._config.render, self._bakery
        try:
            panel = Panel(client, self._studio, session, render, folder, bakery)
        except Exception as error:  # it left meanwhile
            print(f"a page was not opened: {one_line(error)}", flush=True)
            return
        with self._lock:
            if client.client_id in self._gone:
                self._gone.remove(client.client_id)
                panel.close()
                return
            self._pages[client.client_id] = panel, session
            self._studio.turns.join(session)
            self._studio.turns.join(panel.walk)
        with contextlib.suppress(Exception):  # it left meanwhile
            panel.fill()

    def _shut(self, client: viser.ClientHandle) -> None:
        with self._lock:
            page = self._pages.pop(client.client_id, None)
            if not page:
                self._gone.add(client.client_id)
        if page:
            panel, session = page
            panel.close()
            self._studio.turns.leave(session)
            self._studio.turns.leave(panel.walk)

    def _watch(self) -> None:
        """Shows newer checkpoints as a training that still runs writes them."""
        while not self._closed.wait(SECONDS_BETWEEN_LOOKS):
            try:
                newer = self._studio.update()
            except Exception as error:  # it may be deleted while it is read
                message = f"newer checkpoint not read, trying again: {one_line(error)}"
                print(message, flush=True)
                continue
            if newer:
                print(f"showing step {self._studio.trained.step}", flush=True)
                if self._bakery:
                    self._bakery.outdated()
                for _, session in list(self._pages.values()):
                    session.refresh()


def check_free(host: str, port: int) -> None:
    """Raises a ``UserError`` if nobody can listen there."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except (OSError, OverflowError) as error:
            raise UserError(
                f"{host}:{port}: cannot listen there ({error}); end the program that "
                "does, or choose another --port"
            ) from error
