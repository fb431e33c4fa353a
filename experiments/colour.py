# SPDX-License-Identifier: Apache-2.0
"""Where the curve acts and how much colour it leaves: every way at its best exposure.

python -m experiments.colour      # prints one Markdown table of experiments/captures.py

The exposure is chosen with the truth for each capture, so that only colour differs.
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from benchmarks.workload import markdown
from experiments import captures
from experiments.captures import Shot
from internal.color import linear_to_srgb, photo_to_linear
from internal.enhancements import tone
from internal.enhancements.look import LUMINANCE_WEIGHTS
from internal.enhancements.metering import developed

CONTRAST, SHOULDER = 1.2, 2.0
STOPS = np.arange(1.0, 10.1, 0.5)
EVERY = 24  # of the darkened captures
PIXELS = 512  # of a capture
LEAST = (0.10, 0.14)  # colourfulness that is asked for
GROUPS = (("pairs", 0), ("ordinary", 30), ("ordinary", 8), ("bright", 8))

Pixels = Float[np.ndarray, "n 3"]
Way = Callable[[Pixels], Pixels]  # exposed linear light to sRGB


def main() -> None:
    shots = captures.shots()
    ways: dict[str, Way] = {"each channel": per_channel}
    for saturation in (0.8, 0.9, 1.1, 1.2):
        ways[f"each channel, saturation {saturation}"] = saturated(saturation)
    for least in LEAST:
        ways[f"each channel, colourfulness at least {least}"] = at_least(least)
    ways["largest channel, ratios kept"] = largest_channel
    ways["luminance, ratios kept"] = luminance
    rows = []
    for name, way in ways.items():
        cells = [
            f"{np.mean([best(way, s) for s in chosen(shots, g)]):.2f}" for g in GROUPS
        ]
        rows.append((name, *cells))
    print(markdown(("curve on", *(f"{g} {n}" if n else g for g, n in GROUPS)), rows))


def chosen(shots: list[Shot], group: tuple[str, int]) -> list[Shot]:
    found = [shot for shot in shots if (shot.group, shot.level) == group]
    return found[:: 2 if group[0] == "pairs" else EVERY // 2]


def best(way: Way, shot: Shot) -> float:
    """PSNR in dB at the best exposure."""
    light = photo_to_linear(shot.dark[:PIXELS] / 255.0)
    truth = shot.truth[:PIXELS] / 255.0
    errors = [np.mean((way(light * 2.0**stops) - truth) ** 2) for stops in STOPS]
    return float(-10.0 * np.log10(min(errors)))


def curve(light: np.ndarray) -> np.ndarray:
    return developed(light, 0.0, CONTRAST, SHOULDER)


def per_channel(light: Pixels) -> Pixels:
    return curve(light)


def saturated(saturation: float) -> Way:
    """Colours nearer to or farther from their gray before the curve."""

    def way(light: Pixels) -> Pixels:
        gray = (light @ LUMINANCE_WEIGHTS)[:, None]
        return curve(np.maximum(gray + saturation * (light - gray), 0.0))

    return way


def at_least(colourfulness: float) -> Way:
    """The least saturation, 1 to 2, after which colours are this far from gray."""

    def way(light: Pixels) -> Pixels:
        low, high = 1.0, 2.0
        for _ in range(8):
            middle = (low + high) / 2.0
            pale = np.mean(np.ptp(saturated(middle)(light), axis=-1)) < colourfulness
            low, high = (middle, high) if pale else (low, middle)
        return saturated(low)(light)

    return way


def largest_channel(light: Pixels) -> Pixels:
    """The curve on v, the largest channel; hue and saturation stay."""
    largest = np.maximum(light.max(axis=-1, keepdims=True), 1e-9)
    return np.asarray(linear_to_srgb(light / largest * _response(largest)))


def luminance(light: Pixels) -> Pixels:
    """The curve on luminance; colours too bright for white go towards their gray."""
    gray = np.maximum((light @ LUMINANCE_WEIGHTS)[:, None], 1e-9)
    lit = _response(gray)
    colour = light / gray * lit
    most = colour.max(axis=-1, keepdims=True)
    kept = np.clip((1.0 - lit) / np.maximum(most - lit, 1e-9), 0.0, 1.0)
    return np.asarray(linear_to_srgb(lit + (colour - lit) * kept))


def _response(light: np.ndarray) -> np.ndarray:
    return np.asarray(tone.response(jnp.asarray(light), CONTRAST, SHOULDER))


if __name__ == "__main__":
    main()
