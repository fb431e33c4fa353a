# SPDX-License-Identifier: Apache-2.0
"""Takes a trained, lit scene into other tools: points, mesh, pictures with cameras.

python export.py with the flags of train.py writes CHECKPOINT_DIR/export: points.ply
(with normals), mesh.ply and mesh.glb (with colours), and dataset/, a scene of lit
pictures that NeRF and splatting tools train on. The light is that of render.py.
"""

if __name__ == "__main__":  # before the imports: they would happen twice
    from internal import process

    process.restart_tuned()

import argparse
import dataclasses
from collections.abc import Sequence
from pathlib import Path

import jax

from internal import cli, parallel
from internal.export import folder as export_folder
from internal.export import shapes
from internal.export.density import make_density
from internal.files import made_folder
from internal.pages import pages
from internal.rendering.renderer import Renderer
from internal.training.checkpoints import load_trained


def main(argv: Sequence[str]) -> int:
    """Exports the newest checkpoint, unless that was done with the same settings."""
    parser = argparse.ArgumentParser(description="Export a trained scene.")
    wanted = export_folder.Wanted()
    parser.add_argument(
        "--points", type=int, default=wanted.points, help="of the cloud, about"
    )
    parser.add_argument(
        "--resolution", type=int, default=wanted.resolution,
        help="cells along the mesh's longest side",
    )  # fmt: skip
    parser.add_argument(
        "--overwrite", action="store_true", help="replace an export made before"
    )
    config, flags = cli.parse_flags(parser, argv)
    shapes.check_available()
    edit = config.render.edit()
    wanted = export_folder.Wanted(flags.points, flags.resolution)
    mesh = parallel.data_mesh(jax.device_count())
    model, state = load_trained(config, mesh)
    scene = export_folder.undistorted(cli.load_split(config, "train"))
    renderer = Renderer(model, scene.cameras, scene.space, mesh, config.render.chunk)
    density = make_density(model, state.params, footprint=1.0 / flags.resolution)

    def fill(folder: Path) -> made_folder.Facts:
        sightings = export_folder.look_around(
            scene, lambda view: renderer.view(state.params, view, edit)
        )
        facts = export_folder.write_all(folder, scene, sightings, density, wanted)
        pages.write_index(
            folder,
            f"{scene.name}: exported at step {int(state.step)}",
            "In the frame and units of the scene's pose file. dataset/ has images, "
            "transforms.json and a COLMAP text model in sparse/0.",
            [
                pages.Table(
                    "Files",
                    "",
                    ("file", "content"),
                    tuple(export_folder.describe(facts)),
                )
            ],
        )
        return facts

    folder = Path(config.checkpoint_dir) / "export"
    settings = {
        "step": int(state.step),
        **dataclasses.asdict(config.render.light()),
        **dataclasses.asdict(wanted),
    }
    facts = made_folder.make_folder(folder, settings, fill, overwrite=flags.overwrite)
    for file, content in export_folder.describe(facts):
        print(f"{folder / file}: {content}")
    return 0


if __name__ == "__main__":
    cli.run_script(main)
