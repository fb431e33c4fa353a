# SPDX-License-Identifier: Apache-2.0
"""Trains a model on a scene of dark photos.

python train.py --gin_configs=configs/llnerf_best.gin \
    --scene scenes/night --run outputs/night

The same command goes on where an earlier one stopped. Several processes or hosts: the
same command on each, with --coordinator, --num_processes and --process_id.
"""

from internal import flags, script

if __name__ == "__main__":  # before the imports below, which take seconds
    script.begin(flags.train(__doc__))

from collections.abc import Sequence
from pathlib import Path

import jax

from internal import cli, parallel, progress
from internal.configs import Config
from internal.models import Model
from internal.scene import noise
from internal.scene.scene import Scene
from internal.training import budget, exposure, run_folder
from internal.training.checkpoints import Checkpoints
from internal.training.preview import Preview
from internal.training.run_folder import RunLog
from internal.training.sampler import find_chances, neighbors_of
from internal.training.step import (
    bar_line,
    check_finite,
    compiled_step,
    initial_state,
    log_numbers,
)


def main(argv: Sequence[str]) -> int:
    """Trains until ``Train.max_steps`` or a signal; resumes what it finds."""
    config = cli.start_training(flags.train(__doc__).parse_args(argv))
    scene = cli.load_split(config, "train")
    with run_folder.claimed(config) as folder:
        return train(exposure.metered(config, scene), scene, folder)


def train(config: Config, scene: Scene, folder: Path) -> int:
    """Trains in a run folder that nobody else uses; the exit code."""
    # A schedule that fits the time there is.
    mesh = parallel.data_mesh(config.train.batch_size)
    model = Model(config.model)
    own, log = run_folder.own_config(folder), run_folder.read_log(folder)
    chances = find_chances(scene, config)
    config = budget.fit_schedule(
        config, own, log, lambda: budget.time_steps(config, scene, model, mesh, chances)
    )
    train = config.train

    # The state, where an earlier run left it or new.
    run_folder.open_run(config, scene.identity)
    checkpoints = Checkpoints(folder, train.checkpoints_kept)
    if checkpoints.latest_step() is None:
        state = parallel.replicate(initial_state(config, model), mesh)
    else:
        like = jax.eval_shape(lambda: initial_state(config, model))
        state = checkpoints.restore(like, mesh)
    start = int(state.step)
    print(f"run folder: {folder}, from step {start} to {train.max_steps}", flush=True)
    if config.losses.observation == "noisy" and parallel.is_writer():
        noise.record(folder, scene.noise)

    # The loop. A step that is not finite keeps the state before it.
    take_step = compiled_step(config, model, scene, mesh, chances)
    preview = Preview(model, scene, mesh, config.render.chunk)
    rays = train.batch_size * (neighbors_of(config) + 1)
    stats = None
    with (
        script.Interruption() as interruption,
        checkpoints,
        RunLog(folder, start) as log,
        progress.bar(train.max_steps, "training", "step", initial=start) as bar,
    ):
        for step in range(start + 1, train.max_steps + 1):
            check_finite(stats, step - 1)  # the step before: devices stay busy
            state, stats = take_step(state, step - 1)
            bar.update()
            last = step == train.max_steps or parallel.agreed_to_stop(
                bool(interruption), step, train.log_every
            )
            if last or step % train.log_every == 0:
                check_finite(stats, step)
                numbers = log_numbers(stats)
                bar.set_postfix_str(bar_line(numbers, bar, rays))
                log.scalars(step, numbers)
            if last or step % train.preview_every == 0:
                preview.write(log, step, state.params)
            if last or step % train.checkpoint_every == 0:
                checkpoints.save(state)
            if last:
                break
    print(f"step {int(state.step)} is saved in {checkpoints.folder}")
    if int(state.step) >= train.max_steps:
        print(f"next: {script.command_line('eval.py', '--run', folder)}")
    return interruption.exit_code


if __name__ == "__main__":
    script.run(main)
