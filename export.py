# SPDX-License-Identifier: Apache-2.0
"""Takes a trained, lit scene into other tools: points, mesh, pictures with cameras.

python export.py --run outputs/night

Writes the folder export/ of the run: points.ply (with normals), mesh.ply and mesh.glb
(with colours), and dataset/, a scene of lit pictures that NeRF and splatting tools
train on. With --splats 300000 also splats.ply and splats.glb, to walk through in any
viewer of Gaussian splats; what no photo saw is left out of them. The light is that of
render.py.
"""

from internal import flags, script

if __name__ == "__main__":  # before the imports below, which take seconds
    script.begin(flags.export(__doc__))

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax

from internal import cli, extras, parallel
from internal.cameras import Cameras
from internal.export import folder as export_folder
from internal.export.density import make_density
from internal.export.sightings import between_views, look_around, undistorted
from internal.files import made_folder
from internal.pages import pages
from internal.rendering.renderer import Renderer
from internal.training import run_folder
from internal.training.checkpoints import load_trained


def main(argv: Sequence[str]) -> int:
    """Exports the newest checkpoint, unless that was done with the same settings."""
    args = flags.export(__doc__).parse_args(argv)
    extras.need("export", "trimesh", "skimage", to="export")
    config = cli.start_trained(args)
    edit = config.render.edit()
    wanted = export_folder.Wanted(
        **{name: value for name in ("points", "resolution", "splats", "look")
           if (value := getattr(args, name))}
    )  # fmt: skip
    mesh = parallel.data_mesh(jax.device_count())
    model, state = load_trained(config, mesh)
    run = Path(config.checkpoint_dir)
    photographed = cli.load_split(config, "train")
    run_folder.check_same_scene(run, photographed.identity, scored=False)
    scene = undistorted(photographed)
    renderer = Renderer(model, scene.cameras, scene.space, mesh, config.render.chunk)
    density = make_density(model, state.params, footprint=1.0 / wanted.resolution)

    def fill(folder: Path) -> made_folder.Facts:
        def render(camera: Cameras) -> Any:
            return renderer.picture(state.params, camera, edit)

        sightings = look_around(scene, render)
        between = []
        if wanted.splats:
            between = look_around(between_views(scene), render)
        facts = export_folder.write_all(
            folder, scene, sightings, between, density, wanted
        )
        write_page(folder, scene.name, int(state.step), facts)
        return facts

    folder = run / "export"
    settings = {
        "step": int(state.step),
        **dataclasses.asdict(config.render.light()),
        **dataclasses.asdict(wanted),
    }
    facts = made_folder.make_folder(folder, settings, fill, overwrite=args.overwrite)
    for file, content in export_folder.list_exported(facts):
        print(f"{folder / file}: {content}")
    return 0


def write_page(folder: Path, name: str, step: int, facts: made_folder.Facts) -> None:
    """Writes index.html: what each file holds."""
    rows = tuple(export_folder.list_exported(facts))
    pages.write_index(
        folder,
        f"{name}: exported at step {step}",
        "In the frame and units of the scene's pose file. dataset/ has images, "
        "transforms.json and a COLMAP text model in sparse/0.",
        [pages.Table("Files", "", ("file", "content"), rows)],
    )


if __name__ == "__main__":
    script.run(main)
