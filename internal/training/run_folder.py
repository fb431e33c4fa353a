# SPDX-License-Identifier: Apache-2.0
"""The folder of a run (``Config.checkpoint_dir``), which explains itself:

    config.json      the configuration it is trained with (internal/saved_config.py)
    scene.json       the scene it is trained on (internal/scene/identity.py)
    command.txt      the last command that trained it
    noise.json       the noise of the photos, for ``Losses.observation = 'noisy'``
    metrics.jsonl    one JSON object per log line, with the seconds of training up to it
    tensorboard/     the same for TensorBoard, with pictures
    checkpoints/     the last few states, a folder per step
    training.lock    held by the training that is running

A run has begun once it has a checkpoint. Whatever was left of one that had not is
written over.
"""

import contextlib
import json
import shlex
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from tensorboardX import SummaryWriter

from internal import configs, flags, parallel, saved_config
from internal.configs import Config
from internal.errors import UserError
from internal.files import atomic
from internal.files.locks import take_lock
from internal.files.scratch import scratch_folder
from internal.scene import identity
from internal.scene.identity import Identity
from internal.training import budget

CONFIG = "config.json"
SCENE = "scene.json"
LOG = "metrics.jsonl"
LOCK = "training.lock"
CHECKPOINTS = "checkpoints"

# May differ when a run goes on or is used: they change no number of the result, only
# add, or are checked in another way (scene.json); more steps also stretch what is left
# of the schedules of the learning rates.
_FREE = frozenset(
    "Config.checkpoint_dir Config.data_dir Config.gt_dir Config.max_image_memory "
    "Train.max_steps Train.log_every Train.checkpoint_every Train.checkpoints_kept "
    "Train.preview_every".split()
)


def has_begun(folder: Path) -> bool:
    """Whether there is a run with a checkpoint."""
    checkpoints = folder / CHECKPOINTS
    return checkpoints.is_dir() and any(p.name.isdigit() for p in checkpoints.iterdir())


def own_config(folder: Path) -> Config | None:
    """The configuration of the run in a folder, if one has begun."""
    return saved_config.read(folder / CONFIG) if has_begun(folder) else None


def config_to_train(gin_configs: Sequence[str], gin_bindings: Sequence[str]) -> Config:
    """The configuration of a training. Bindings alone, without gin files, go on top of
    the run's own configuration where the run has begun."""
    named = configs.bound("Config.checkpoint_dir", gin_configs, gin_bindings)
    if gin_configs or not has_begun(Path(named)):
        return configs.load_config(gin_configs, gin_bindings)
    saved = Path(named) / CONFIG
    print(f"no gin file is given: the run goes on with its own {saved}", flush=True)
    base = saved_config.as_bindings(saved_config.read(saved))
    return configs.load_config([], gin_bindings, base)


def config_of_run(gin_configs: Sequence[str], gin_bindings: Sequence[str]) -> Config:
    """The configuration that a run was trained with, under what gin files and bindings
    state; they have to name the run.

    Raises:
        UserError: no run is named, there is none, or anything that is stated differs
            from the run's own and may not.
    """
    named = configs.bound("Config.checkpoint_dir", gin_configs, gin_bindings)
    if not named:
        raise UserError("no run is named; give its folder: --run outputs/my_scene")
    folder = Path(named)
    if not has_begun(folder):
        raise flags.no_checkpoint(folder)
    own = saved_config.read(folder / CONFIG)
    base = saved_config.as_bindings(own)
    config = configs.load_config(gin_configs, gin_bindings, base)
    if own.max_minutes:
        config = budget.with_schedule(config, own)
    changed = _changed(own, config)
    changed.pop("Config.max_minutes", None)
    if changed:
        raise UserError(
            f"{folder}: trained with other settings ({_listed(changed)}); leave them "
            "out: the run knows its own, only Render.* and folders may differ"
        )
    return config


