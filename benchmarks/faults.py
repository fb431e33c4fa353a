# SPDX-License-Identifier: Apache-2.0
"""Breaks scenes and runs: does each load right, or say in one line what is wrong?

python -m benchmarks.faults [--cases 2000] [--runs 200] [--seed 0] [--keep FOLDER]

A tiny scene of every format, or the folder of a tiny training, is copied, one thing in
it is broken (bytes of a file, a value of its JSON, the file itself), and it is loaded
in a process that is given ``SECONDS``. Prints a row per format and a line per fault of
ours, and exits with 1 if there is any: a traceback, a hang, an error of several lines
or one that names no file, a view that shows another photo than its name says or a
parameter that was not trained, a view lost without a word.
"""

import argparse
import contextlib
import dataclasses
import io
import itertools
import json
import multiprocessing
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import jax
import numpy as np

from benchmarks.workload import markdown
from internal import cli, flags, parallel
from internal.errors import UserError
from internal.scene.config import SceneConfig
from internal.scene.pairing import match_by_name
from internal.scene.scene import SPLITS, load_scene
from internal.training.checkpoints import load_trained
from tests import scene_writers as writers

SECONDS = 60.0  # a scene of six tiny photos loads in a few hundredths of one
TINY = (
    *("Train.max_steps = 4", "Train.enhance_start = 2", "Train.checkpoint_every = 2"),
    *("Train.batch_size = 8", "Model.num_samples = (4, 4)", "MLP.depth = 2"),
    *("MLP.width = 8", "Model.head_width = 8", "Gamma.width = 8"),
)
ODD_VALUES: tuple[Any, ...] = (
    None, True, "", "text", "../..", [], {}, [[]], 0, -1, 1e-320, 1e308, 10**400,
    float("nan"), float("inf"), "nan", [1, 2], {"a": 1}, "\u0000",
)  # fmt: skip
OUTCOMES = ("loaded", "refused", "traceback", "hang", "unclear", "wrong", "lost")
FAULTS = OUTCOMES[2:]


@dataclasses.dataclass(frozen=True)
class Loaded:
    """What loading a folder came to."""

    error: str  # "" if it loaded
    is_user_error: bool
    printed: str
    values: dict[str, float]  # mean of each view's photo, or of each parameter


@dataclasses.dataclass(frozen=True)
class Case:
    """A broken scene or run."""

    number: int
    format: str
    file: str  # that was broken, in its folder
    change: str


Judged = tuple[Case, str, str]  # its outcome and what shows it


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=2000)
    parser.add_argument("--runs", type=int, default=200, help="cases of run folders")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="folder for the scenes with faults")
    args = parser.parse_args()
    counts: dict[str, Counter[str]] = {}
    scenes = broken_scenes(args.cases, args.seed, args.keep)
    runs = broken_runs(args.runs, args.seed, args.keep)
    for case, outcome, said in itertools.chain(scenes, runs):
        counts.setdefault(case.format, Counter())[outcome] += 1
        if outcome in FAULTS:
            print(f"{outcome}: {case}: {said}", flush=True)
    rows = [(name, *(own[x] for x in OUTCOMES)) for name, own in counts.items()]
    print(markdown(("format", *OUTCOMES), rows))
    return int(any(own[x] for own in counts.values() for x in FAULTS))


def broken_scenes(cases: int, seed: int, keep: Path | None = None) -> Iterator[Judged]:
    """Every case of a scene with its outcome and what the program said of it."""
    with tempfile.TemporaryDirectory() as name:
        for kind, write in FORMATS.items():
            write(Path(name) / kind)
        yield from campaign(Path(name), load_views, cases, seed, keep)


