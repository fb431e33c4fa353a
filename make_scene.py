# SPDX-License-Identifier: Apache-2.0
"""Makes paired low-light scenes: a synthetic one, or a darkened dataset.

python make_scene.py night OUT
python make_scene.py darken DATA_DIR OUT --images images_8
"""

from internal import flags, script

if __name__ == "__main__":  # before the imports below, which take seconds
    script.begin(flags.make_scene(__doc__), computes=False)

import dataclasses
from collections.abc import Sequence

from internal.night.capture import CaptureModel
from internal.night.darken import darken
from internal.night.dataset import write_scene


def main(argv: Sequence[str] | None = None) -> int:
    """Parses the command line, makes the scene and says what was made."""
    args = flags.make_scene(__doc__).parse_args(argv)
    given = {
        field.name: getattr(args, field.name)
        for field in dataclasses.fields(CaptureModel)
        if field.name in args
    }
    model = CaptureModel(**given)
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


if __name__ == "__main__":
    script.run(main)
