# SPDX-License-Identifier: Apache-2.0
"""Turns a folder of dark photos, or a video, into a scene that trains.

python prepare.py PHOTOS SCENE
python prepare.py PHOTOS SCENE --pose-images BRIGHT --gt TRUTH
python prepare.py --check SCENE

The first finds the cameras and writes SCENE with SCENE/report/index.html. The same
command goes on where it was interrupted. --check looks at a scene that has poses, in
any format that the trainer reads. --reference OTHER_SCENE compares the cameras found
or checked with those of another scene of the same photos.
Exit code 0: fit to train; 1: not fit; 2: unusable input.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from internal.cli import run_script
from internal.errors import UserError
from internal.prepare import report
from internal.prepare.checking import check_scene
from internal.prepare.pipeline import Inputs, prepare
from internal.scene import pose_comparison

NOT_FIT = 1


def main(argv: Sequence[str] | None = None) -> int:
    """Prepares or checks a scene and says what was found."""
    args = _parse(argv)
    if args.check:
        folder = args.report or args.check / report.FOLDER
        made = check_scene(args.check, folder)
    else:
        inputs = Inputs(args.photos, args.pose_images, args.gt)
        folder = args.scene / report.FOLDER
        made = prepare(inputs, args.scene, overwrite=args.overwrite)
    print(f"{report.as_text(made)}\n{folder / 'index.html'}")
    if args.reference:
        scene = args.check or args.scene
        print(pose_comparison.compare_scenes(scene, args.reference))
    print(f"next: {made.next_command}")
    return 0 if made.fit else NOT_FIT


def _parse(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("photos", type=Path, nargs="?", help="folder or video")
    parser.add_argument("scene", type=Path, nargs="?", help="folder to make")
    parser.add_argument(
        "--pose-images", type=Path, help="bright twins of the photos, used for poses"
    )
    parser.add_argument(
        "--gt", type=Path, help="normal-light twins of the photos, for scores"
    )
    parser.add_argument(
        "--overwrite", action="store_true", help="start again over a scene made before"
    )
    parser.add_argument("--check", type=Path, metavar="SCENE", help="check a scene")
    parser.add_argument(
        "--reference", type=Path, help="scene of the same photos to compare poses with"
    )
    parser.add_argument(
        "--report", type=Path, help="with --check: folder for the page (SCENE/report)"
    )
    args = parser.parse_args(argv)
    if bool(args.check) == bool(args.photos and args.scene):
        raise UserError("give PHOTOS and SCENE, or --check SCENE; see --help")
    return args


if __name__ == "__main__":
    run_script(main)
