# SPDX-License-Identifier: Apache-2.0
"""What the scripts share: flags, friendly errors, clean interruption."""

import argparse
import os
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType

from internal import configs, parallel
from internal.configs import Config
from internal.errors import Diverged, UserError
from internal.scene.scene import Scene, load_scene

USER_ERROR_EXIT = 2
FAILURE_EXIT = 1  # what nobody can fix beforehand, such as a loss that diverges


def run_script(main: Callable[[Sequence[str]], int]) -> None:
    """Runs ``main(argv)`` and exits: one line and code 2 for a ``UserError``."""
    try:
        code = main(sys.argv[1:])
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        code = USER_ERROR_EXIT
    except Diverged as error:
        print(f"error: {error}", file=sys.stderr)
        code = FAILURE_EXIT
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        code = 128 + signal.SIGINT
    sys.stdout.flush()
    sys.exit(code)


def add_gin_flags(parser: argparse.ArgumentParser) -> None:
    """``--gin_configs`` and ``--gin_bindings``, each as often as wanted."""
    parser.add_argument(
        "--gin_configs", action="append", default=[], metavar="FILE", help="gin file"
    )
    add_bindings_flag(parser)


def add_bindings_flag(parser: argparse.ArgumentParser) -> None:
    """``--gin_bindings``, as often as wanted."""
    parser.add_argument(
        "--gin_bindings",
        action="append",
        default=[],
        metavar="BINDING",
        help="for example \"Config.data_dir = 'scenes/night'\"",
    )


def parse_config(description: str, argv: Sequence[str]) -> Config:
    """The configuration of a single-process script; prints the devices it uses."""
    return parse_flags(argparse.ArgumentParser(description=description), argv)[0]


def parse_flags(
    parser: argparse.ArgumentParser, argv: Sequence[str]
) -> tuple[Config, argparse.Namespace]:
    """Like ``parse_config``, for a script with flags of its own."""
    add_gin_flags(parser)
    flags = parser.parse_args(argv)
    config = configs.load_config(flags.gin_configs, flags.gin_bindings)
    print(parallel.describe_devices(), flush=True)
    return config, flags


def parse_parallel_config(description: str, argv: Sequence[str]) -> Config:
    """Like ``parse_config``, for a script that may run as several processes."""
    parser = argparse.ArgumentParser(description=description)
    add_gin_flags(parser)
    parser.add_argument(
        "--coordinator",
        default="",
        metavar="HOST:PORT",
        help="address of process 0, when there are several",
    )
    parser.add_argument("--num_processes", type=int, default=1)
    parser.add_argument("--process_id", type=int, default=0)
    flags = parser.parse_args(argv)
    config = configs.load_config(flags.gin_configs, flags.gin_bindings)
    parallel.initialize(flags.coordinator, flags.num_processes, flags.process_id)
    print(parallel.describe_devices(), flush=True)
    return config


def load_split(config: Config, split: str) -> Scene:
    """The configured scene's ``train`` or ``test`` views."""
    if not config.data_dir:
        raise UserError(
            "Config.data_dir is empty; name the scene's folder: "
            "--gin_bindings=\"Config.data_dir = 'scenes/night'\""
        )
    return load_scene(
        Path(config.data_dir),
        split=split,
        dataset_loader=config.dataset_loader,
        factor=config.factor,
        images_dir=config.images_dir,
        gt_dir=config.gt_dir,
        near=config.near,
        far=config.far,
        projection=config.projection,
        end_at_far=config.end_at_far,
        holdout=config.holdout,
        photo_gains=config.photo_gains,
        unrounded=config.unrounded,
        max_image_memory=config.max_image_memory,
    )


class Interruption:
    """Notices Ctrl-C and SIGTERM while it is entered, so that the loop can save and
    leave. A second signal leaves at once."""

    def __init__(self) -> None:
        self.signal = 0

    def __enter__(self) -> "Interruption":
        numbers = (signal.SIGINT, signal.SIGTERM)
        self._before = {n: signal.signal(n, self._notice) for n in numbers}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __bool__(self) -> bool:
        return self.signal != 0

    @property
    def exit_code(self) -> int:
        """What a shell expects of a process ended by that signal; 0 without one."""
        return 128 + self.signal if self.signal else 0

    def _notice(self, number: int, frame: FrameType | None) -> None:
        if self.signal:
            os._exit(128 + number)
        self.signal = number
