# SPDX-License-Identifier: Apache-2.0
"""The command lines of all scripts that train, use or make a scene.

They stand here and not in the scripts because nothing here takes time to import. The
defaults of a capture and an export stand beside what they set: a flag of theirs that
is not given is left out of the result, or None.
"""

import argparse
import ast
import contextlib
import os
from collections.abc import Sequence
from pathlib import Path

from internal.errors import UserError

DOCUMENTED = argparse.RawDescriptionHelpFormatter
METHODS = Path(__file__).parents[1] / "configs" / "methods"


def train(text: str | None) -> argparse.ArgumentParser:
    """train.py: a configuration, a scene, a run folder, and several processes."""
    parser = _to_train(text)
    parser.add_argument(
        "--coordinator",
        default="",
        metavar="HOST:PORT",
        help="address of process 0, when there are several",
    )
    parser.add_argument("--num_processes", type=int, default=1)
    parser.add_argument("--process_id", type=int, default=0)
    return parser


def trained(text: str | None) -> argparse.ArgumentParser:
    """eval.py, render.py: a run, and bindings that may differ from its own."""
    parser = argparse.ArgumentParser(description=text, formatter_class=DOCUMENTED)
    parser.set_defaults(trained=True)
    add_run(parser)
    add_scene(parser)
    add_configuration(parser)
    return parser


def view(text: str | None) -> argparse.ArgumentParser:
    """view.py: a run, and where to listen."""
    parser = trained(text)
    parser.add_argument(
        "--host", default="127.0.0.1", help="0.0.0.0 lets other computers in"
    )
    parser.add_argument("--port", type=int, default=8080)
    walk = parser.add_mutually_exclusive_group()
    walk.add_argument(
        "--splats", type=positive_int, default=30_000, metavar="N",
        help="bake at most N to walk on, unless export.py did; 30000 if not given",
    )  # fmt: skip
    walk.add_argument(
        "--no_splats", action="store_true", help="walk on pictures of the field alone"
    )
    return parser


def export(text: str | None) -> argparse.ArgumentParser:
    """export.py: a run, and how much detail to export."""
    parser = trained(text)
    some = positive_int
    parser.add_argument("--points", type=some, metavar="N", help="of the cloud, about")
    parser.add_argument(
        "--resolution", type=some, metavar="N", help="cells along the longest side"
    )
    parser.add_argument(
        "--splats", type=some, metavar="N", help="bake at most N Gaussian splats too"
    )
    parser.add_argument(
        "--look",
        choices=("enhanced", "dark", "both"),
        help="of the splats, enhanced if not given; both: splats.* and splats_dark.*",
    )
    parser.add_argument(
        "--overwrite", action="store_true", help="replace an export made before"
    )
    return parser


def sweep(text: str | None) -> argparse.ArgumentParser:
    """sweep.py: what train.py takes, and variants of it."""
    parser = _to_train(text)
    parser.add_argument("--variants", nargs="*", default=[], metavar="VARIANT")
    add_place(parser)
    return parser


def compare(text: str | None) -> argparse.ArgumentParser:
    """compare.py: scenes, methods and where results go."""
    parser = argparse.ArgumentParser(description=text, formatter_class=DOCUMENTED)
    parser.add_argument("scenes", type=Path, nargs="+", help="folders of scenes")
    parser.add_argument("--out", type=Path, required=True, help="folder of the results")
    parser.add_argument(
        "--methods", type=Path, nargs="+", metavar="LIST",
        default=[METHODS / "photos.toml", METHODS / "models.toml"],
        help="lists of methods; photos.toml and models.toml of configs/methods if none",
    )  # fmt: skip
    add_bindings(parser)
    add_place(parser)
    return parser


def figures(text: str | None) -> argparse.ArgumentParser:
    """figures.py: what to show of a comparison."""
    parser = argparse.ArgumentParser(description=text, formatter_class=DOCUMENTED)
    parser.add_argument("out", type=Path, help="the folder that compare.py wrote")
    parser.add_argument("--scene", default="", help="all scenes if left out")
    parser.add_argument(
        "--methods", nargs="+", default=[], metavar="ROW", help="all if left out"
    )
    parser.add_argument("--view", default="", help="a test view; else the first")
    parser.add_argument(
        "--crop", type=int, nargs=4, action="append", default=[],
        metavar=("X", "Y", "WIDTH", "HEIGHT"), help="detail to enlarge, in pixels",
    )  # fmt: skip
    parser.add_argument("--columns", type=int, default=4, help="pictures in a row")
    parser.add_argument(
        "--renderings-only", action="store_true", help="no photos, no truth"
    )
    return parser


