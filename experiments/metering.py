# SPDX-License-Identifier: Apache-2.0
"""Fits the metering of ``internal/enhancements/metering.py`` and says how it compares.

python -m experiments.metering

It sees 82 dark and normal photos of a camera and 500 ordinary ones
(``experiments/captures.py``). Every number in its tables is of pictures left out: eight
folds over pictures. It writes ``internal/enhancements/metering.json``.
"""

import dataclasses
import json
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from benchmarks.workload import markdown
from experiments import captures
from experiments.captures import Shot
from internal.color import photo_to_linear
from internal.enhancements import metering
from internal.enhancements.metering import (
    Prior,
    blended,
    developed,
    first_exposure,
    largest_channel,
)

FOLDS = 8
EXAMPLES = 150  # of the kernel regression
STOPS = np.arange(-3.0, 13.0, 0.1)  # searched for the best exposure
LEVELS_OF_LIGHT = photo_to_linear(np.arange(256) / 255.0)
STRAIGHT = (1.0, 64.0)  # a line that clips, but for a rounded corner
SHIPPED = "kernel, pairs 0.3"


@dataclasses.dataclass(frozen=True)
class Family:
    """A tone curve and a way to learn its exposure."""

    contrast: float = 1.3
    shoulder: float = 1.5
    pairs: float = 0.3  # weight of all real pairs; ordinary photos weigh 1
    ridge: float = 3e-4
    width: float = 0.7
    linear: bool = False  # a linear regression instead of the kernel's
    features: bool = True  # without: the same addition for all


FAMILIES = {
    "same mean for all": Family(features=False),
    "linear": Family(linear=True, ridge=1e-3),
    "linear, ordinary photos only": Family(linear=True, ridge=1e-3, pairs=0.0),
    "kernel, ordinary photos only": Family(pairs=0.0),
    SHIPPED: Family(),
    "kernel, pairs 1": Family(pairs=1.0),
    "kernel, stiff": Family(ridge=3e-3),
    "Naka-Rushton, n 1.3": Family(1.3, 1.0),
    "straight line": Family(*STRAIGHT),
    "n 1.2, k 2": Family(1.2, 2.0),
    "n 1.3, k 2": Family(1.3, 2.0),
    "n 1.5, k 1": Family(1.5, 1.0),
}
BLENDED_CURVES = (
    (1.2, 1.0), (1.3, 1.0), (1.4, 1.0), (1.5, 1.0), (1.7, 1.0), (1.2, 1.5), (1.3, 1.5),
    (1.5, 1.5), (1.1, 2.0), (1.2, 2.0), (1.3, 2.0), (1.5, 2.0), (1.2, 4.0),
)  # fmt: skip
NORMALS = (0.58, 0.62, 0.66, 0.70)


@dataclasses.dataclass(frozen=True)
class Lit:
    """All shots under one curve."""

    first: Float[np.ndarray, " shots"]  # stops
    shapes: Float[np.ndarray, "shots features"]
    errors: Float[np.ndarray, "shots stops"]  # mean squared, at each of STOPS

    @property
    def best(self) -> Float[np.ndarray, " shots"]:
        """Stops of the least error, between the searched ones by a parabola."""
        at = np.clip(np.argmin(self.errors, axis=1), 1, len(STOPS) - 2)
        shot = np.arange(len(at))
        before, there, after = (self.errors[shot, at + i] for i in (-1, 0, 1))
        bend = before - 2.0 * there + after
        return STOPS[at] + 0.05 * (before - after) / np.maximum(bend, 1e-12)

    def psnr(self, stops: Float[np.ndarray, " shots"]) -> Float[np.ndarray, " shots"]:
        """PSNR in dB at these exposures."""
        rows = zip(stops, self.errors, strict=True)
        return np.array([-10 * np.log10(np.interp(s, STOPS, e)) for s, e in rows])


def under_curve(shots: list[Shot], contrast: float, shoulder: float) -> Lit:
    exposed = LEVELS_OF_LIGHT * 2.0 ** STOPS[:, None]
    curves = developed(exposed, 0.0, contrast, shoulder)
    firsts, shapes, errors = [], [], []
    for shot in shots:
        light, counts = largest_channel(LEVELS_OF_LIGHT[shot.dark])
        first, shape = first_exposure(light, counts, contrast, shoulder)
        firsts.append(first)
        shapes.append(shape)
        errors.append(errors_of(curves, shot))
    return Lit(np.array(firsts), np.array(shapes), np.array(errors))


def errors_of(
    curves: Float[np.ndarray, "curves 256"], shot: Shot
) -> Float[np.ndarray, " curves"]:
    """Mean squared error of each curve of the dark levels."""
    levels, truth = shot.dark.ravel(), shot.truth.ravel() / 255.0
    counts = np.bincount(levels, minlength=256)
    sums = np.bincount(levels, truth, minlength=256)
    squares = curves**2 @ counts - 2.0 * curves @ sums + np.sum(truth**2)
    return squares / len(levels)


