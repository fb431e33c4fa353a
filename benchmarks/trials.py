# SPDX-License-Identifier: Apache-2.0
"""The scripts as ``kills`` and ``shortages`` break them: what each is given, what it
makes, and whether that is what an undisturbed one makes.

A trial happens in a *place*, always the same folder, since results name it. What no
script writes to (a night scene, photos, a trained run to copy) lies beside it.
"""

import dataclasses
import hashlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import jax
import numpy as np

from internal import cli, flags, parallel
from internal.files.atomic import PARTIAL
from internal.training import run_folder
from internal.training.checkpoints import load_trained
from tests.textured_room import write_room

SETTINGS = (
    *("Train.max_steps = 60", "Train.enhance_start = 40", "Train.log_every = 2"),
    *("Train.checkpoint_every = 6", "Train.preview_every = 20"),
    *("Train.batch_size = 64", "Model.num_samples = (8, 8)", "MLP.depth = 2"),
    *("MLP.width = 16", "Model.head_width = 8", "Render.frames = 3"),
)
GROWS = ("tensorboard", "work", "made_with.json", run_folder.LOG)  # or says how far
PLACE = "place"


@dataclasses.dataclass(frozen=True)
class Script:
    """A command, and the folder of its place that it fills."""

    name: str
    words: tuple[str, ...]  # of the command, in the folder of all trials
    made: str
    needs_run: bool  # in its place


def _binding(text: str) -> str:
    return f"--gin_bindings={text}"


RUN, SCENE = f"{PLACE}/run", f"{PLACE}/scene"
SCRIPTS = (
    Script(
        "train",
        (*map(_binding, SETTINGS), "--scene", "night", "--run", RUN),
        "run",
        False,
    ),
    Script("eval", ("--run", RUN), "run/eval", True),
    Script("render", ("--run", RUN), "run/render", True),
    Script(
        "export",
        ("--run", RUN, "--points=500", "--resolution=16", "--splats=50"),
        "run/export",
        True,
    ),
    Script("prepare", ("photos", SCENE), "scene", False),
)
ROOT = Path(__file__).parents[1]


@contextmanager
def trials() -> Iterator[Path]:
    """The folder of all trials, with what scripts are given."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        size = ["--views", "4", "--width", "24", "--height", "18"]
        made = [sys.executable, "make_scene.py", "night", str(folder / "night"), *size]
        subprocess.run(made, check=True, stdout=subprocess.DEVNULL)
        write_room(folder / "photos", 7)
        (folder / PLACE).mkdir()
        assert start(SCRIPTS[0], folder).wait() == 0
        shutil.copytree(folder / RUN, folder / "run")
        yield folder


def set_up(script: Script, folder: Path) -> Path:
    """The place, with what the script needs there and no more."""
    place = folder / PLACE
    for left in place.iterdir():
        shutil.rmtree(left)
    if script.needs_run:
        shutil.copytree(folder / "run", place / "run")
    return place


def start(
    script: Script, folder: Path, more: Sequence[str] = (), **options
) -> subprocess.Popen:
    """The script, started; ``stderr`` is read from it as text."""
    words = [
        str(folder / word) if (folder / word.split("/")[0]).exists() else word
        for word in script.words
    ]
    return subprocess.Popen(
        [sys.executable, f"{script.name}.py", *words, *more],
        cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        **options,
    )  # fmt: skip


def result(script: Script, folder: Path) -> object:
    """All that a script made, to compare with ``==``."""
    made = folder / PLACE / script.made
    return _trained(made) if script.name == "train" else contents(made)


def undisturbed(script: Script, folder: Path) -> tuple[object, float]:
    """What a script makes that nothing happens to, and the seconds it takes."""
    set_up(script, folder)
    started = time.monotonic()
    code = start(script, folder).wait()
    seconds = time.monotonic() - started
    assert code == 0, (script, code)
    return result(script, folder), seconds


def ended(script: Script, folder: Path, whole: object) -> str:
    """What is wrong once the command is run (again); "" if nothing."""
    process = start(script, folder)
    _, error = process.communicate()
    if process.returncode:
        return f"then exit {process.returncode}: {error[-300:]}"
    if result(script, folder) != whole:
        return "then differs"
    left = leftovers(folder)
    return f"then left {left}" if left else ""


def contents(folder: Path) -> dict[str, str]:
    """A digest of every file in a folder, by its path there."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(
            path.read_bytes()
        ).hexdigest()
        for path in folder.rglob("*")
        if path.is_file()
    }


def half_written(script: Script, folder: Path, whole: object) -> list[str]:
    """Files under a final name that are not what an undisturbed script makes."""
    made = folder / PLACE / script.made
    if not isinstance(whole, dict) or not made.is_dir():
        return []
    return [
        name
        for name, digest in contents(made).items()
        if not any(word in GROWS or PARTIAL in word for word in name.split("/"))
        and whole.get(name) != digest
    ]


def leftovers(folder: Path) -> list[str]:
    """Partial files and folders anywhere in the place."""
    return [str(path) for path in (folder / PLACE).rglob(f"*{PARTIAL}*")]


def fault(error: str) -> str:
    """What is wrong with what a refused script wrote to stderr; "" if nothing: one
    line of error beside those of progress."""
    lines = [x for x in error.splitlines() if x and not re.match(r"[\w ]+: +\d+%", x)]
    if len(lines) == 1 and lines[0].startswith("error: "):
        return ""
    return " / ".join(lines[-3:]) or "said nothing"


def _trained(run: Path) -> tuple[list[bytes], list[dict]]:
    """The state that a training ended with, and its log without the seconds."""
    config = cli.start_trained(flags.trained("").parse_args(["--run", str(run)]))
    state = load_trained(config, parallel.data_mesh(jax.device_count()))[1]
    log = run_folder.read_log(run)
    rows = [{k: v for k, v in row.items() if k != "seconds"} for row in log]
    return [np.asarray(leaf).tobytes() for leaf in jax.tree.leaves(state)], rows
