# SPDX-License-Identifier: Apache-2.0
"""One computer, several users: each with work gets a chunk of it done in turn."""

import contextlib
import threading
from collections.abc import Callable

from internal.errors import one_line
from internal.viewer.chunked_jobs import Runnable, Series


class Turns:
    """Runs the steps of everyone who takes part, the most urgent first.

    Among equally urgent ones the longest waiting is next. An error in a step is told
    to the one it belongs to and to nobody else.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._queue: list[Runnable] = []
        self._stopped = False

    def join(self, runnable: Runnable) -> None:
        """Takes part from now on."""
        with self._changed:
            self._queue.append(runnable)
            self._changed.notify()

    def leave(self, runnable: Runnable) -> None:
        """Gets no more turns; a running step ends first."""
        with self._changed:
            if runnable in self._queue:
                self._queue.remove(runnable)

    def wake(self) -> None:
        """Says that somebody has new work."""
        with self._changed:
            self._changed.notify()

    def stop(self) -> None:
        """Ends ``run_forever`` after the running step."""
        with self._changed:
            self._stopped = True
            self._changed.notify()

    def take_one(self) -> bool:
        """Runs one step, if anybody has work; whether there was any."""
        with self._changed:
            urgencies = [runnable.urgency() for runnable in self._queue]
            if not any(urgencies):
                return False
            chosen = self._queue.pop(urgencies.index(max(urgencies)))
            self._queue.append(chosen)
        try:
            chosen.step()
        except Exception as error:  # a client's trouble must not end the server
            with contextlib.suppress(Exception):  # nor its having gone meanwhile
                chosen.failed(error)
        return True

    def run_forever(self) -> None:
        """Runs steps as they come, until ``stop``."""
        while not self._stopped:
            if not self.take_one():
                with self._changed:
                    idle = not any(runnable.urgency() for runnable in self._queue)
                    if idle and not self._stopped:
                        self._changed.wait()


class Errand:
    """A job that is finished even if the page that wanted it is closed meanwhile."""

    def __init__(self, job: Series, turns: Turns, say: Callable[[str], None]) -> None:
        self._job, self._turns, self._say = job, turns, say
        turns.join(self)

    def urgency(self) -> int:
        """See ``chunked_jobs.Runnable``."""
        return 1

    def step(self) -> None:
        """Computes a chunk."""
        self._job.step()
        if self._job.done:
            self._turns.leave(self)

    def failed(self, error: Exception) -> None:
        """Gives up and says why."""
        self._turns.leave(self)
        self._say(one_line(error))
