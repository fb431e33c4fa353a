# SPDX-License-Identifier: Apache-2.0
"""The controls that turn the light, and the gin bindings that reproduce it."""

from collections.abc import Callable

import viser

from internal.enhancements.look import CONTRAST_RANGE, KELVIN_RANGE, TINT_RANGE, Look
from internal.viewer.handlers import Guard, on_change

NEUTRAL = Look()
# Lowest, highest, step, label, hint.
SLIDERS = {
    "strength": (0.0, 1.0, 0.05, "Strength", "0: as photographed, 1: as learned"),
    "exposure": (-4.0, 4.0, 0.1, "Exposure", "stops"),
    "temperature": (
        KELVIN_RANGE[0], 15000.0, 100.0, "Kelvin",
        "colour of the light: 6500 leaves it, lower is warmer",
    ),
    "tint": (*TINT_RANGE, 0.05, "Tint", "green to magenta, stops"),
    "contrast": (*CONTRAST_RANGE, 0.05, "Contrast", "of the lighting"),
}  # fmt: skip


class LightControls:
    """The light of one browser."""

    def __init__(
        self, gui: viser.GuiApi, turned: Callable[[Look], None], guarded: Guard
    ) -> None:
        """``turned`` is told each new look."""
        self._turned = turned
        self._sliders = {
            name: gui.add_slider(
                label, low, high, step, float(getattr(NEUTRAL, name)), hint=hint
            )
            for name, (low, high, step, label, hint) in SLIDERS.items()
        }
        reset = gui.add_button("Reset the light")
        self._bindings = gui.add_text(
            "For gin", "\n".join(NEUTRAL.bindings()), multiline=True,
            hint="this light's bindings, for render.py",
        )  # fmt: skip
        on_change(guarded(self._turn), *self._sliders.values())
        reset.on_click(guarded(self._reset))

    async def _turn(self, _: object) -> None:
        look = Look(**{name: float(s.value) for name, s in self._sliders.items()})
        self._bindings.value = "\n".join(look.bindings())
        self._turned(look)

    async def _reset(self, _: object) -> None:
        for name, slider in self._sliders.items():
            slider.value = getattr(NEUTRAL, name)