def weights_of(shots: list[Shot], pairs: float) -> Float[np.ndarray, " shots"]:
    """Each group's weight, shared equally among its shots."""
    total = {"pairs": pairs, "ordinary": 1.0, "bright": 0.5}
    groups = [shot.group for shot in shots]
    return np.array([total[group] / groups.count(group) for group in groups])


def fitted(
    family: Family,
    lit: Lit,
    weight: Float[np.ndarray, " shots"],
    chosen: np.ndarray,
) -> Prior:
    """The regression on the chosen shots."""
    use = chosen & (weight > 0)
    share = weight[use] / weight[use].sum()
    shapes, wanted = lit.shapes[use], (lit.best - lit.first)[use]
    center = share @ shapes
    scale = np.sqrt(share @ (shapes - center) ** 2)
    standard = (shapes - center) / scale
    rng = np.random.default_rng(0)
    picked = rng.choice(len(share), EXAMPLES, replace=False, p=share)
    examples, offset = standard[picked], float(share @ wanted)
    basis = metering.kernel(standard, examples, family.width)
    bend = metering.kernel(examples, examples, family.width) + 1e-6 * np.eye(EXAMPLES)
    normal = (basis * share[:, None]).T @ basis + family.ridge * bend
    weights = np.linalg.solve(normal, (basis * share[:, None]).T @ (wanted - offset))
    return Prior(
        family.contrast, family.shoulder, offset, family.width, center, scale,
        examples, weights * family.features,
    )  # fmt: skip


def predictor(
    family: Family, lit: Lit, weight: Float[np.ndarray, " shots"], chosen: np.ndarray
) -> Callable[[np.ndarray], np.ndarray]:
    """From shapes to stops that are added to the first exposure."""
    if not family.linear:
        prior = fitted(family, lit, weight, chosen)
        return lambda shapes: metering.correction(shapes, prior)
    share = weight * chosen / np.sum(weight * chosen)
    center = share @ lit.shapes
    scale = np.sqrt(share @ (lit.shapes - center) ** 2)
    standard = (lit.shapes - center) / scale
    wanted = lit.best - lit.first
    offset = share @ wanted
    normal = (standard * share[:, None]).T @ standard + family.ridge * np.eye(
        standard.shape[1]
    )
    slopes = np.linalg.solve(normal, (standard * share[:, None]).T @ (wanted - offset))
    return lambda shapes: (shapes - center) / scale @ slopes + offset


