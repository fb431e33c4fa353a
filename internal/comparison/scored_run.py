# SPDX-License-Identifier: Apache-2.0
"""One training and its scores, in a run folder, by the scripts a user calls.

Each script is a process of its own: its memory is free when it ends, and Ctrl-C
reaches it. What was trained and scored with this configuration is not run again.
"""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from internal import configs, saved_config
from internal.configs import Config
from internal.files import atomic

SCRIPTS = ("train.py", "eval.py")
RECORD = "scored_with.json"  # the configuration, once the scores are there


def train_and_score(
    run: Path, gin_configs: Sequence[str], gin_bindings: Sequence[str]
) -> int:
    """Trains in ``run``, whatever the bindings name, and scores the test views.

    Returns:
        0, or the exit code of the script that failed or was stopped.

    Raises:
        UserError: the configuration is wrong.
    """
    record = saved_config.to_json(config_of(run, gin_configs, gin_bindings))
    if is_done(run, record):
        print("done before")
        return 0
    for script in SCRIPTS:
        code = run_script(script, run, gin_configs, gin_bindings)
        if code:
            return code
    atomic.write_text(run / RECORD, record)
    return 0


def run_script(
    script: str, run: Path, gin_configs: Sequence[str], gin_bindings: Sequence[str]
) -> int:
    """Runs one script on ``run``, whatever the bindings name; returns its exit code."""
    arguments = [f"--gin_configs={file}" for file in gin_configs]
    arguments += [f"--gin_bindings={x}" for x in (*gin_bindings, _own_binding(run))]
    here = Path(__file__).parents[2] / script
    return subprocess.run([sys.executable, str(here), *arguments]).returncode


def config_of(
    run: Path, gin_configs: Sequence[str], gin_bindings: Sequence[str]
) -> Config:
    """The configuration that ``train_and_score`` uses."""
    return configs.load_config(gin_configs, [*gin_bindings, _own_binding(run)])


def is_done(run: Path, record: str) -> bool:
    """Whether the run was trained and scored with the configuration ``record``."""
    path = run / RECORD
    scores = run / "eval" / "metrics.json"
    return path.is_file() and path.read_text() == record and scores.is_file()


def _own_binding(run: Path) -> str:
    return f"Config.checkpoint_dir = {str(run)!r}"
