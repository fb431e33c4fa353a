# SPDX-License-Identifier: Apache-2.0
"""Shows a trained scene in the browser: walk around, turn the light, plan a video.

python view.py --run outputs/night

Prints the address of a page. It may run while training goes on and then shows newer
checkpoints as they come. Snapshots and camera paths go to the folder view/ of the run,
in the form that render.py takes.
"""

from internal import flags, script

if __name__ == "__main__":  # before the imports below, which take seconds
    script.begin(flags.view(__doc__))

from collections.abc import Sequence
from pathlib import Path

from internal import cli, extras
from internal.training import run_folder


def main(argv: Sequence[str]) -> int:
    """Serves until Ctrl-C."""
    args = flags.view(__doc__).parse_args(argv)
    extras.need("view", "viser", to="the viewer")
    from internal.viewer.baking import Bakery
    from internal.viewer.server import Server, check_free
    from internal.viewer.studio import Studio

    check_free(args.host, args.port)
    config = cli.start_trained(args)
    run, scene = Path(config.checkpoint_dir), cli.load_split(config, "train")
    run_folder.check_same_scene(run, scene.identity, scored=False)
    studio = Studio(config, scene)
    bakery = None if args.no_splats else Bakery(studio, run, args.splats)
    server = Server(config, studio, args.host, args.port, bakery)
    if bakery:
        bakery.start()
    print(f"step {studio.trained.step} is shown at {server.address}", flush=True)
    try:
        server.wait()
    finally:
        server.close()
    return 0


if __name__ == "__main__":
    script.run(main)
