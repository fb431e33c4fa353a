# SPDX-License-Identifier: Apache-2.0
"""Trains a model on a scene of dark photos.

python train.py --gin_configs=configs/llnerf_best.gin \
    --gin_bindings="Config.data_dir = 'scenes/night'" \
    --gin_bindings="Config.checkpoint_dir = 'outputs/night'"

Several processes or hosts: the same command on each, with --coordinator,
--num_processes and --process_id.
"""

if __name__ == "__main__":  # before the imports: they would happen twice
    from internal import process

    process.restart_tuned()

from collections.abc import Sequence

import jax

from internal import cli, parallel, progress
from internal.models import Model
from internal.scene import noise
from internal.training import budget
from internal.training.checkpoints import Checkpoints
from internal.training.preview import Preview
from internal.training.run_folder import RunLog, open_run
from internal.training.sampler import neighbors_of
from internal.training.step import check_finite, compiled_step, initial_state, summarize


def main(argv: Sequence[str]) -> int:
    """Trains until ``Train.max_steps`` or a signal; resumes what it finds."""
    config = cli.parse_parallel_config("Train on a scene of dark photos.", argv)

    # The scene, and a schedule that fits the time there is.
    scene = cli.load_split(config, "train")
    mesh = parallel.data_mesh(config.train.batch_size)
    model = Model(config.model)
    config = budget.fit(config, lambda: budget.measure(config, scene, model, mesh))
    train = config.train

    # The state, where an earlier run left it or new.
    folder = open_run(config)
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
    take_step = compiled_step(config, model, scene, mesh)
    preview = Preview(model, scene, mesh, config.render.chunk)
    rays = train.batch_size * (neighbors_of(config) + 1)
    stats = None
    with (
        cli.Interruption() as interruption,
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
                numbers = summarize(stats)
                bar.set_postfix_str(progress.describe(numbers, bar, rays))
                log.scalars(step, numbers)
            if last or step % train.preview_every == 0:
                preview.write(log, step, state.params)
            if last or step % train.checkpoint_every == 0:
                checkpoints.save(state)
            if last:
                break
    print(f"step {int(state.step)} is saved in {checkpoints.folder}")
    return interruption.exit_code


if __name__ == "__main__":
    cli.run_script(main)
