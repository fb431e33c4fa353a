# SPDX-License-Identifier: Apache-2.0
"""The folder of a run (``Config.checkpoint_dir``): configuration and logs.

``config.json`` is the configuration it was trained with, ``command.txt`` the
command, ``metrics.jsonl`` one JSON object per log line with the seconds of training
up to it, ``tensorboard/`` the same for TensorBoard, with pictures.
"""

import json
import shlex
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from tensorboardX import SummaryWriter

from internal import configs, parallel
from internal.configs import Config
from internal.errors import UserError
from internal.files import atomic

LOG = "metrics.jsonl"

# May differ when a run goes on: they change no number of the result, or only add; more
# steps also stretch what is left of the schedules of the learning rates.
_FREE = frozenset(
    "checkpoint_dir max_image_memory render gt_dir train.max_steps train.log_every "
    "train.checkpoint_every train.checkpoints_kept train.preview_every".split()
)


def open_run(config: Config) -> Path:
    """Makes the run folder, or checks that it holds a run of this configuration.

    Raises:
        UserError: no folder is named, it cannot be written, or it holds a run
            with other settings.
    """
    if not config.checkpoint_dir:
        raise UserError(
            "Config.checkpoint_dir is empty; name a folder for the results: "
            "--gin_bindings=\"Config.checkpoint_dir = 'outputs/my_scene'\""
        )
    folder = Path(config.checkpoint_dir)
    saved = folder / "config.json"
    if saved.is_file():
        _check_same(saved, config)
    make_folder(folder)
    if parallel.is_writer():
        write_text(saved, configs.to_json(config))
        write_text(folder / "command.txt", f"{shlex.join(sys.argv)}\n")
    return folder


def make_folder(folder: Path) -> None:
    """Makes a folder for results, with its parents."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(
            f"{folder}: cannot be made ({error.strerror}); free space or choose "
            "another Config.checkpoint_dir"
        ) from error


def write_text(path: Path, text: str) -> None:
    """Writes a text file whole or not at all."""
    with atomic.writing(path) as partial:
        partial.write_text(text)


def _check_same(saved: Path, config: Config) -> None:
    """Stops a run from going on with settings it was not started with."""
    old, new = (
        _flat(json.loads(saved.read_text())),
        _flat(json.loads(configs.to_json(config))),
    )
    changed = [
        f"{name} was {old.get(name)!r}, is {new.get(name)!r}"
        for name in sorted(old.keys() | new.keys())
        if old.get(name) != new.get(name)
        and not any(name == free or name.startswith(f"{free}.") for free in _FREE)
    ]
    if changed:
        raise UserError(
            f"{saved}: this folder holds a run with other settings "
            f"({'; '.join(changed)}); choose another Config.checkpoint_dir or undo "
            "the change"
        )


def _flat(tree: dict, prefix: str = "") -> dict:
    """Nested dictionaries as one with dotted names."""
    result = {}
    for name, value in tree.items():
        if isinstance(value, dict):
            result |= _flat(value, f"{prefix}{name}.")
        else:
            result[prefix + name] = value
    return result


def training_seconds(folder: Path) -> float:
    """Seconds that the run trained, over all its starts, with compilation and previews.

    0 for a run that logged nothing, or did before seconds were logged.
    """
    rows = read_log(folder)
    return rows[-1].get("seconds", 0.0) if rows else 0.0


def read_log(folder: Path) -> list[dict[str, Any]]:
    """The lines of a run's ``LOG``, as far as they are whole."""
    return atomic.whole_lines(folder / LOG)


class RunLog:
    """Appends numbers to ``metrics.jsonl`` and, with pictures, to TensorBoard.

    A context manager. In a run of several processes only the writer's writes.
    """

    def __init__(self, folder: Path, start_step: int) -> None:
        self._unread = tempfile.TemporaryDirectory()
        if not parallel.is_writer():
            folder = Path(self._unread.name)
        _drop_after(folder, start_step)
        self._began = time.monotonic() - training_seconds(folder)
        self._file = (folder / LOG).open("a")
        self._board = SummaryWriter(
            str(folder / "tensorboard"), purge_step=start_step + 1
        )

    def scalars(self, step: int, values: dict[str, float]) -> None:
        """One line of numbers for ``step``."""
        seconds = round(time.monotonic() - self._began, 2)
        line = {"step": step, "seconds": seconds, **values}
        with atomic.naming(Path(self._file.name)):
            self._file.write(json.dumps(line) + "\n")
            self._file.flush()
        for name, value in values.items():
            self._board.add_scalar(name, value, step)

    def picture(
        self, step: int, name: str, srgb: Float[np.ndarray, "height width 3"]
    ) -> None:
        """A picture for TensorBoard."""
        self._board.add_image(name, np.clip(srgb, 0, 1), step, dataformats="HWC")
        self._board.flush()

    def __enter__(self) -> "RunLog":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
        self._board.close()
        self._unread.cleanup()


def _drop_after(folder: Path, step: int) -> None:
    """Removes lines of steps that the checkpoint does not hold: they come again."""
    if (folder / LOG).is_file():
        kept = [row for row in read_log(folder) if row["step"] <= step]
        write_text(folder / LOG, "".join(json.dumps(row) + "\n" for row in kept))