def demo(text: str | None) -> argparse.ArgumentParser:
    """demo.py: nothing to choose."""
    return argparse.ArgumentParser(description=text, formatter_class=DOCUMENTED)


def study(text: str | None) -> argparse.ArgumentParser:
    """study.py: a page to make, or answers to draw."""
    parser = argparse.ArgumentParser(description=text, formatter_class=DOCUMENTED)
    commands = parser.add_subparsers(dest="command", required=True)
    make = commands.add_parser("make", help="a page that shows pairs of pictures")
    make.add_argument("out", type=Path, help="folder to make")
    make.add_argument("methods", nargs="+", metavar="NAME=FOLDER")
    make.add_argument("--views", type=int, default=10, help="at random; 0: all")
    make.add_argument("--seed", type=int, default=0, help="of the choice of views")
    make.add_argument("--overwrite", action="store_true")
    chart = commands.add_parser("chart", help="the bar chart of downloaded answers")
    chart.add_argument("out", type=Path, help="folder to write to")
    chart.add_argument("answers", nargs="+", type=Path, metavar="CSV")
    return parser


def make_scene(text: str | None) -> argparse.ArgumentParser:
    """make_scene.py: a still life to render, or a dataset to darken."""
    parser = argparse.ArgumentParser(description=text, formatter_class=DOCUMENTED)
    commands = parser.add_subparsers(dest="command", required=True)
    night = commands.add_parser(
        "night",
        help="a synthetic still life, rendered",
        argument_default=argparse.SUPPRESS,
    )
    night.add_argument("--views", type=positive_int, default=30)
    night.add_argument("--width", type=positive_int, default=160, help="pixels")
    night.add_argument("--height", type=positive_int, default=120, help="pixels")
    dark = commands.add_parser(
        "darken",
        help="a normal-light dataset, darkened",
        argument_default=argparse.SUPPRESS,
    )
    dark.add_argument("data_dir", type=Path, help="dataset with its pose files")
    dark.add_argument("--images", default="", help="folder of its pictures to take")
    dark.add_argument(
        "--jpeg", type=int, default=0, metavar="QUALITY",
        help="1 to 100, of a JPEG that the dark pictures go through; 0 for none",
    )  # fmt: skip
    for command in (night, dark):
        _add_capture(command)
    return parser


def _to_train(text: str | None) -> argparse.ArgumentParser:
    """What trains takes: a configuration, a scene, and the folder of a run."""
    parser = argparse.ArgumentParser(description=text, formatter_class=DOCUMENTED)
    add_configuration(parser)
    add_scene(parser)
    add_run(parser)
    return parser


def _add_capture(parser: argparse.ArgumentParser) -> None:
    """What a ``CaptureModel`` is made of, and where the scene goes."""
    parser.add_argument("out", type=Path, help="folder to make")
    parser.add_argument("--exposure", type=float, help="1 is normal light")
    parser.add_argument(
        "--full-well", type=float,
        help="photo-electrons at white, fewer are noisier; inf for no noise",
    )  # fmt: skip
    parser.add_argument("--read-noise", type=float, help="electrons")
    parser.add_argument(
        "--gains", type=float, nargs=3, action=_Tuple, dest="channel_gains",
        metavar=("R", "G", "B"), help="colour cast",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, help="of the noise")
    parser.add_argument(
        "--overwrite", action="store_true", default=False,
        help="replace a scene made before",
    )  # fmt: skip


def prepare(text: str | None) -> argparse.ArgumentParser:
    """prepare.py: photos to make a scene of, or a scene to check."""
    parser = argparse.ArgumentParser(description=text, formatter_class=DOCUMENTED)
    parser.add_argument("photos", type=Path, nargs="?", help="folder or video")
    parser.add_argument("scene", type=Path, nargs="?", help="folder to make")
    parser.add_argument(
        "--pose-images", type=Path, help="bright twins of the photos, used for poses"
    )
    parser.add_argument(
        "--gt", type=Path, help="normal-light twins of the photos, for scores"
    )
    parser.add_argument(
        "--keep-blurred", action="store_true",
        help="leave no photo out that is blurred against others of the same things",
    )  # fmt: skip
    parser.add_argument(
        "--overwrite", action="store_true", help="start again over a scene made before"
    )
    parser.add_argument("--check", type=Path, metavar="SCENE", help="check a scene")
    parser.add_argument(
        "--reference", type=Path, help="scene of the same photos to compare poses with"
    )
    parser.add_argument(
        "--report", type=Path, help="with --check: folder for the page (SCENE/report)"
    )
    return parser


