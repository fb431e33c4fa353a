# SPDX-License-Identifier: Apache-2.0
"""The first run: makes the night scene, trains on its dark photos, shows the result.

``make demo`` runs it. It calls the same scripts a user calls and prints each command.
"""

import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from internal import cli
from internal.files import image_io
from internal.pages import contact_sheet
from internal.scoring import evaluation
from internal.scoring.baselines import gain_to_mean

SCENE = Path("scenes/night")
RUN = Path("outputs/demo")
FLAGS = (
    "--gin_configs=configs/demo.gin",
    f"--gin_bindings=Config.data_dir = '{SCENE}'",
    f"--gin_bindings=Config.checkpoint_dir = '{RUN}'",
)


def main(argv: Sequence[str]) -> int:
    """Runs the four commands, then puts the pictures side by side."""
    commands = [
        ("make_scene.py", "night", str(SCENE)),
        ("train.py", *FLAGS),
        ("eval.py", *FLAGS),
        ("render.py", *FLAGS),
    ]
    for command in commands:
        print(f"\n$ python {shlex.join(command)}", flush=True)
        code = subprocess.run([sys.executable, *command]).returncode
        if code:
            return code
    folder = RUN / "eval"
    name = sorted((folder / "enhanced").glob("*.png"))[0].name
    dark, enhanced, truth = (
        image_io.read_srgb(folder / output / name)
        for output in ("input", "enhanced", "truth")
    )
    brightened = gain_to_mean(dark)
    comparison = RUN / "side_by_side.png"
    labelled = [
        ("input", dark),
        ("input, brightened", brightened),
        ("enhanced", enhanced),
        ("truth", truth),
    ]
    contact_sheet.side_by_side(labelled, comparison)
    print(
        f"\nvideo:        {RUN / 'render' / 'auto' / 'enhanced.mp4'}"
        f"\nside by side: {comparison}"
        f"\nmetrics:      {folder / 'metrics.json'}, {folder / 'index.html'}"
        f"\n\n{evaluation.read_table(folder / 'metrics.json')}"
    )
    return 0


if __name__ == "__main__":
    cli.run_script(main)
