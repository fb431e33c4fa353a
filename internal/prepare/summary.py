# SPDX-License-Identifier: Apache-2.0
"""Gathers the numbers of a report from a scene that has poses."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from internal import poses, script
from internal.errors import UserError
from internal.files.listing import LeftOut
from internal.prepare import statistics
from internal.prepare.checks import Geometry, judge
from internal.prepare.photos import Found
from internal.prepare.report import Pictured, Report, Tried
from internal.prepare.scene_files import HOLDOUT
from internal.prepare.statistics import PhotoStatistics
from internal.scene.exposures import Exposures
from internal.scene.extent import Bounds, find_bounds, known_bounds
from internal.scene.loading import fit_lenses, held_out
from internal.scene.readers.base import SceneFiles

TRAINED_WIDTH = 500  # pixels: what a few minutes on a laptop train well


@dataclasses.dataclass(frozen=True)
class Findings:
    """What is known of a scene's photos and poses beside the scene itself."""

    source: str  # where the photos are from
    photos: Sequence[PhotoStatistics]  # of the usable ones that are not left out
    total: int  # files that should have been photos
    error: float  # in pixels of the copies
    error_kind: str  # what the error is between
    sharpness: dict[str, float]  # of photos with a pose, NaN where unknown
    exposures: Exposures
    truth: str
    next_command: str
    misplaced: tuple[str, ...] = ()  # photos whose matches their poses do not fit
    failed: tuple[LeftOut, ...] = ()  # photos without a pose, and why
    left_out: tuple[str, ...] = ()  # photos with a pose that do harm
    tried: tuple[Tried, ...] = ()


def summarize(files: SceneFiles, found: Findings) -> tuple[Report, Pictured]:
    """The report of a scene as the trainer will read it, and what its plots show."""
    bounds = _bounds(files)
    geometry = Geometry(
        registered=len(files.names),
        error=found.error,
        points=len(files.points),
        angle=sweep_angle(files.camtoworlds),
        has_depth_range=bounds is not None,
    )
    largest = float(np.abs(found.exposures.measured_stops).max())
    stops = 0.0 if found.exposures.equal else largest
    verdict = judge(geometry, found.photos, found.failed, stops, found.misplaced)
    report = Report(
        source=found.source,
        fit=verdict.fit,
        photos=found.total,
        registered=geometry.registered,
        failed=found.failed,
        sharpness={n: s for n, s in found.sharpness.items() if np.isfinite(s)},
        left_out=found.left_out,
        tried=found.tried,
        error=geometry.error,
        error_kind=found.error_kind,
        points=geometry.points,
        angle=geometry.angle,
        near=bounds.near if bounds else 0.0,
        far=bounds.far if bounds else 0.0,
        **_light(found.photos),
        exposure_stops=largest,
        truth=found.truth,
        warnings=verdict.warnings,
        next_command=found.next_command,
    )
    return report, _pictured(files, found.photos, found.exposures)


def summarize_failure(
    source: str,
    found: Found,
    failed: tuple[LeftOut, ...],
    tried: tuple[Tried, ...],
    problem: str,
) -> Report:
    """The report where no scene came about."""
    return Report(
        source=source,
        fit=False,
        photos=len(found.photos) + len(found.rejected),
        registered=tried[0].registered,
        failed=failed,
        sharpness={},
        left_out=(),
        tried=tried,
        error=tried[0].reprojection_error,
        error_kind="mean reprojection error",
        points=tried[0].points,
        **{"angle": 0.0, "near": 0.0, "far": 0.0},
        **_light([photo.statistics for photo in found.photos]),
        exposure_stops=0.0,
        truth="not looked at",
        warnings=(problem,),
        next_command="take more photos and prepare again",
    )


def train_command(scene: Path, width: int) -> str:
    """The command that trains a scene of photos of that width in pixels."""
    factor = max(1, round(width / TRAINED_WIDTH))
    bindings = ["Config.max_minutes = 5.0"]
    bindings += [f"Config.factor = {factor}"] if factor > 1 else []
    return script.command_line(
        *("train.py", "--gin_configs=configs/llnerf_best.gin"),
        *("--scene", scene, "--run", Path("outputs", scene.resolve().name)),
        *(f"--gin_bindings={binding}" for binding in bindings),
    )


def sweep_angle(camtoworlds: Float[np.ndarray, "n 3 4"]) -> float:
    """Degrees between the outermost cameras, seen from the point they look at."""
    arms = camtoworlds[:, :, 3] - poses.focus_point(camtoworlds)
    lengths = np.linalg.norm(arms, axis=-1, keepdims=True)
    units = arms / np.maximum(lengths, np.finfo(float).tiny)
    return float(np.degrees(np.arccos(np.clip(units @ units.T, -1.0, 1.0))).max())


def _bounds(files: SceneFiles) -> Bounds | None:
    """Near and far as the trainer will find them, or None where it will not."""
    is_test = held_out(files, HOLDOUT)
    try:
        known = known_bounds(files, fit_lenses(files, 1), ~is_test)
        return find_bounds(files, known, 0.0, 0.0)
    except UserError:
        return None


def _light(photos: Sequence[PhotoStatistics]) -> dict[str, float]:
    return {
        "mean_level": float(np.mean([photo.mean for photo in photos])),
        "noise": float(np.median([photo.noise for photo in photos])),
        "used_levels": float(np.median([photo.used_levels for photo in photos])),
        "black_fraction": float(np.mean([photo.black_fraction for photo in photos])),
    }


def _pictured(
    files: SceneFiles, photos: Sequence[PhotoStatistics], exposures: Exposures
) -> Pictured:
    return Pictured(
        camtoworlds=files.camtoworlds,
        points=files.points,
        histogram=statistics.total_histogram(photos),
        stops=exposures.measured_stops,
    )
