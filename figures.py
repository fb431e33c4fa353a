# SPDX-License-Identifier: Apache-2.0
"""Makes figures of chosen methods, of any test view and detail, from a comparison.

python figures.py outputs/comparison --scene buu --view 10 \
    --methods "LIME, denoised" "LIME, denoised + NeRF" LLNeRF --crop 150 40 60 80

Takes what compare.py made and trains nothing. Writes comparison.png (input, the same
brightened, the methods, truth, with the crops enlarged) and decomposition.png (v, r
and the enhanced v of models that have them) into the scene's folder.
"""

from internal import flags, script

if __name__ == "__main__":  # before the imports below, which take seconds
    script.begin(flags.figures(__doc__), computes=False)

from collections.abc import Sequence

from internal.comparison import figures, jobs, score_tables
from internal.errors import UserError
from internal.pages.figure import FRAME_COLORS, Crop


def main(argv: Sequence[str]) -> int:
    """Writes the figures of one scene, or of all."""
    args = flags.figures(__doc__).parse_args(argv)
    scenes = jobs.scenes_of(args.out)
    results = score_tables.read_tables(args.out)
    if len(args.crop) > len(FRAME_COLORS):
        raise UserError(
            f"--crop: {len(args.crop)} of them; at most {len(FRAME_COLORS)}"
        )
    if args.columns < 1:
        raise UserError(f"--columns {args.columns}: expected 1 or more")
    for scene in [args.scene] if args.scene else list(scenes):
        if scene not in results:
            raise UserError(f"{args.out}: no scene {scene}; has {', '.join(results)}")
        rows = results[scene]
        unknown = [name for name in args.methods or rows if name not in rows]
        if unknown:
            raise UserError(
                f"{args.out}: {scene} has no row {unknown[0]!r}; it has "
                f"{', '.join(rows)}"
            )
        paths = figures.write_figures(
            args.out,
            scenes[scene],
            {name: rows[name] for name in args.methods or rows},
            args.view,
            [Crop(*numbers) for numbers in args.crop],
            columns=args.columns,
            renderings_only=args.renderings_only,
        )
        print("\n".join(map(str, paths)))
    return 0


if __name__ == "__main__":
    script.run(main)
