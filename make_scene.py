# SPDX-License-Identifier: Apache-2.0
"""Makes paired low-light scenes: a synthetic one, or a darkened dataset.

python make_scene.py night OUT
python make_scene.py darken DATA_DIR OUT --images images_8
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from internal.cli import run_script
from internal.night.capture import CaptureModel
from internal.night.darken import darken
from internal.night.dataset import write_scene


def main(argv: Sequence[str] | None = None) -> int:
    """Parses the command line, makes the scene and says what was made."""
    args = _parser().parse_args(argv)
    model = CaptureModel(
        exposure=args.exposure,
        full_well=args.full_well,
        read_noise=args.read_noise,
        channel_gains=tuple(args.gains),
        seed=args.seed,
    )
    if args.command == "night":
        facts = write_scene(
            args.out, model,
            views=args.views, width=args.width, height=args.height,
            overwrite=args.overwrite,
        )  # fmt: skip
    else:
        facts = darken(
            args.data_dir, args.out, model,
            images_dir=args.images, jpeg_quality=args.jpeg, overwrite=args.overwrite,
        )  # fmt: skip
    print(
        f"{args.out}: dark pictures average {facts['dark_level']:.1f} of 255, "
        f"truth (high/) {facts['truth_level']:.1f}"
    )
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    night = commands.add_parser("night", help="a synthetic still life, rendered")
    night.add_argument("--views", type=int, default=30)
    night.add_argument("--width", type=int, default=160, help="pixels")
    night.add_argument("--height", type=int, default=120, help="pixels")
    dark = commands.add_parser("darken", help="a normal-light dataset, darkened")
    dark.add_argument("data_dir", type=Path, help="dataset with its pose files")
    dark.add_argument("--images", default="", help="folder of its pictures to take")
    dark.add_argument(
        "--jpeg", type=int, default=0, metavar="QUALITY",
        help="1 to 100, of a JPEG that the dark pictures go through; 0 for none",
    )  # fmt: skip
    for command in (night, dark):
        _add_capture_arguments(command)
    return parser


def _add_capture_arguments(parser: argparse.ArgumentParser) -> None:
    default = CaptureModel()
    parser.add_argument("out", type=Path, help="folder to make")
    parser.add_argument(
        "--exposure", type=float, default=default.exposure, help="1 is normal light"
    )
    parser.add_argument(
        "--full-well", type=float, default=default.full_well,
        help="photo-electrons at white, fewer are noisier; inf for no noise",
    )  # fmt: skip
    parser.add_argument(
        "--read-noise", type=float, default=default.read_noise, help="electrons"
    )
    parser.add_argument(
        "--gains", type=float, nargs=3, default=default.channel_gains,
        metavar=("R", "G", "B"), help="colour cast",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, default=default.seed, help="of the noise")
    parser.add_argument(
        "--overwrite", action="store_true", help="replace a scene made before"
    )


if __name__ == "__main__":
    run_script(main)
