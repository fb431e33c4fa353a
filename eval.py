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
from collections.abc import Sequence
from pathlib import Path

import jax
import numpy as np

from internal import cli, parallel, progress
from internal.color import from_uint16
from internal.files import atomic, image_io
from internal.files.listing import flat_pngs
from internal.pages import pages, report, scores, tables
from internal.rendering import evidence
from internal.rendering.pictures import display_for, pictures
from internal.rendering.renderer import Renderer
from internal.scene.masks import hatched
from internal.scoring import evaluation
from internal.training import run_folder
from internal.training.checkpoints import load_trained


def main(argv: Sequence[str]) -> int:
    """Evaluates the newest checkpoint."""
    config = cli.start_trained(flags.trained(__doc__).parse_args(argv))
    mesh = parallel.data_mesh(jax.device_count())
    model, state = load_trained(config, mesh)
    scene = cli.load_split(config, "test")
    run_folder.check_scene(Path(config.checkpoint_dir), scene.identity)
    renderer = Renderer(model, scene.cameras, scene.space, mesh, config.render.chunk)
    witnesses = evidence.call_witnesses(
        cli.load_split(config, "train"),
        config.factor,
        lambda camera: renderer.picture(state.params, camera),
    )
    folder = Path(config.checkpoint_dir) / "eval"

    explained = {
        **evidence.explained_outputs(config.model),
        **{name: text for name, (_, text) in evaluation.BASELINES.items()},
        "input": "the dark photo",
        "truth": "the normal-light photo",
    }
    display = None
    views: dict[str, evaluation.Scores] = {}
    written: dict[str, list[tuple[str, str]]] = {}
    names = scene.view_names
    files = flat_pngs(names)
    for index, name in enumerate(
        progress.track(names, len(names), "evaluating", "view")
    ):
        rendering = renderer.view(state.params, index)
        display = display or display_for(config.model, rendering)
        dark = from_uint16(scene.images[index]) if scene.images else None
        truth = from_uint16(scene.truth[index]) if index in scene.truth else None
        mask = scene.mask(index)
        baselines = evaluation.brightened(rendering.rgb, mask)
        if mask.any():
            gain = scene.gains[index]
            views[name] = evaluation.score_view(
                rendering, baselines, dark, truth, gain, mask
            )
        camtoworld = np.asarray(scene.cameras.camtoworlds[index], np.float64)
        found = witnesses.testify(scene.lenses[index], camtoworld, rendering)
        shown = {
            **pictures(rendering, display),
            evidence.EVIDENCE: evidence.false_colors(found),
            **baselines,
        }
        del shown["unchanged"]  # the picture "dark"
        if dark is not None:
            shown["input"] = hatched(dark, mask)
        if truth is not None:
            shown["truth"] = hatched(truth, mask)
        for output, picture in shown.items():
            path = Path(output) / files[index]
            atomic.ensure_folder(folder / output)
            image_io.write(folder / path, picture)
            written.setdefault(output, []).append((path.as_posix(), name))

    mean = evaluation.mean_scores(views)
    scored = {"masked": scene.masked, "views": views, "mean": mean}
    result = {"step": int(state.step), **scored}
    atomic.write_text(folder / "metrics.json", json.dumps(result, indent=2) + "\n")
    table = scores.score_table(mean, scores.heading(len(names), len(scene.truth)))
    pages.write_index(
        folder,
        f"{scene.name}: test views at step {int(state.step)}",
        "Views that training never saw, rendered by the trained model."
        + report.about_masks(scene.masked, len(names)),
        [
            report.compare_outputs(
                written, "enhanced" if "enhanced" in written else "dark"
            ),
            table,
            report.evidence_legend(),
            *(
                pages.Section(output, explained[output], tuple(media))
                for output, media in written.items()
            ),
            *report.training_parts(folder.parent),
        ],
    )
    print(f"{tables.as_text(table)}\n{folder / 'index.html'}")
    return 0


if __name__ == "__main__":
    script.run(main)
