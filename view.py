# SPDX-License-Identifier: Apache-2.0
"""Shows a trained scene in the browser: walk around, turn the light, plan a video.

python view.py with the flags of train.py prints the address of a page. It may run
while training goes on and then shows newer checkpoints as they come. Snapshots and
camera paths go to CHECKPOINT_DIR/view, in the form that render.py takes.
"""

if __name__ == "__main__":  # before the imports: they would happen twice
    from internal import process

    process.restart_tuned()

import argparse
import importlib.util
from collections.abc import Sequence

from internal import cli
from internal.errors import UserError


def main(argv: Sequence[str]) -> int:
    """Serves until Ctrl-C."""
    parser = argparse.ArgumentParser(description="Show a trained scene in the browser.")
    parser.add_argument(
        "--host", default="127.0.0.1", help="0.0.0.0 lets other computers in"
    )
    parser.add_argument("--port", type=int, default=8080)
    config, flags = cli.parse_flags(parser, argv)
    if importlib.util.find_spec("viser") is None:
        raise UserError("the viewer needs viser: run pip install -e '.[view]'")
    from internal.viewer.server import Server, check_free
    from internal.viewer.studio import Studio

    check_free(flags.host, flags.port)
    studio = Studio(config, cli.load_split(config, "train"))
    server = Server(config, studio, flags.host, flags.port)
    print(f"step {studio.trained.step} is shown at {server.address}", flush=True)
    try:
        server.wait()
    finally:
        server.close()
    return 0


if __name__ == "__main__":
    cli.run_script(main)
