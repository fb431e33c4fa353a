# SPDX-License-Identifier: Apache-2.0
"""Turns a folder of dark photos, or a video, into a scene that trains.

python prepare.py PHOTOS SCENE
python prepare.py PHOTOS SCENE --pose-images BRIGHT --gt TRUTH
python prepare.py --check SCENE

The first finds the cameras and writes SCENE with SCENE/report/index.html. The same
command goes on where it was interrupted. --check looks at a scene that has poses, in
any format that the trainer reads. Photos that are blurred against others of the same
things are named and left out of the scene, unless --keep-blurred. --reference
OTHER_SCENE compares the cameras found or checked with those of another scene of the
same photos.
Exit code 0: fit to train; 1: not fit; 2: unusable input.
"""

from internal import flags, script

if __name__ == "__main__":  # before the imports below, which take seconds
    script.begin(flags.prepare(__doc__), computes=False)

from collections.abc import Sequence

from internal.errors import UserError
from internal.prepare import report
from internal.prepare.checking import check_scene
from internal.prepare.pipeline import Inputs, prepare
from internal.scene import pose_comparison

NOT_FIT = 1


def main(argv: Sequence[str] | None = None) -> int:
    """Prepares or checks a scene and says what was found."""
    args = flags.prepare(__doc__).parse_args(argv)
    if bool(args.check) == bool(args.photos and args.scene):
        raise UserError("give PHOTOS and SCENE, or --check SCENE; see --help")
    if args.check:
        folder = args.report or args.check / report.FOLDER
        made = check_scene(args.check, folder)
    else:
        inputs = Inputs(args.photos, args.pose_images, args.gt, args.keep_blurred)
        folder = args.scene / report.FOLDER
        made = prepare(inputs, args.scene, overwrite=args.overwrite)
    print(f"{report.as_text(made)}\n{folder / 'index.html'}")
    if args.reference:
        scene = args.check or args.scene
        print(pose_comparison.compare_scenes(scene, args.reference))
    print(f"next: {made.next_command}")
    return 0 if made.fit else NOT_FIT


if __name__ == "__main__":
    script.run(main)
