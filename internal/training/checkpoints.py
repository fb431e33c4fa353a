# SPDX-License-Identifier: Apache-2.0
"""Checkpoints through Orbax: atomic, the last few kept, whole ``TrainState``.

Process 0 writes; every process takes part in saving and restoring.
"""

import logging
from pathlib import Path
from typing import Any

import jax
import orbax.checkpoint as ocp
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from internal.configs import Config
from internal.errors import UserError
from internal.models import Model
from internal.training.step import TrainState, initial_state

logging.getLogger("absl").setLevel(logging.ERROR)


class Checkpoints:
    """The checkpoints of one run folder. Use as a context manager."""

    def __init__(self, run_dir: Path, kept: int) -> None:
        self.folder = (run_dir / "checkpoints").resolve()
        options = ocp.CheckpointManagerOptions(
            max_to_keep=kept, create=True, enable_async_checkpointing=False
        )
        try:
            self._manager = ocp.CheckpointManager(
                self.folder,
                options=options,
                item_handlers=ocp.StandardCheckpointHandler(),
            )
        except OSError as error:
            raise UserError(
                f"{self.folder}: cannot be written ({error.strerror}); free space or "
                "choose another Config.checkpoint_dir"
            ) from error

    def __enter__(self) -> "Checkpoints":
        return self

    def __exit__(self, *_: object) -> None:
        self._manager.close()

    def latest_step(self) -> int | None:
        """The newest complete checkpoint's step, or None."""
        return self._manager.latest_step()

    def save(self, state: TrainState) -> None:
        """Saves under ``state.step``, once; older checkpoints beyond the limit go.

        Raises:
            UserError: the disk is full or the folder is not writable.
        """
        step = int(state.step)
        if step == self.latest_step():
            return
        try:
            self._manager.save(step, args=ocp.args.StandardSave(state))
            self._manager.wait_until_finished()
        except (OSError, ValueError) as error:
            reason = " ".join(str(error).split())[:200]
            raise UserError(
                f"{self.folder}: step {step} could not be saved ({reason}); free "
                "space; the checkpoints before it are intact"
            ) from error

    def restore(self, like: TrainState, mesh: Mesh) -> TrainState:
        """The newest state, whole on every device of ``mesh``.

        Args:
            like: a state, or ``jax.eval_shape`` of one, of the configured model.

        Raises:
            UserError: there is none, or it holds a model of another shape.
        """
        step = self.latest_step()
        if step is None:
            raise UserError(
                f"{self.folder}: no checkpoint; train first, or correct "
                "Config.checkpoint_dir"
            )
        # Compared before any array is read: a restore that fails half-way leaves
        # Orbax's other reads calling into a closed event loop.
        saved: Any = self._manager.item_metadata(step)
        if _shapes(saved.tree["params"]) != _shapes(like.params):
            raise UserError(
                f"{self.folder}: step {step} holds a model of another shape than the "
                "one configured; use the gin files and bindings it was trained with "
                f"({self.folder.parent / 'config.json'})"
            )
        sharding = NamedSharding(mesh, PartitionSpec())
        target = jax.tree.map(
            lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=sharding), like
        )
        restored: Any = self._manager.restore(
            step, args=ocp.args.StandardRestore(target)
        )
        return restored


def _shapes(params: Any) -> dict[str, tuple[int, ...]]:
    leaves = jax.tree_util.tree_flatten_with_path(params)[0]
    return {jax.tree_util.keystr(path): tuple(leaf.shape) for path, leaf in leaves}


def load_trained(config: Config, mesh: Mesh) -> tuple[Model, TrainState]:
    """The configured model with its newest checkpoint, for rendering.

    Raises:
        UserError: there is no checkpoint, or its model has another shape.
    """
    folder = Path(config.checkpoint_dir)
    if not (folder / "checkpoints").is_dir():
        raise UserError(
            f"{folder}: holds no checkpoint; train first, or correct "
            "Config.checkpoint_dir"
        )
    model = Model(config.model)
    like = jax.eval_shape(lambda: initial_state(config, model))
    with Checkpoints(folder, config.train.checkpoints_kept) as checkpoints:
        return model, checkpoints.restore(like, mesh)
