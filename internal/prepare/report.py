# SPDX-License-Identifier: Apache-2.0
"""The report on a scene: ``report.json`` for programs, ``index.html`` for people."""

import dataclasses
import json
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from internal.errors import UserError
from internal.files import atomic
from internal.files.listing import LeftOut
from internal.pages import pages
from internal.pages.pages import Part, Section, Table
from internal.prepare import plots
from internal.prepare.sharpness import BLURRED

FOLDER = "report"


@dataclasses.dataclass(frozen=True)
class Tried:
    """One attempt to recover the cameras."""

    way: str
    registered: int
    reprojection_error: float  # pixels of the copies; 0 without model
    points: int


@dataclasses.dataclass(frozen=True)
class Report:
    """All numbers of the report. Levels are of 255, depths in the scene's units."""

    source: str
    fit: bool  # to train
    photos: int
    registered: int
    failed: tuple[LeftOut, ...]  # photos without a pose, and why
    sharpness: dict[str, float]  # of photos with a pose: 1 for one like the others
    left_out: tuple[str, ...]  # photos with a pose that the scene is better without
    tried: tuple[Tried, ...]
    error: float  # pixels of the copies
    error_kind: str  # what the error is between
    points: int
    angle: float  # degrees between the outermost cameras, seen from the scene
    near: float
    far: float
    mean_level: float
    noise: float  # standard deviation of single pixels, levels
    used_levels: float
    black_fraction: float
    exposure_stops: float  # largest measured difference from the mean
    truth: str
    warnings: tuple[str, ...]
    next_command: str

    @property
    def blurred(self) -> tuple[tuple[str, str, str], ...]:
        """Photo, sharpness, and what was done, the most blurred first."""
        return tuple(
            (name, f"{sharp:.2f}", "left out" if name in self.left_out else "kept")
            for name, sharp in sorted(self.sharpness.items(), key=lambda item: item[1])
            if sharp < BLURRED
        )

    @property
    def posed(self) -> str:
        """How many photos have a pose, in words."""
        some = self.registered + len(self.left_out)
        rest = f" ({len(self.left_out)} left out as blurred)" if self.left_out else ""
        return f"{some} of {self.photos} photos have a pose{rest}"


@dataclasses.dataclass(frozen=True)
class Pictured:
    """What the report's plots show."""

    camtoworlds: Float[np.ndarray, "n 3 4"]
    points: Float[np.ndarray, "m 3"]
    histogram: Int[np.ndarray, " levels"]
    stops: Float[np.ndarray, " n"]


def write_report(report: Report, pictured: Pictured | None, folder: Path) -> Path:
    """Writes the report and returns the page's path. No plots without cameras.

    Raises:
        UserError: the folder cannot be written or the disk is full.
    """
    folder.mkdir(parents=True, exist_ok=True)
    content = json.dumps(dataclasses.asdict(report), indent=2, allow_nan=False)
    atomic.write_text(folder / "report.json", content + "\n")
    sections: list[Part] = []
    if pictured is not None:
        plots.plot_layout(pictured.camtoworlds, pictured.points, folder / "cameras.png")
        plots.plot_histogram(pictured.histogram, folder / "brightness.png")
        plots.plot_exposures(pictured.stops, folder / "exposures.png")
        sections.append(_pictures())
    sections += [_advice(report), _numbers(report)]
    if report.tried:
        sections.append(_attempts(report))
    if report.failed:
        rows = tuple((rejected.name, rejected.reason) for rejected in report.failed)
        text = "These files are not in the scene."
        sections.append(Table("Without a pose", text, ("file", "why"), rows))
    if report.blurred:
        text = (
            "Against photos of the same things, which have 1. What is left out is not "
            "in the scene; --keep-blurred keeps it."
        )
        headers = ("file", "sharpness", "in the scene")
        sections.append(Table("Blurred", text, headers, report.blurred))
    verdict = "fit to train" if report.fit else "not fit to train"
    return pages.write_index(
        folder,
        f"{report.posed}: {verdict}",
        f"From {report.source}. Next: {report.next_command}",
        sections,
    )


def read_report(folder: Path) -> Report:
    """The report that ``write_report`` wrote into a folder.

    Raises:
        UserError: it is missing or was changed.
    """
    path = folder / "report.json"
    try:
        content = json.loads(path.read_text())
        content["failed"] = tuple(LeftOut(**entry) for entry in content["failed"])
        content["tried"] = tuple(Tried(**entry) for entry in content["tried"])
        content["left_out"] = tuple(content["left_out"])
        content["warnings"] = tuple(content["warnings"])
        return Report(**content)
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise UserError(
            f"{path}: not a report ({error}); prepare the scene again with --overwrite"
        ) from error


def as_text(report: Report) -> str:
    """What matters of a report, in lines for a terminal."""
    lines = [
        f"{report.posed}, {report.error_kind} {report.error:.2f} pixels, "
        f"{report.points} points, near {report.near:.3g}, far {report.far:.3g}",
        f"light: mean {report.mean_level:.1f} of 255, noise {report.noise:.2f} levels, "
        f"{report.used_levels:.0f} levels in use, exposures within "
        f"{report.exposure_stops:.2f} stops",
        *(f"no pose: {failed.name}: {failed.reason}" for failed in report.failed),
        *(
            f"blurred: {name}: {sharp} as sharp as photos of the same things, {done}"
            for name, sharp, done in report.blurred
        ),
        *(f"warning: {warning}" for warning in report.warnings),
        "fit to train" if report.fit else "NOT fit to train",
    ]
    return "\n".join(lines)


def _pictures() -> Section:
    return Section(
        "What was found",
        "Orange: cameras and where they look; blue: sparse points. Far outliers are "
        "cut off.",
        (
            ("cameras.png", "cameras and points"),
            ("brightness.png", "brightness of the photos as they are"),
            ("exposures.png", "exposure against the others, from shared points"),
        ),
    )


def _advice(report: Report) -> Table:
    rows = tuple((warning,) for warning in report.warnings) or (("nothing",),)
    return Table("What to know", "Warnings, and what to do.", ("warning",), rows)


def _numbers(report: Report) -> Table:
    rows = (
        ("photos", f"{report.photos}"),
        ("with a pose, in the scene", f"{report.registered}"),
        (f"{report.error_kind} (pixels)", f"{report.error:.3f}"),
        ("sparse points", f"{report.points}"),
        ("cameras seen from the scene (degrees)", f"{report.angle:.1f}"),
        ("near, far (scene units)", f"{report.near:.4g}, {report.far:.4g}"),
        ("mean brightness (of 255)", f"{report.mean_level:.1f}"),
        ("noise of a pixel (levels)", f"{report.noise:.2f}"),
        ("levels in use per photo", f"{report.used_levels:.0f}"),
        ("pixels that are 0", f"{100 * report.black_fraction:.1f} %"),
        ("largest exposure difference (stops)", f"{report.exposure_stops:.2f}"),
        ("normal-light truth", report.truth),
    )
    text = "Pixels are those of the copies that features were found in."
    return Table("Numbers", text, ("what", "value"), rows)


def _attempts(report: Report) -> Table:
    rows = tuple(
        (t.way, f"{t.registered}", f"{t.reprojection_error:.2f}", f"{t.points}")
        for t in report.tried
    )
    headers = ("way", "photos placed", "reprojection error (pixels)", "points")
    return Table("Tried", "The first row was taken.", headers, rows)