def folds_of(shots: list[Shot]) -> np.ndarray:
    """The fold of each shot: pairs in the order they were taken in (neighbours show
    one room), ordinary photos at random."""
    pairs = len(captures.pair_files())
    count = max(shot.picture for shot in shots) + 1
    order = np.random.default_rng(1).permutation(count - pairs)
    fold = np.concatenate([np.arange(pairs) * FOLDS // pairs, order % FOLDS])
    return fold[[shot.picture for shot in shots]]


def left_out(family: Family, shots: list[Shot], lit: Lit) -> np.ndarray:
    """The stops of every shot, from a regression that has not seen its picture."""
    fold, weight = folds_of(shots), weights_of(shots, family.pairs)
    stops = np.zeros(len(shots))
    for k in range(FOLDS):
        predict = predictor(family, lit, weight, fold != k)
        stops[fold == k] = predict(lit.shapes[fold == k])
    return stops + lit.first


def todays(
    shots: list[Shot], contrast: float, shoulder: float, target: float, largest: bool
):
    """Stops at which the mean (of the largest channel) is the same for all."""
    curves = developed(LEVELS_OF_LIGHT * 2.0 ** STOPS[:, None], 0.0, contrast, shoulder)
    stops = []
    for shot in shots:
        values = shot.dark.max(axis=-1) if largest else shot.dark.ravel()
        means = curves @ np.bincount(values, minlength=256) / len(values)
        stops.append(np.interp(target, means, STOPS))
    return np.array(stops)


GROUPS = (
    ("pairs", 0), ("ordinary", 30), ("ordinary", 8), ("ordinary", 2),
    ("bright", 30), ("bright", 8), ("bright", 2),
)  # fmt: skip


def row(name: str, shots: list[Shot], lit: Lit, stops: np.ndarray) -> tuple[str, ...]:
    """Per group: RMS error in stops, mean of it, worst; PSNR."""
    error, psnr = stops - lit.best, lit.psnr(stops)
    cells, scores = [], []
    for group in GROUPS:
        member = np.array([(shot.group, shot.level) == group for shot in shots])
        rms, worst = np.sqrt(np.mean(error[member] ** 2)), np.abs(error[member]).max()
        cells.append(f"{rms:.2f} ({worst:.1f}), {psnr[member].mean():.1f}")
        scores.append(psnr[member].mean())
    total = scores[0] + np.mean(scores[1:])
    return (name, *cells, f"{total:.2f}")


def main() -> None:
    shots = captures.shots()
    curves = {(f.contrast, f.shoulder) for f in FAMILIES.values()}
    lit = {curve: under_curve(shots, *curve) for curve in curves}
    old, line = lit[1.3, 1.0], lit[STRAIGHT]
    rows = [
        row("shipped before: n 1.3, mean of the largest channel 0.58", shots, old,
            todays(shots, 1.3, 1.0, 0.58, True)),
        row("one gain to mean 0.5", shots, line, todays(shots, *STRAIGHT, 0.5, False)),
    ]  # fmt: skip
    shipped = {}
    for name, family in FAMILIES.items():
        own = lit[family.contrast, family.shoulder]
        stops = left_out(family, shots, own)
        rows.append(row(name, shots, own, stops))
        if name == SHIPPED:
            weight = weights_of(shots, family.pairs)
            shipped = written(fitted(family, own, weight, np.ones(len(shots), bool)))
            curve = family.contrast, family.shoulder
            normal = todays(shots, *curve, metering.NORMAL, True)
            both = np.asarray(blended(stops, normal))
            rows.append(
                row(
                    f"a third of the way to mean {metering.NORMAL}: ships",
                    shots,
                    own,
                    both,
                )
            )
        print(rows[-1], flush=True)
    for name, curve in (
        ("best of n 1.3, k 1.5", (1.3, 1.5)),
        ("best of n 1.3", (1.3, 1.0)),
        ("best straight line", STRAIGHT),
    ):
        rows.append(
            row(f"{name}, chosen with the truth", shots, lit[curve], lit[curve].best)
        )
    headers = ("rule", *(f"{g} {n}" if n else g for g, n in GROUPS), "pairs + dark")
    made = {"made_by": "python -m experiments.metering"}
    metering.FITTED.write_text(json.dumps(made | shipped) + "\n")
    print(markdown(headers, rows))
    same = f"same mean {metering.NORMAL}"
    whole = captures.scene_shots()
    print(markdown(("scene", "kernel", same, "ships"), scenes(shipped, whole)))
    table = blends(shots, [shot for _, shot in whole])
    print(markdown(("curve", "best", *map(str, NORMALS)), table))


def scenes(shipped: dict, whole: list[tuple[str, Shot]]) -> list[tuple[str, ...]]:
    """Errors in stops of the two rules and of their blend on whole scenes."""
    prior = metering.prior_of(shipped)
    names, shots = zip(*whole, strict=True)
    curve = prior.contrast, prior.shoulder
    lit = under_curve(list(shots), *curve)
    kernel = lit.first + metering.correction(lit.shapes, prior)
    normal = todays(list(shots), *curve, metering.NORMAL, True)
    rules = [kernel, normal, blended(kernel, normal)]
    errors = np.stack(rules, axis=1) - lit.best[:, None]
    rms = np.sqrt(np.mean(errors**2, axis=0))
    rows = [(n, *(f"{x:+.2f}" for x in e)) for n, e in zip(names, errors, strict=True)]
    return [*rows, ("RMS", *(f"{x:.2f}" for x in rms))]


def blends(shots: list[Shot], whole: list[Shot]) -> list[tuple[str, ...]]:
    """For each curve PSNR of the pairs (left out) and of the whole scenes, and their
    sum, at the best exposure and a third of the way to each mean."""
    pairs = np.array([shot.group == "pairs" for shot in shots])
    rows = []
    for curve in BLENDED_CURVES:
        family = dataclasses.replace(
            FAMILIES[SHIPPED], contrast=curve[0], shoulder=curve[1]
        )
        lit, scene = under_curve(shots, *curve), under_curve(whole, *curve)
        stops = left_out(family, shots, lit)
        weight = weights_of(shots, family.pairs)
        prior = fitted(family, lit, weight, np.ones(len(shots), bool))
        learned = scene.first + metering.correction(scene.shapes, prior)
        cells = [_both(lit.psnr(lit.best)[pairs], scene.psnr(scene.best))]
        for mean in NORMALS:
            known = (
                todays(shots, *curve, mean, True),
                todays(whole, *curve, mean, True),
            )
            a = lit.psnr(np.asarray(blended(stops, known[0])))[pairs]
            cells.append(_both(a, scene.psnr(np.asarray(blended(learned, known[1])))))
        rows.append((f"n {curve[0]}, k {curve[1]:g}", *cells))
    return rows


def _both(pairs: np.ndarray, scenes: np.ndarray) -> str:
    a, b = pairs.mean(), scenes.mean()
    return f"{a:.2f} + {b:.2f} = {a + b:.2f}"


def written(prior: Prior) -> dict:
    """The numbers as JSON, with four digits."""
    fields = dataclasses.asdict(prior)
    return {k: np.round(np.asarray(v), 4).tolist() for k, v in fields.items()}


if __name__ == "__main__":
    main()
