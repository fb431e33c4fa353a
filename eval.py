# SPDX-License-Identifier: Apache-2.0
"""Renders and scores the test views of a trained model.

python eval.py --run outputs/night

Writes the folder eval/ of the run: pictures in a folder per output (enhanced/, dark/,
v/, ...), metrics.json and index.html. evidence/ tells by false colours what the photos
saw and what is guessed.
"""

from internal import flags, script

if __name__ == "__main__":  # before the imports below, which take seconds
    script.begin(flags.trained(__doc__))

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import jax
import numpy as np

from internal import cli, parallel, progress
from internal.configs import ModelConfig
from internal.files import atomic, image_io
from internal.files.listing import flat_pngs
from internal.pages import pages, parts, scores, tables
from internal.rendering import evidence
from internal.rendering.pictures import Picture, display_for, pictures
from internal.rendering.renderer import Renderer
from internal.scene.masks import hatched
from internal.scene.scene import Scene
from internal.scoring import evaluation
from internal.training import run_folder
from internal.training.checkpoints import load_trained


def main(argv: Sequence[str]) -> int:
    """Evaluates the newest checkpoint."""
    config = cli.start_trained(flags.trained(__doc__).parse_args(argv))
    mesh = parallel.data_mesh(jax.device_count())
    model, state = load_trained(config, mesh)
    scene = cli.load_split(config, "test")
    run = Path(config.checkpoint_dir)
    run_folder.check_same_scene(run, scene.identity)
    renderer = Renderer(model, scene.cameras, scene.space, mesh, config.render.chunk)
    witnesses = evidence.call_witnesses(
        cli.load_split(config, "train"),
        config.factor,
        lambda camera: renderer.picture(state.params, camera),
    )

    folder, files = run / "eval", flat_pngs(scene.view_names)
    display = None
    views: dict[str, evaluation.Scores] = {}
    written: dict[str, list[tuple[str, str]]] = {}  # per output: file, view
    track = progress.track(scene.view_names, len(files), "evaluating", "view")
    for index, name in enumerate(track):
        gain = scene.gains[index]
        light = evaluation.light_of_photo(gain)
        rendering = renderer.view(state.params, index, light)
        rendering = evaluation.as_photographed(rendering, gain)
        display = display or display_for(config.model, rendering)
        mask = scene.mask(index)
        baselines = evaluation.brightened(np.asarray(rendering.rgb), mask)
        if mask.any():
            photos = scene.photo(index), scene.true_photo(index)
            views[name] = evaluation.score_view(rendering, baselines, *photos, mask)
        camtoworld = np.asarray(scene.cameras.camtoworlds[index], np.float64)
        found = witnesses.testify(scene.lenses[index], camtoworld, rendering)
        shown = {
            **pictures(rendering, display),
            evidence.EVIDENCE: evidence.false_colors(found),
            **{n: x for n, x in baselines.items() if n != "unchanged"},  # it is "dark"
            **shown_photos(scene, index),
        }
        for output, path in write_pictures(folder, files[index], shown).items():
            written.setdefault(output, []).append((path, name))

    mean, step = evaluation.mean_scores(views), int(state.step)
    scored = {"step": step, "masked": scene.masked, "views": views, "mean": mean}
    atomic.write_text(folder / "metrics.json", json.dumps(scored, indent=2) + "\n")
    table = scores.score_table(mean, scores.heading(len(files), len(scene.truth)))
    write_page(folder, scene, step, table, written, config.model)
    print(f"{tables.as_markdown(table)}\n{folder / 'index.html'}")
    return 0


def shown_photos(scene: Scene, view: int) -> dict[str, Picture]:
    """The dark photo of a view and its truth as the page shows them, if there."""
    photos = {"input": scene.photo(view), "truth": scene.true_photo(view)}
    mask = scene.mask(view)
    return {name: hatched(x, mask) for name, x in photos.items() if x is not None}


def write_pictures(
    folder: Path, file: str, shown: Mapping[str, Picture]
) -> dict[str, str]:
    """Writes a view's pictures; each one's path below ``folder``, by output."""
    for output, picture in shown.items():
        atomic.ensure_folder(folder / output)
        image_io.write(folder / output / file, picture)
    return {output: f"{output}/{file}" for output in shown}


def write_page(
    folder: Path,
    scene: Scene,
    step: int,
    table: pages.Table,
    written: Mapping[str, Sequence[tuple[str, str]]],
    model: ModelConfig,
) -> None:
    """Writes index.html: the outputs side by side, the scores, each output."""
    explained = parts.explained_pictures(model)
    exposed = "" if np.all(scene.gains == 1.0) else ", each in its photo's exposure"
    pages.write_index(
        folder,
        f"{scene.name}: test views at step {step}",
        f"Views that training never saw, rendered by the trained model{exposed}."
        + parts.about_masks(scene.masked, len(scene.view_names)),
        [
            parts.compare_outputs(
                written, "enhanced" if "enhanced" in written else "dark"
            ),
            table,
            parts.evidence_legend(),
            *(
                pages.Section(output, explained[output], tuple(media))
                for output, media in written.items()
            ),
            *parts.training_parts(folder.parent),
        ],
    )


if __name__ == "__main__":
    script.run(main)
