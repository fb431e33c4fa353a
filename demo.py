# SPDX-License-Identifier: Apache-2.0
"""The first run: makes the night scene, trains on its dark photos, shows the result.

``make demo`` runs it. It calls the same scripts a user calls and prints each command.
"""

from internal import flags, script

if __name__ == "__main__":  # before the imports below, which take seconds
    script.begin(flags.demo(__doc__), computes=False)

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from internal.files import image_io
from internal.pages import contact_sheet, scores
from internal.scoring.baselines import gain_to_mean

SCENE = Path("scenes/night")
RUN = Path("outputs/demo")
OF_RUN = f"--run={RUN}"


def main(argv: Sequence[str]) -> int:
    """Runs the four commands, then puts the pictures side by side."""
    commands = [
        ("make_scene.py", "night", str(SCENE)),
        ("train.py", "--gin_configs=configs/demo.gin", f"--scene={SCENE}", OF_RUN),
        ("eval.py", OF_RUN),
        ("render.py", OF_RUN),
    ]
    for command in commands:
        print(f"\n$ {script.command_line(*command)}", flush=True)
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
        f"\n\n{scores.read_table(folder / 'metrics.json')}"
    )
    return 0


if __name__ == "__main__":
    script.run(main)
