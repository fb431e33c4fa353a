# SPDX-License-Identifier: Apache-2.0
"""A run: commands that fill a folder one after the other. Imports nothing large, for
the nodes of a cluster read it."""

import dataclasses
import signal
import subprocess
from pathlib import Path

from internal.files import atomic

LOG = "log.txt"
RECORD = "scored_with.json"  # what the run was made of, once its result is there
LOG_TAIL = 4096  # bytes that hold the last line


@dataclasses.dataclass(frozen=True)
class Run:
    """What is to be run in a folder, and how to see that it was."""

    name: str  # for the user
    folder: Path
    commands: tuple[tuple[str, ...], ...]  # each goes on where it was stopped
    record: str  # what the result depends on; with another record it is made anew
    result: Path  # the last file that the commands write

    @property
    def log(self) -> Path:
        """Where the words of all commands go, after those of earlier tries."""
        return self.folder / LOG

    def is_done(self) -> bool:
        """Whether the result is there, made of the same."""
        path = self.folder / RECORD
        made = path.is_file() and path.read_text(encoding="utf-8") == self.record
        return made and self.result.is_file()

    def last_line(self) -> str:
        """The last words of the log; empty without any."""
        if not self.log.is_file():
            return ""
        with self.log.open("rb") as file:
            file.seek(max(self.log.stat().st_size - LOG_TAIL, 0))
            lines = file.read().decode(errors="replace").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip()), "")

    def start(self, index: int, **how) -> subprocess.Popen:
        """Starts a command; its words go to the log.

        Args:
            how: further arguments of ``subprocess.Popen``.

        Raises:
            UserError: the log cannot be written.
        """
        atomic.ensure_folder(self.folder)
        with atomic.naming(self.log), self.log.open("ab") as log:
            return subprocess.Popen(
                self.commands[index], stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                **how,
            )  # fmt: skip

    def note(self, line: str) -> None:
        """Adds what its own commands cannot say to the log."""
        with self.log.open("a", encoding="utf-8") as log:
            log.write(f"\n{line}\n")

    def end(self, index: int, code: int) -> int:
        """Notes how a command ended; returns its code as a shell gives it.

        Args:
            code: as ``subprocess`` gives it, -9 for a process killed by signal 9.
        """
        if code < 0:
            self.note(f"killed by {signal.Signals(-code).name}")
            return 128 - code
        if code == 0 and index == len(self.commands) - 1:
            atomic.write_text(self.folder / RECORD, self.record)
        return code

    def perform(self) -> int:
        """Runs the commands until one fails; its code, or 0."""
        for index in range(len(self.commands)):
            code = self.end(index, self.start(index).wait())
            if code:
                return code
        return 0
