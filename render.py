# SPDX-License-Identifier: Apache-2.0
"""Renders a camera path of a trained model to videos, under any light edit.

python render.py --run outputs/night --gin_bindings="Render.exposure = 0.5"

Writes the folder render/PATH of the run. The path is a spiral for views that face one
way, else it goes around the subject among them; "Render.path = 'ellipse'" (spiral,
around, views, or a JSON file) chooses another. The light is bindings too:
"Render.exposure = 0.5" (stops), "Render.temperature = 4000.0" (kelvin),
"Render.strength = 0.7" (0 dark, 1 enhanced), "Render.tint = 0.3" (stops of magenta),
"Render.contrast = 1.2". Run again, it renders what is missing.
"""

from internal import flags, script

if __name__ == "__main__":  # before the imports below, which take seconds
    script.begin(flags.trained(__doc__))

import contextlib
import dataclasses
import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

import jax
import numpy as np

from internal import cli, color, extras, parallel, progress
from internal.cameras import Cameras
from internal.files import atomic, image_io, video
from internal.pages import pages, parts
from internal.rendering.film import Film
from internal.rendering.renderer import Renderer
from internal.rendering.trajectory import path_cameras
from internal.training import run_folder
from internal.training.checkpoints import load_trained


def main(argv: Sequence[str]) -> int:
    """Renders the frames that are missing, then the videos."""
    config = cli.start_trained(flags.trained(__doc__).parse_args(argv))
    config.render.edit()  # a light that cannot be is refused before anything is loaded
    mesh = parallel.data_mesh(jax.device_count())
    model, state = load_trained(config, mesh)
    scene = cli.load_split(config, "train")
    run = Path(config.checkpoint_dir)
    run_folder.check_same_scene(run, scene.identity, scored=False)
    cameras = path_cameras(scene, config.render)
    renderer = Renderer(model, cameras, scene.space, mesh, config.render.chunk)
    film = Film(config, scene, cameras, renderer, state.params)

    folder = run / "render" / Path(config.render.path).stem
    light = dataclasses.asdict(config.render.light())
    settings = {"step": int(state.step), "path": fingerprint(cameras), **light}
    forget_other_frames(folder, settings)
    write_frames(folder, film)
    if not extras.has("av"):
        how = extras.install("video")
        print(f"no videos: PyAV is missing ({how}); frames are kept")
        return 0
    for output in film.outputs:
        write_video(folder, output, len(cameras), config.render.fps)
    print(write_page(folder, film, settings["step"]))
    return 0


def write_frames(folder: Path, film: Film) -> None:
    """Renders and writes the frames of which a picture is missing."""
    for output in film.outputs:
        atomic.ensure_folder(folder / output)
    frames = range(len(film.cameras))
    for frame in progress.track(frames, len(frames), "rendering", "frame"):
        files = {output: frame_file(folder, output, frame) for output in film.outputs}
        if not all(file.is_file() for file in files.values()):
            shown = film.frame(frame)
            for output, file in files.items():
                image_io.write(file, shown[output])


def write_page(folder: Path, film: Film, step: int) -> Path:
    """Writes index.html: the videos, the light, the colours of evidence."""
    media = tuple((f"{output}.mp4", text) for output, text in film.outputs.items())
    render = film.config.render
    light = dataclasses.asdict(render.light())
    used = ", ".join(f"{name} {value}" for name, value in light.items())
    return pages.write_index(
        folder,
        f"{film.scene.name}: {render.path} at step {step}",
        f"Light: {used}. The frames of each video are in the folder of its name.",
        [
            pages.Section("Videos", "The result first.", media),
            parts.evidence_legend(),
        ],
    )


def frame_file(folder: Path, output: str, frame: int) -> Path:
    """Where a frame of an output is kept."""
    return folder / output / f"{frame:04d}.png"


def write_video(folder: Path, output: str, frames: int, fps: int) -> None:
    """Makes the video of an output of its frames."""
    files = (frame_file(folder, output, frame) for frame in range(frames))
    stills = (color.to_uint8(image_io.read_srgb(file)) for file in files)
    video.write_video(stills, folder / f"{output}.mp4", fps)
    print(folder / f"{output}.mp4")


def fingerprint(cameras: Cameras) -> str:
    """Changes with any pose, and with the number and the size of the frames."""
    digest = hashlib.sha256()
    for part in (cameras.camtoworlds, cameras.widths, cameras.heights):
        digest.update(np.asarray(part).tobytes())
    return digest.hexdigest()[:12]


def forget_other_frames(folder: Path, settings: dict[str, float | str]) -> None:
    """Removes frames of an earlier run with other settings; keeps those of this."""
    atomic.ensure_folder(folder)
    record = folder / "settings.json"
    with contextlib.suppress(FileNotFoundError, ValueError):  # none, or cut short
        if json.loads(record.read_text()) == settings:
            return
    if record.is_file():
        print(f"{folder}: rendered with other settings before, rendering anew")
        for frame in folder.glob("*/[0-9][0-9][0-9][0-9].png"):
            frame.unlink()
    atomic.write_text(record, json.dumps(settings, indent=2) + "\n")


if __name__ == "__main__":
    script.run(main)
