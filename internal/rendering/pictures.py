# SPDX-License-Identifier: Apache-2.0
"""Renderings as pictures to look at: what each output is and how it is shown.

Results are [height, width, 3] sRGB in [0, 1].
"""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import ArrayLike, Float

from internal.configs import ModelConfig
from internal.enhancements.base import Output
from internal.structs import LitRendering, Rendering

Picture = Float[np.ndarray, "height width 3"]

DARK = {
    "dark": Output("the scene as photographed: what training fits", lambda x: x.rgb)
}
DECOMPOSITION = {
    "v": Output("lighting component v, scaled to be visible", lambda x: x.v, True),
    "r": Output("colour basis r, scaled to be visible", lambda x: x.r, True),
}
DEPTH = "depth"
DEPTH_EXPLANATION = "distance, near is bright"


def outputs_of(model: ModelConfig) -> dict[str, str]:
    """What each output of a model is, by name, the result first."""
    explained = {name: x.explanation for name, x in _outputs(model).items()}
    return explained | {DEPTH: DEPTH_EXPLANATION}


@dataclasses.dataclass(frozen=True)
class Display:
    """Scales shared by all pictures of a folder, so that views can be compared."""

    outputs: Mapping[str, Output]
    whites: Mapping[str, float]  # of the outputs that are scaled
    nearest: float  # depth shown white


def display_for(model: ModelConfig, rendering: Rendering | LitRendering) -> Display:
    """Scales that suit one rendering: its 99th percentiles become white."""

    def white(values: ArrayLike) -> float:
        return max(float(np.percentile(np.asarray(values), 99.0)), 1e-6)

    outputs = _outputs(model)
    whites = {name: white(x.of(rendering)) for name, x in outputs.items() if x.scaled}
    return Display(outputs, whites, float(np.percentile(rendering.depth, 1.0)))


def pictures(
    rendering: Rendering | LitRendering, display: Display
) -> dict[str, Picture]:
    """All outputs by name, as in ``outputs_of``."""
    shown = {
        name: np.asarray(output.of(rendering)) / display.whites.get(name, 1.0)
        for name, output in display.outputs.items()
    }
    depth = np.asarray(rendering.depth)
    shown[DEPTH] = display.nearest / np.maximum(depth, display.nearest)
    return {
        name: np.clip(np.broadcast_to(x, rendering.rgb.shape), 0.0, 1.0)
        for name, x in shown.items()
    }


def _outputs(model: ModelConfig) -> dict[str, Output]:
    if model.enhancement is None:
        return dict(DARK)
    own = dict(model.enhancement.outputs)
    return {"enhanced": own.pop("enhanced"), **DARK, **DECOMPOSITION, **own}
