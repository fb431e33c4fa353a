# SPDX-License-Identifier: Apache-2.0
"""One training and its scores, in a run folder, by the scripts a user calls.

Each script is a process of its own: its memory is free when it ends.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from internal import configs, saved_config
from internal.configs import Config
from internal.launching.run import Run

SCRIPTS = ("train.py", "eval.py")


def scored_run(
    name: str, folder: Path, gin_configs: Sequence[str], gin_bindings: Sequence[str]
) -> Run:
    """What trains in ``folder``, whatever the bindings name, and scores the test views.

    Raises:
        UserError: the configuration is wrong.
    """
    return Run(
        name=name,
        folder=folder,
        commands=tuple(
            command(script, folder, gin_configs, gin_bindings) for script in SCRIPTS
        ),
        record=saved_config.to_json(config_of(folder, gin_configs, gin_bindings)),
        result=folder / "eval" / "metrics.json",
    )


def command(
    script: str, folder: Path, gin_configs: Sequence[str], gin_bindings: Sequence[str]
) -> tuple[str, ...]:
    """The command of one script on ``folder``, whatever the bindings name."""
    bindings = (*gin_bindings, _own_binding(folder))
    return (
        sys.executable,
        str(Path(__file__).parents[2] / script),
        *(f"--gin_configs={file}" for file in gin_configs),
        *(f"--gin_bindings={binding}" for binding in bindings),
    )


def config_of(
    folder: Path, gin_configs: Sequence[str], gin_bindings: Sequence[str]
) -> Config:
    """The configuration that these commands use."""
    return configs.load_config(gin_configs, [*gin_bindings, _own_binding(folder)])


def _own_binding(folder: Path) -> str:
    return f"Config.checkpoint_dir = {str(folder)!r}"
