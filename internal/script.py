# SPDX-License-Identifier: Apache-2.0
"""How every script starts and ends. Imports nothing that takes time.

A script that computes asks ``begin`` before its other imports, which take seconds:
help and wrong flags are then answered at once.
"""

import argparse
import errno
import io
import os
import shlex
import signal
import sys
from collections.abc import Callable, Sequence
from types import FrameType, TracebackType

from internal import flags, process
from internal.errors import Diverged, UserError, has_utf8, one_line

USER_ERROR_EXIT = 2
FAILURE_EXIT = 1  # what nobody can fix beforehand, such as a loss that diverges


def begin(parser: argparse.ArgumentParser, *, computes: bool = True) -> None:
    """Answers ``--help``, wrong flags and names of what is not there; a script that
    computes then starts again, once, with the variables that ``process`` wants."""
    sys.excepthook = _say_uncaught
    args = parser.parse_args()
    try:
        _check_text(*sys.argv[1:], os.getcwd())
        flags.check_named(args)
    except UserError as error:
        sys.exit(_failed(error))
    if computes:
        process.restart_tuned()


def _say_uncaught(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Ctrl-C while imports take their seconds is no fault of theirs."""
    if issubclass(kind, KeyboardInterrupt):
        print("interrupted", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


def _check_text(*words: str) -> None:
    """Refuses names that are no text, as old archives unpack them: most libraries that
    open files take none."""
    for word in words:
        if not has_utf8(word):
            raise UserError(f"{word}: its name or a folder's is not UTF-8; rename it")


def run(main: Callable[[Sequence[str]], int]) -> None:
    """Runs ``main(argv)`` and exits: one line and code 2 for a ``UserError`` and where
    memory does not suffice or a name is too long. Letters that the output cannot
    take are escaped."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        code = _outcome(main)
        if sys.stdout:  # none where it was closed from the start
            sys.stdout.flush()
    except BrokenPipeError:  # who read the output is gone, as in "| head"
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for output in (1, 2):
            os.dup2(nowhere, output)
        code = 128 + signal.SIGPIPE
    sys.exit(code)


def _outcome(main: Callable[[Sequence[str]], int]) -> int:
    """The exit code of ``main``; says what went wrong."""
    try:
        return main(sys.argv[1:])
    except UserError as error:
        return _failed(error)
    except (MemoryError, RuntimeError) as error:
        if not is_out_of_memory(error):
            raise
        return _failed(
            f"memory does not suffice ({one_line(error)}); lower Train.batch_size to "
            "train, Render.chunk to render, or shrink the photos with Config.factor"
        )
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        return _failed(f"{error.filename}: {error.strerror}; give a shorter path")
    except Diverged as error:
        return _failed(error, FAILURE_EXIT)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 128 + signal.SIGINT


def _failed(reason: object, code: int = USER_ERROR_EXIT) -> int:
    """Says why; the exit code."""
    print(f"error: {reason}", file=sys.stderr)
    return code


def is_out_of_memory(error: Exception) -> bool:
    """Whether Python, NumPy or XLA (a RuntimeError of its own) could not allocate."""
    return isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in str(error)


def command_line(*words: object) -> str:
    """A command line to copy into a shell, such as ``python eval.py --run 'a b'``."""
    return shlex.join(["python", *map(str, words)])


class Interruption:
    """Notices Ctrl-C and SIGTERM while it is entered, so that the loop can save and
    leave. A second Ctrl-C leaves at once; SIGTERM comes twice from some clusters."""

    def __init__(self) -> None:
        self.signal = 0

    def __enter__(self) -> "Interruption":
        numbers = (signal.SIGINT, signal.SIGTERM)
        self._before = {n: signal.signal(n, self._notice) for n in numbers}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __bool__(self) -> bool:
        return self.signal != 0

    @property
    def exit_code(self) -> int:
        """What a shell expects of a process ended by that signal; 0 without one."""
        return 128 + self.signal if self.signal else 0

    def _notice(self, number: int, frame: FrameType | None) -> None:
        if self.signal and number == signal.SIGINT:
            os._exit(128 + number)
        self.signal = number
