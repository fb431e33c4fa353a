# SPDX-License-Identifier: Apache-2.0
"""From a script's flags to its configuration and its scene."""

import argparse
from pathlib import Path

from internal import parallel
from internal.configs import Config
from internal.errors import UserError
from internal.prepare import depths
from internal.scene.scene import Scene, load_scene
from internal.training import run_folder


def start_training(flags: argparse.Namespace) -> Config:
    """The configuration of a script that may run as several processes; joins them and
    prints the devices it uses."""
    config = run_folder.config_to_train(flags.gin_configs, flags.gin_bindings)
    parallel.initialize(flags.coordinator, flags.num_processes, flags.process_id)
    print(parallel.describe_devices(), flush=True)
    return config


def start_trained(flags: argparse.Namespace) -> Config:
    """The configuration of a script that uses a trained run: the run's own, with what
    the flags state of it that may differ. Prints the devices it uses.

    Raises:
        UserError: no run is named, there is none, or what is stated differs from what
            it was trained with.
    """
    config = run_folder.config_of_run(flags.gin_configs, flags.gin_bindings)
    print(parallel.describe_devices(), flush=True)
    return config


def load_split(config: Config, split: str) -> Scene:
    """The configured scene's ``train`` or ``test`` views."""
    if not config.data_dir:
        raise UserError("no scene is named; give its folder: --scene scenes/night")
    folders = [Path(config.data_dir)]
    if config.checkpoint_dir:
        folders.append(Path(config.checkpoint_dir))
    return load_scene(config, split, depths.find_points, folders)