@contextlib.contextmanager
def claimed(config: Config) -> Iterator[Path]:
    """The run folder, made if need be, which no other training uses meanwhile.

    Of a run of several processes the writer holds its lock for all.

    Raises:
        UserError: no folder is named, it cannot be written, or another training uses
            it.
    """
    if not config.checkpoint_dir:
        raise UserError(
            "no folder for the results is named; give one: --run outputs/my_scene"
        )
    folder = Path(config.checkpoint_dir)
    atomic.ensure_folder(folder)
    with contextlib.ExitStack() as stack:
        taken = False
        if parallel.is_writer():
            with atomic.naming(folder):
                file = stack.enter_context((folder / LOCK).open("a"))
            try:
                taken = not take_lock(file.fileno())
            except OSError as error:  # a file system without locks
                print(f"{folder}: cannot be locked ({error.strerror}); start one "
                      "training there at a time", flush=True)  # fmt: skip
        if parallel.in_any_process(taken):
            raise UserError(
                f"{folder}: another training is running there; wait for it, or choose "
                "another --run"
            )
        yield folder


def open_run(config: Config, scene: Identity) -> Path:
    """Writes what explains the run, or checks that the folder holds a run of this
    configuration on this scene.

    Raises:
        UserError: it cannot be written, or it holds a run with other settings or of
            another scene.
    """
    folder = Path(config.checkpoint_dir)
    own = own_config(folder)
    if own:
        changed = _changed(own, config)
        if changed:
            raise UserError(
                f"{folder / CONFIG}: this folder holds a run with other settings "
                f"({_listed(changed)}); choose another --run or undo the change"
            )
        check_same_scene(folder, scene)
    if parallel.is_writer():
        atomic.write_text(folder / CONFIG, saved_config.to_json(config))
        atomic.write_text(folder / SCENE, json.dumps(scene, indent=1) + "\n")
        atomic.write_text(folder / "command.txt", f"{shlex.join(sys.argv)}\n")
    return folder


def check_same_scene(folder: Path, scene: Identity, *, scored: bool = True) -> None:
    """Compares a scene with the one the run was trained on; prints what changed.

    Args:
        scored: for what trains or scores, where any change makes wrong numbers. What
            only looks at the model needs the same frame and no more.

    Raises:
        UserError: the result would be wrong.
    """
    trained_on = _read_scene(folder / SCENE)
    changed = ", ".join(identity.changes(trained_on, scene))
    if not changed:
        return
    if scored or identity.frame_changed(trained_on, scene):
        raise UserError(
            f"{folder}: the scene is not the one it was trained on: {changed}; undo "
            "that, name the scene as it was with --scene, or train another run"
        )
    print(f"{folder}: the scene has changed since training: {changed}", flush=True)


def _read_scene(path: Path) -> Identity:
    try:
        read = json.loads(path.read_text(encoding="utf-8"))
        identity.changes(read, read)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(
            f"{path}: cannot be read, or another version of this program wrote it; "
            "restore the file, or train into another folder"
        ) from error
    return read


def _changed(old: Config, new: Config) -> dict[str, str]:
    """Settings that differ and may not, by name."""
    free = set(_FREE)
    if old.max_minutes and (not new.max_minutes or new.max_minutes > old.max_minutes):
        free |= {"Config.max_minutes", *budget.SCHEDULE}
    return {
        name: text
        for name, text in saved_config.differences(old, new).items()
        if name not in free and not name.startswith("Render.")
    }


def _listed(changed: dict[str, str]) -> str:
    return "; ".join(f"{name} {text}" for name, text in changed.items())


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
        self._unread = contextlib.ExitStack()
        if not parallel.is_writer():
            folder = self._unread.enter_context(scratch_folder())
        _drop_after(folder, start_step)
        self._began = time.monotonic() - training_seconds(folder)
        with atomic.naming(folder):
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
        self._unread.close()


def _drop_after(folder: Path, step: int) -> None:
    """Removes lines of steps that the checkpoint does not hold: they come again."""
    if (folder / LOG).is_file():
        kept = [row for row in read_log(folder) if row["step"] <= step]
        text = "".join(json.dumps(row) + "\n" for row in kept)
        atomic.write_text(folder / LOG, text)
