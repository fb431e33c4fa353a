# SPDX-License-Identifier: Apache-2.0
"""The figures of a comparison: the same view by every method, and decompositions.

A view is named as its file, without ending.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

from internal.comparison.jobs import Result, dark_photos, read_result, scene_name
from internal.errors import UserError
from internal.files import image_io
from internal.pages.figure import Crop, Picture, figure, find_crops

# Output of eval.py, and its label: the font has no Greek and no hats.
DECOMPOSITION = {
    "dark": "c",
    "v": "v",
    "r": "r",
    "v_enhanced": "v enhanced",
    "enhanced": "c enhanced",
}

Labelled = list[tuple[str, Picture]]


def write_figures(
    out: Path,
    data_dir: Path,
    results: Mapping[str, Result],
    view: str = "",
    crops: Sequence[Crop] = (),
    *,
    columns: int = 4,
    renderings_only: bool = False,
) -> list[Path]:
    """Writes comparison.png and, of models that decompose, decomposition.png.

    Args:
        out: folder of the comparison.
        data_dir: the scene, whose dark photos were scored.
        results: the methods to show.
        view: a test view; "" is the first.
        crops: windows to enlarge; none: the comparison's are found.
        columns: pictures in a row of the comparison.
        renderings_only: leaves out all photos, enhanced ones and truth too.

    Raises:
        UserError: there is no such view, a crop leaves it, or nothing is to show.
    """
    reference = read_result(out, dark_photos(data_dir), "unchanged")
    folder = out / scene_name(data_dir)
    view = view or _views(out, reference)[0]
    if view not in _views(out, reference):
        names = ", ".join(_views(out, reference))
        raise UserError(f"{folder}: no test view {view!r}; there are {names}")
    shown = comparison_pictures(out, reference, results, view, renderings_only)
    _check_crops(crops, shown[0][1])
    guide = reference.picture(out, "truth", view)
    if not guide.is_file():
        guide = reference.picture(out, "gain_to_mean", view)
    found = crops or find_crops(image_io.read_srgb(guide))
    written = {"comparison.png": figure(shown, found, columns)}
    parts = decomposition_pictures(out, results, view)
    if parts:
        written["decomposition.png"] = figure(parts, crops, len(DECOMPOSITION))
    for name, picture in written.items():
        image_io.write(folder / name, picture)
    return [folder / name for name in written]


def comparison_pictures(
    out: Path,
    reference: Result,
    results: Mapping[str, Result],
    view: str,
    renderings_only: bool,
) -> Labelled:
    """The view as photographed, brightened, by each method, and in truth.

    ``reference`` is of the dark photos; methods that show these again are left out.

    Raises:
        UserError: a picture is missing, or nothing is left to show.
    """
    shown = {
        name: result.picture(out, result.output, view)
        for name, result in results.items()
        if result.trained or not (renderings_only or result.folder == reference.folder)
    }
    if not renderings_only:
        photos = {
            "input": reference.picture(out, "unchanged", view),
            "input x gain": reference.picture(out, "gain_to_mean", view),
        }
        truth = {"truth": reference.picture(out, "truth", view)}
        shown = photos | shown | (truth if truth["truth"].is_file() else {})
    if not shown:
        raise UserError(f"{out}: no rendering to show; choose methods that train")
    return [(label, image_io.read_srgb(path)) for label, path in shown.items()]


def decomposition_pictures(
    out: Path, results: Mapping[str, Result], view: str
) -> Labelled:
    """Dark, v, r, v enhanced and enhanced, of each model that decomposes."""
    return [
        (f"{name}: {label}", image_io.read_srgb(result.picture(out, output, view)))
        for name, result in results.items()
        if result.output == "enhanced"
        for output, label in DECOMPOSITION.items()
    ]


def _views(out: Path, reference: Result) -> list[str]:
    """The names of the test views."""
    folder = reference.pictures(out, "unchanged")
    return sorted(path.stem for path in folder.glob("*.png"))


def _check_crops(crops: Sequence[Crop], picture: Picture) -> None:
    height, width, _ = picture.shape
    for crop in crops:
        if not crop.fits(picture):
            raise UserError(
                f"crop {crop.x} {crop.y} {crop.width} {crop.height}: leaves the "
                f"picture of {width}x{height} pixels; give X Y WIDTH HEIGHT inside it"
            )
