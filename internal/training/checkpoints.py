# SPDX-License-Identifier: Apache-2.0
"""Checkpoints through Orbax: atomic, the last few kept, whole ``TrainState``.

Process 0 writes; every process takes part in saving and restoring. Each array is a
folder of its own: Orbax's other layout (OCDBT) looks for its parts with patterns, and
finds none where a folder's name has a bracket. What was written is read back before it
counts as saved, and its files' checksums are kept beside it (``N.json`` of step N): a
disk or a copy that changes a bit of a parameter is noticed before anything is loaded.
"""

import dataclasses
import json
import logging
import zlib
from pathlib import Path
from typing import Any

import jax
import numpy as np
import orbax.checkpoint as ocp
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from internal import parallel
from internal.configs import Config
from internal.errors import UserError, one_line
from internal.files import atomic
from internal.models import Model
from internal.training import run_folder
from internal.training.step import TrainState, initial_state

BYTES_PER_ARRAY = 1 << 14  # beside its content
logging.getLogger("absl").setLevel(logging.ERROR)


class Checkpoints:
    """The checkpoints of one run folder. Use as a context manager."""

    def __init__(self, run: Path, kept: int) -> None:
        self.folder = (run / run_folder.CHECKPOINTS).resolve()
        self._kept = kept
        options = ocp.CheckpointManagerOptions(
            create=True, enable_async_checkpointing=False
        )
        try:
            self._manager = ocp.CheckpointManager(
                self.folder,
                options=options,
                item_handlers=ocp.PyTreeCheckpointHandler(use_ocdbt=False),
            )
        except OSError as error:
            raise UserError(
                f"{self.folder}: cannot be written ({error.strerror}); free space or "
                "choose another --run"
            ) from error

    def __enter__(self) -> "Checkpoints":
        return self

    def __exit__(self, *_: object) -> None:
        self._manager.close()

    def latest_step(self) -> int | None:
        """The newest complete checkpoint's step, or None."""
        return self._manager.latest_step()

    def save(self, state: TrainState) -> None:
        """Saves under ``state.step``, once, and reads it back; then older checkpoints
        beyond the limit go.

        Raises:
            UserError: the disk is full, the folder is not writable, or what is read
                back is something else.
        """
        step = int(state.step)
        if step == self.latest_step():
            return
        try:
            if parallel.is_writer():  # Orbax's threads outlive the error
                atomic.take_room(self.folder, _bytes(state))
            self._manager.save(step, args=ocp.args.PyTreeSave(state))
            self._manager.wait_until_finished()
            intact = _equal(self._read(step, state), state)
            for gone in self._manager.all_steps()[: -self._kept] if intact else [step]:
                self._manager.delete(gone)
                self._checksums(gone).unlink(missing_ok=True)
            if intact and parallel.is_writer():
                sums = json.dumps(checksums(self.folder / str(step)), indent=1)
                atomic.write_text(self._checksums(step), sums + "\n")
        except (OSError, ValueError, KeyError) as error:
            raise UserError(
                f"{self.folder}: step {step} could not be saved ({one_line(error)}); "
                "free space; the checkpoints before it are intact"
            ) from error
        if not intact:
            raise UserError(
                f"{self.folder}: step {step} is not read back as it was saved; the "
                "disk is failing: choose another --run"
            )

    def restore(self, like: TrainState, mesh: Mesh) -> TrainState:
        """The newest state, whole on every device of ``mesh``.

        Args:
            like: a state, or ``jax.eval_shape`` of one, of the configured model.

        Raises:
            UserError: there is none, it is damaged, or it holds a model of another
                shape.
        """
        step = self.latest_step()
        if step is None:
            raise UserError(
                f"{self.folder}: no checkpoint; train first, or correct --run"
            )
        self._verify(step)
        sharding = NamedSharding(mesh, PartitionSpec())
        target = jax.tree.map(
            lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=sharding), like
        )
        try:
            # Compared before any array is read: a restore that fails half-way leaves
            # Orbax's other reads calling into a closed event loop.
            saved: Any = self._manager.item_metadata(step)
            same_shape = _shapes(saved.tree["params"]) == _shapes(like.params)
            if same_shape:
                return self._read(step, target)
        except Exception as error:  # whatever its libraries say of a damaged file
            raise self._damaged(step, one_line(error)) from error
        raise UserError(
            f"{self.folder}: step {step} holds a model of another shape than "
            f"{self.folder.parent / run_folder.CONFIG} states; restore both, or train "
            "into another folder"
        )

    def _checksums(self, step: int) -> Path:
        """The file of a checkpoint's checksums. A training killed between the two
        writes leaves a whole checkpoint without one."""
        return self.folder / f"{step}.json"

    def _verify(self, step: int) -> None:
        path = self._checksums(step)
        if not path.is_file():
            return
        stated = atomic.read_json(path, "train.py")
        found = checksums(self.folder / str(step))
        if stated == found:
            return
        names = sorted(stated) if isinstance(stated, dict) else []
        changed = [name for name in names if stated[name] != found.get(name)]
        raise self._damaged(step, f"{[*changed, path.name][0]} is not what was saved")

    def _damaged(self, step: int, what: str) -> UserError:
        return UserError(
            f"{self.folder}: step {step} is damaged ({what}); copy it anew, or delete "
            f"the folder {step} to go on from the checkpoint before it"
        )

    def _read(self, step: int, like: TrainState) -> TrainState:
        """A saved state, placed as ``like`` is."""
        arguments = ocp.args.PyTreeRestore(
            like, restore_args=ocp.checkpoint_utils.construct_restore_args(like)
        )
        restored: Any = self._manager.restore(step, args=arguments)
        return restored


