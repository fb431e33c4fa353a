# SPDX-License-Identifier: Apache-2.0
"""Renderings as pictures to look at: what each output is and how it is shown.

Results are [height, width, 3] sRGB in [0, 1].
"""

import dataclasses

import numpy as np
from jaxtyping import ArrayLike, Float

from internal.configs import ModelConfig
from internal.models import GammaRendering, LitRendering, Rendering

Picture = Float[np.ndarray, "height width 3"]

EXPLANATIONS = {
    "enhanced": "the lit scene, c_hat = v_hat * r: the result",
    "dark": "the scene as photographed, c = v * r",
    "v": "lighting component v, scaled to be visible",
    "r": "colour basis r, scaled to be visible",
    "v_enhanced": "enhanced lighting v_hat, scaled to be visible",
    "alpha": "alpha of the enhancement: lighting gain is 1 / alpha",
    "gamma": "gamma of the enhancement: change of the exponent per channel",
    "depth": "distance, near is bright",
}


def outputs_of(model: ModelConfig) -> tuple[str, ...]:
    """The outputs that a model has, of ``EXPLANATIONS``."""
    missing: set[str] = set()
    if not model.decomposition:
        missing = EXPLANATIONS.keys() - {"dark", "depth"}
    elif model.enhancement == "tone":
        missing = {"alpha", "gamma"}
    return tuple(name for name in EXPLANATIONS if name not in missing)


@dataclasses.dataclass(frozen=True)
class Display:
    """Scales shared by all pictures of a folder, so that views can be compared."""

    v: float
    r: float
    v_enhanced: float
    nearest: float  # depth shown white


def display_for(rendering: Rendering | LitRendering) -> Display:
    """Scales that suit one rendering: its 99th percentiles become white."""

    def white(values: ArrayLike) -> float:
        return max(float(np.percentile(np.asarray(values), 99.0)), 1e-6)

    nearest = float(np.percentile(rendering.depth, 1.0))
    if not isinstance(rendering, LitRendering):
        return Display(1.0, 1.0, 1.0, nearest)
    return Display(
        white(rendering.v), white(rendering.r), white(rendering.v_enhanced), nearest
    )


def pictures(
    rendering: Rendering | LitRendering, display: Display
) -> dict[str, Picture]:
    """All outputs by name, as in ``EXPLANATIONS``; a plain NeRF has dark and depth."""
    shown = {
        "dark": rendering.rgb,
        "depth": display.nearest / np.maximum(rendering.depth, display.nearest),
    }
    if isinstance(rendering, LitRendering):
        shown |= {
            "enhanced": rendering.enhanced,
            "v": rendering.v / display.v,
            "r": rendering.r / display.r,
            "v_enhanced": rendering.v_enhanced / display.v_enhanced,
        }
    if isinstance(rendering, GammaRendering):
        shown |= {"alpha": rendering.alpha, "gamma": rendering.gamma}
    return {
        name: np.clip(np.broadcast_to(shown[name], rendering.rgb.shape), 0.0, 1.0)
        for name in EXPLANATIONS
        if name in shown
    }
