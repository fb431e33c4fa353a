# SPDX-License-Identifier: Apache-2.0
"""Scores of test views, and the trivial baselines beside them.

Scores of a view are, where it has a dark photo, ``{"dark": {...}}`` against that and,
where it has a normal-light truth, ``{"enhanced": {...}}`` and one entry per baseline
against that truth; one baseline, ``unchanged``, is the dark rendering itself. Pictures
are [height, width, 3] sRGB in [0, 1]; masks are True where a pixel counts.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from internal import color
from internal.enhancements.look import NEUTRAL, LightEdit
from internal.scene.masks import Mask
from internal.scoring import baselines, metrics
from internal.structs import LitRendering, Rendering

Scores = dict[str, dict[str, float]]
Pictures = dict[str, Float[np.ndarray, "_height _width 3"]]  # by name

DEFINITIONS = {
    "psnr": "PSNR (dB)",
    "ssim": "SSIM",
    "lpips": "LPIPS (AlexNet)",
    "psnr_exposure_matched": "PSNR after the best single gain in linear light (dB)",
    "psnr_color_corrected": "PSNR after the best affine map of each channel (dB)",
    "ciede2000": "CIEDE2000 (mean over pixels)",
}
LOWER_IS_BETTER = frozenset(["lpips", "ciede2000"])
BASELINES = {
    "unchanged": (lambda dark, _: dark, "the dark rendering as it is"),
    "gain_to_mean": (
        lambda dark, mask: baselines.gain_to_mean(dark, mask=mask),
        "the dark rendering times one gain in linear light to sRGB mean 0.5",
    ),
    "gamma_curve": (
        lambda dark, _: baselines.gamma_curve(dark),
        "the dark rendering to the power 1 / 2.2",
    ),
}


def light_of_photo(gain: Float[np.ndarray, " 3"]) -> LightEdit:
    """The neutral light edit in the exposure of a photo that took ``gain`` times the
    scene's linear light; truth of its view is taken to have been exposed likewise."""
    return dataclasses.replace(NEUTRAL, gains=np.asarray(gain, np.float32))


def as_photographed(
    rendering: Rendering | LitRendering, gain: Float[np.ndarray, " 3"]
) -> Rendering | LitRendering:
    """A rendering under ``light_of_photo(gain)`` whose dark colours are the photo's,
    too; a gain of 1 changes no bit."""
    rgb = jnp.asarray(rendering.rgb)
    exposed = color.expose(rgb, jnp.broadcast_to(gain, rgb.shape))
    return dataclasses.replace(rendering, rgb=np.asarray(exposed))


def score_view(
    rendering: Rendering | LitRendering,
    baseline_pictures: Pictures,
    dark: Float[np.ndarray, "height width 3"] | None,
    truth: Float[np.ndarray, "height width 3"] | None,
    mask: Mask,
) -> Scores:
    """Scores of one rendered view and of what ``brightened`` makes of it.

    Args:
        rendering: in the exposure of the photos, ``as_photographed``.
        dark: the photo; None where there is none, which holds for ``truth`` too.
        mask: of photo and truth; some pixel counts.
    """
    scores: Scores = {}
    if dark is not None:
        scores["dark"] = metrics.score_dark(np.asarray(rendering.rgb), dark, mask)
    if truth is None:
        return scores
    if isinstance(rendering, LitRendering):
        scores["enhanced"] = metrics.score(rendering.enhanced, truth, mask)
    return scores | score_pictures(baseline_pictures, truth, mask)


def score_pictures(
    pictures: Pictures, truth: Float[np.ndarray, "height width 3"], mask: Mask
) -> Scores:
    """Scores of each picture."""
    return {
        name: metrics.score(picture, truth, mask) for name, picture in pictures.items()
    }


def brightened(dark_srgb: Float[np.ndarray, "height width 3"], mask: Mask) -> Pictures:
    """What each baseline makes of a dark picture, by name."""
    return {
        name: np.asarray(brighten(dark_srgb, mask))
        for name, (brighten, _) in BASELINES.items()
    }


def mean_scores(views: dict[str, Scores]) -> Scores:
    """The mean of each score over the views that have it."""
    found: dict[str, dict[str, list[float]]] = {}
    for scores in views.values():
        for picture, row in scores.items():
            for name, score in row.items():
                found.setdefault(picture, {}).setdefault(name, []).append(score)
    return {
        picture: {name: float(np.mean(listed)) for name, listed in row.items()}
        for picture, row in found.items()
    }