def checksums(folder: Path) -> dict[str, int]:
    """CRC-32 of every file in a folder, by its path there."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {
        path.relative_to(folder).as_posix(): zlib.crc32(path.read_bytes())
        for path in files
    }


def _bytes(state: TrainState) -> int:
    """More than a state takes on a disk: each array is a folder with its metadata."""
    return sum(leaf.nbytes + BYTES_PER_ARRAY for leaf in jax.tree.leaves(state))


def _equal(a: TrainState, b: TrainState) -> bool:
    """Whether two states hold the same numbers."""
    pairs = zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    return all(np.array_equal(np.asarray(x), np.asarray(y)) for x, y in pairs)


def _shapes(params: Any) -> dict[str, tuple[int, ...]]:
    leaves = jax.tree_util.tree_flatten_with_path(params)[0]
    return {jax.tree_util.keystr(path): tuple(leaf.shape) for path, leaf in leaves}


def load_trained(config: Config, mesh: Mesh) -> tuple[Model, TrainState]:
    """The configured model with its newest checkpoint, for rendering: with
    ``Render.sample_shares`` of its samples.

    Raises:
        UserError: there is no checkpoint, its model has another shape, or it holds
            what is not a number.
    """
    folder = Path(config.checkpoint_dir)
    if not run_folder.has_begun(folder):
        raise UserError(f"{folder}: holds no checkpoint; train first, or correct --run")
    model = Model(config.model)
    like = jax.eval_shape(lambda: initial_state(config, model))
    with Checkpoints(folder, config.train.checkpoints_kept) as checkpoints:
        state = checkpoints.restore(like, mesh)
    if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(state.params)):
        raise UserError(
            f"{folder}: the model of step {int(state.step)} is not finite: training "
            "diverged; train anew with a lower Optimizer.lr_init"
        )
    counts = config.model.num_samples
    shares = config.render.sample_shares or (1.0,) * len(counts)
    fewer = [max(round(n * s), 1) for n, s in zip(counts, shares, strict=True)]
    return Model(dataclasses.replace(config.model, num_samples=tuple(fewer))), state
