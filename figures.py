# SPDX-License-Identifier: Apache-2.0
"""Makes figures of chosen methods, of any test view and detail, from a comparison.

python figures.py outputs/comparison --scene buu --view 10 \
    --methods "LIME, denoised" "LIME, denoised + NeRF" LLNeRF --crop 150 40 60 80

Takes what compare.py made and trains nothing. Writes comparison.png (input, the same
brightened, the methods, truth, with the crops enlarged) and decomposition.png (v, r
and the enhanced v of models that have them) into the scene's folder.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from internal import script
from internal.comparison import figures, jobs, tables
from internal.errors import UserError
from internal.pages.figure import FRAME_COLORS, Crop


def main(argv: Sequence[str]) -> int:
    """Writes the figures of one scene, or of all."""
    flags = _parser().parse_args(argv)
    scenes = jobs.scenes_of(flags.out)
    results = tables.read_tables(flags.out)
    if len(flags.crop) > len(FRAME_COLORS):
        raise UserError(
            f"--crop: {len(flags.crop)} of them; at most {len(FRAME_COLORS)}"
        )
    if flags.columns < 1:
        raise UserError(f"--columns {flags.columns}: expected 1 or more")
    for scene in [flags.scene] if flags.scene else list(scenes):
        if scene not in results:
            raise UserError(f"{flags.out}: no scene {scene}; has {', '.join(results)}")
        rows = results[scene]
        unknown = [name for name in flags.methods or rows if name not in rows]
        if unknown:
            raise UserError(
                f"{flags.out}: {scene} has no row {unknown[0]!r}; it has "
                f"{', '.join(rows)}"
            )
        paths = figures.write_figures(
            flags.out,
            scenes[scene],
            {name: rows[name] for name in flags.methods or rows},
            flags.view,
            [Crop(*numbers) for numbers in flags.crop],
            columns=flags.columns,
            renderings_only=flags.renderings_only,
        )
        print("\n".join(map(str, paths)))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Figures of a comparison.")
    parser.add_argument("out", type=Path, help="the folder that compare.py wrote")
    parser.add_argument("--scene", default="", help="all scenes if left out")
    parser.add_argument(
        "--methods", nargs="+", default=[], metavar="ROW", help="all if left out"
    )
    parser.add_argument("--view", default="", help="a test view; else the first")
    parser.add_argument(
        "--crop", type=int, nargs=4, action="append", default=[],
        metavar=("X", "Y", "WIDTH", "HEIGHT"), help="detail to enlarge, in pixels",
    )  # fmt: skip
    parser.add_argument("--columns", type=int, default=4, help="pictures in a row")
    parser.add_argument(
        "--renderings-only", action="store_true", help="no photos, no truth"
    )
    return parser


if __name__ == "__main__":
    script.run(main)