def add_configuration(parser: argparse.ArgumentParser) -> None:
    """``--gin_configs`` and ``--gin_bindings``, each as often as wanted."""
    parser.add_argument(
        "--gin_configs", action="append", default=[], metavar="FILE", help="gin file"
    )
    add_bindings(parser)


def add_bindings(parser: argparse.ArgumentParser) -> None:
    """``--gin_bindings``, as often as wanted."""
    parser.add_argument(
        "--gin_bindings",
        action="append",
        default=[],
        metavar="BINDING",
        help='for example "Render.exposure = 0.5"',
    )


def add_place(parser: argparse.ArgumentParser) -> None:
    """``--jobs`` or ``--cluster``: where many trainings run."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--jobs", type=positive_int, default=1, metavar="N",
        help="trainings at a time here, which share the cores and GPUs",
    )  # fmt: skip
    where.add_argument(
        "--cluster", choices=("slurm",), help="each training a job of the cluster"
    )
    parser.add_argument(
        "--cluster_options", nargs="+", default=[], metavar="KEY=VALUE",
        help="such as partition=gpu time=60 (minutes) gpus_per_node=1 account=lab",
    )  # fmt: skip


def add_scene(parser: argparse.ArgumentParser) -> None:
    """``--scene``, which is short for a binding of ``Config.data_dir``."""
    _add_folder(parser, "--scene", "Config.data_dir", "of photos with their poses")


def add_run(parser: argparse.ArgumentParser) -> None:
    """``--run``, which is short for a binding of ``Config.checkpoint_dir``."""
    _add_folder(parser, "--run", "Config.checkpoint_dir", "of the training's results")


def _add_folder(
    parser: argparse.ArgumentParser, flag: str, name: str, text: str
) -> None:
    parser.add_argument(
        flag,
        dest="gin_bindings",
        action="append",
        default=[],
        type=lambda folder: f"{name} = {str(Path(folder).expanduser())!r}",
        metavar="FOLDER",
        help=f"{text}; short for {name}",
    )


def check_named(args: argparse.Namespace) -> None:
    """Looks for what flags name before anything that takes time is imported.

    Raises:
        UserError: a gin file, a scene's folder or a trained run's is not there.
    """
    for file in getattr(args, "gin_configs", ()):
        check_gin_file(file)
    bindings = getattr(args, "gin_bindings", ())
    scene = _bound_text("Config.data_dir", bindings)
    if scene:
        check_folder(Path(scene))
    run = _bound_text("Config.checkpoint_dir", bindings)
    if run and getattr(args, "trained", False) and not os.path.isdir(run):
        raise no_checkpoint(run)


def check_gin_file(file: str) -> None:
    """Raises a UserError for a gin file that is not there."""
    if not os.path.isfile(file):
        raise UserError(f"{file}: no such gin file; see configs/")


def check_folder(folder: Path) -> None:
    """Raises a UserError for a scene that is not there."""
    if os.path.isfile(folder):
        raise UserError(
            f"{folder}: a file; expected the folder of a scene: name the one it is in"
        )
    if not os.path.isdir(folder):
        raise UserError(f"{folder}: scene folder not found; check Config.data_dir")


def no_checkpoint(run: str | Path) -> UserError:
    """The error of a run that nobody trained."""
    return UserError(f"{run}: holds no checkpoint; train first, or correct --run")


def _bound_text(name: str, bindings: Sequence[str]) -> str:
    """The plain text that bindings give a name, the last one counts; "" if none."""
    found = ""
    for binding in bindings:
        stated, _, value = binding.partition("=")
        if stated.strip() == name:
            with contextlib.suppress(ValueError, SyntaxError):
                found = str(ast.literal_eval(value.strip()))
    return found


class _Tuple(argparse.Action):
    """Stores several values as a tuple: what is frozen has no lists."""

    def __call__(self, parser, namespace, values, option_string=None):
        setattr(namespace, self.dest, tuple(values or ()))


def positive_int(text: str) -> int:
    """A whole number above 0, as argparse converts."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number above 0")
    return int(text)