def broken_runs(cases: int, seed: int, keep: Path | None = None) -> Iterator[Judged]:
    """Likewise of the folder of a training."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        writers.write_blender(folder / "scenes/blender", writers.facing_world())
        whole = ["--scene", folder / "scenes/blender", "--run", folder / "runs/run"]
        own = [f"--gin_bindings={setting}" for setting in TINY]
        command = [sys.executable, "train.py", *own, *map(str, whole)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        yield from campaign(folder / "runs", load_parameters, cases, seed, keep)


def campaign(
    folder: Path,
    load: Callable[[Path], dict[str, float]],
    cases: int,
    seed: int,
    keep: Path | None,
) -> Iterator[Judged]:
    """Copies and breaks what lies in a folder, ``cases`` times, and loads it."""
    kinds = sorted(x.name for x in folder.iterdir())
    with Loader(load) as loader, tempfile.TemporaryDirectory() as name:
        whole = {kind: loader.load(folder / kind) for kind in kinds}
        for number in range(cases):
            rng = random.Random(f"{seed} {number}")
            kind = rng.choice(kinds)
            copy = Path(name) / str(number)  # what is said of a folder is said once
            shutil.copytree(folder / kind, copy)
            file = rng.choice(files_to_break(copy))
            case = Case(number, kind, file, break_file(copy / file, rng))
            outcome, said = judged(case, whole[kind], loader.load(copy), copy)
            if keep and outcome in FAULTS:
                shutil.copytree(copy, keep / f"{kind} {number}", symlinks=True)
            shutil.rmtree(copy)
            yield case, outcome, said


def judged(
    case: Case, whole: Loaded | None, broken: Loaded | None, folder: Path
) -> tuple[str, str]:
    """The outcome of a case and what shows it."""
    assert whole is not None and not whole.error, whole
    if broken is None:
        return "hang", f"no answer in {SECONDS:.0f} s"
    if broken.error:
        if not broken.is_user_error:
            return "traceback", broken.error
        one_line = len(broken.error.strip().splitlines()) == 1
        names = str(folder) in broken.error
        return ("refused" if one_line and names else "unclear"), broken.error
    other = {x for x, y in broken.values.items() if whole.values.get(x, y) != y}
    if other:
        return "wrong", f"{sorted(other)} loaded with other values"
    lost = set(whole.values) - set(broken.values)
    lost -= match_by_name(
        list(lost), list(broken.values)
    ).keys()  # there, in another spelling
    told = any(word in broken.printed for word in ("warning", "WARNING", "left out"))
    if lost and not told:
        return "lost", f"{sorted(lost)} of {broken.printed!r}"
    return "loaded", ""


FORMATS: dict[str, Callable[[Path], object]] = {
    "blender": lambda folder: writers.write_blender(folder, writers.facing_world()),
    "nerfstudio": lambda folder: writers.write_nerfstudio(
        folder, writers.surrounding_world(6), near=1.0, far=9.0
    ),
    "llff": lambda folder: writers.write_llff(folder, writers.facing_world()),
    "colmap binary": lambda folder: writers.write_colmap(
        folder, writers.surrounding_world(6)
    ),
    "colmap text": lambda folder: writers.write_colmap(
        folder, writers.facing_world(), binary=False
    ),
}


def files_to_break(folder: Path) -> list[str]:
    """Its files; what is no photo as often as all the photos together."""
    files = [x for x in folder.rglob("*") if x.is_file()]
    names = sorted(str(x.relative_to(folder)) for x in files if x.stat().st_size)
    photos = [name for name in names if name.endswith((".png", ".jpg"))]
    others = [name for name in names if name not in photos]
    return photos + others * max(1, len(photos) // len(others))


def break_file(path: Path, rng: random.Random) -> str:
    """Breaks a file or its place in the folder; what was done, in words."""
    changes = [cut, flip, zero, insert, replace, remove, empty, be_a_folder, dangle]
    if path.suffix == ".json":
        changes = [change_json] * 12 + changes
    if path.suffix == ".txt":
        changes = [change_word] * 8 + changes
    change = rng.choice(changes)
    return f"{change.__name__} {change(path, rng)}"


def cut(path: Path, rng: random.Random) -> int:
    content = path.read_bytes()
    kept = rng.randrange(len(content))
    path.write_bytes(content[:kept])
    return kept


def flip(path: Path, rng: random.Random) -> list[int]:
    content = bytearray(path.read_bytes())
    places = [rng.randrange(len(content)) for _ in range(rng.choice((1, 1, 3, 30)))]
    for place in places:
        content[place] ^= 1 << rng.randrange(8)
    path.write_bytes(content)
    return places


def zero(path: Path, rng: random.Random) -> tuple[int, int]:
    content = bytearray(path.read_bytes())
    start = rng.randrange(len(content))
    end = min(len(content), start + rng.choice((4, 16, 4096)))
    content[start:end] = bytes(end - start)
    path.write_bytes(content)
    return start, end


def insert(path: Path, rng: random.Random) -> int:
    content = path.read_bytes()
    place = rng.randrange(len(content) + 1)
    path.write_bytes(content[:place] + rng.randbytes(8) + content[place:])
    return place


def replace(path: Path, rng: random.Random) -> str:
    """Another kind of file under its name."""
    content = rng.choice((b"GIF89a", b"hello\n", b"PK\x03\x04", b"null", b"{}"))
    path.write_bytes(content)
    return str(content)


def remove(path: Path, rng: random.Random) -> str:
    path.unlink()
    return ""


def empty(path: Path, rng: random.Random) -> str:
    path.write_bytes(b"")
    return ""


def be_a_folder(path: Path, rng: random.Random) -> str:
    path.unlink()
    path.mkdir()
    return ""


def dangle(path: Path, rng: random.Random) -> str:
    path.unlink()
    path.symlink_to(path.parent / "nothing there")
    return ""


def change_json(path: Path, rng: random.Random) -> str:
    """A value anywhere becomes an odd one, or is taken away."""
    content = json.loads(path.read_text())
    parents = list(_containers(content))
    parent = rng.choice(parents)
    keys = list(parent) if isinstance(parent, dict) else list(range(len(parent)))
    key = rng.choice(keys)
    if rng.random() < 0.2:
        del parent[key]
        done = f"without {key}"
    else:
        parent[key] = rng.choice(ODD_VALUES)
        done = f"{key} = {str(parent[key])[:20]!r}"
    path.write_text(json.dumps(content))
    return done


def _containers(content: Any) -> Iterator[Any]:
    """All non-empty lists and objects in parsed JSON."""
    if isinstance(content, dict | list) and content:
        yield content
        for value in content.values() if isinstance(content, dict) else content:
            yield from _containers(value)


def change_word(path: Path, rng: random.Random) -> str:
    """A word of a text file becomes an odd one, or is taken away."""
    lines = [line.split(" ") for line in path.read_text().split("\n")]
    line = rng.choice([x for x in lines if x != [""]])
    place = rng.randrange(len(line))
    if rng.random() < 0.2:
        done = f"without {line.pop(place)}"
    else:
        line[place] = str(rng.choice(ODD_VALUES))[:400]
        done = f"{line[place][:20]!r}"
    path.write_text("\n".join(" ".join(line) for line in lines))
    return done


class Loader:
    """A process that loads folders, replaced when it hangs or dies."""

    def __init__(self, load: Callable[[Path], dict[str, float]]) -> None:
        self._load = load

    def __enter__(self) -> "Loader":
        self._start()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.join()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(
            target=serve, args=(theirs, self._load), daemon=True
        )
        self._process.start()
        theirs.close()
        self._ours.recv()  # its imports are no part of the time that loading may take

    def load(self, folder: Path) -> Loaded | None:
        """None where there was no answer in time."""
        try:
            self._ours.send(folder)
            if self._ours.poll(SECONDS):
                return self._ours.recv()
        except (EOFError, ConnectionError):
            self._process.join()
            self._start()
            return Loaded("the process died", False, "", {})
        self._process.kill()
        self._process.join()
        self._start()
        return None


def serve(connection: Connection, load: Callable[[Path], dict[str, float]]) -> None:
    """Loads folder after folder, until nobody asks."""
    connection.send(None)
    with contextlib.suppress(EOFError):
        while True:
            connection.send(loaded(connection.recv(), load))


def loaded(folder: Path, load: Callable[[Path], dict[str, float]]) -> Loaded:
    """What loading came to, whatever happens in it."""
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            values = load(folder)
    except UserError as error:
        return Loaded(str(error) or "nothing", True, printed.getvalue(), {})
    except BaseException as error:
        return Loaded(f"{type(error).__name__}: {error}", False, "", {})
    return Loaded("", True, printed.getvalue(), values)


def load_views(scene: Path) -> dict[str, float]:
    """The mean of each view's photo, of both splits."""
    values = {}
    for split in SPLITS:
        own = load_scene(SceneConfig(str(scene), holdout=3), split)
        for name, photo in zip(own.view_names, own.images, strict=True):
            values[name] = float(np.mean(photo))
    return values


def load_parameters(run: Path) -> dict[str, float]:
    """The mean of each array of a run's newest state."""
    config = cli.start_trained(flags.trained("").parse_args(["--run", str(run)]))
    state = load_trained(config, parallel.data_mesh(jax.device_count()))[1]
    leaves, _ = jax.tree_util.tree_flatten_with_path(state)
    return {jax.tree_util.keystr(k): float(np.mean(leaf)) for k, leaf in leaves}


if __name__ == "__main__":
    sys.exit(main())
