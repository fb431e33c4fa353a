# SPDX-License-Identifier: Apache-2.0
"""The controls that turn the light, and the gin bindings that reproduce it."""

import dataclasses
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
        *KELVIN_RANGE, 1.0, "Kelvin",
        "colour of the light: 6500 leaves it, lower is warmer",
    ),
    "tint": (*TINT_RANGE, 0.001, "Tint", "green to magenta, stops"),
    "contrast": (*CONTRAST_RANGE, 0.05, "Contrast", "of the lighting"),
}  # fmt: skip


PICK, CANCEL = "Pick something gray", "Click it, or press here to cancel"


class LightControls:
    """The light of one browser."""

    def __init__(
        self, gui: viser.GuiApi, turned: Callable[[Look], object], guarded: Guard
    ) -> None:
        """``turned`` is told each new look."""
        self._turned = turned
        self._before: Look | None = None  # the last pick
        self._sliders = {
            name: gui.add_slider(
                label, low, high, step, float(getattr(NEUTRAL, name)), hint=hint
            )
            for name, (low, high, step, label, hint) in SLIDERS.items()
        }
        self._pick = gui.add_button(
            PICK, hint="then click it in the picture: temperature and tint follow"
        )
        self._undo = gui.add_button("Undo the pick", visible=False)
        reset = gui.add_button("Reset the light")
        self._bindings = gui.add_text(
            "For gin", "\n".join(NEUTRAL.bindings()), multiline=True,
            hint="this light's bindings, for render.py",
        )  # fmt: skip
        on_change(guarded(self._turn), *self._sliders.values())
        self._pick.on_click(guarded(self._start_or_cancel))
        self._undo.on_click(guarded(self._take_back))
        reset.on_click(guarded(self._reset))

    @property
    def is_picking(self) -> bool:
        """Whether the next click in the picture is on something gray."""
        return self._pick.label == CANCEL

    def pick(self, find: Callable[[], Look]) -> None:
        """Ends picking with the light that is found."""
        self._pick.label = PICK
        look = find()
        self._before = self._look()
        self._undo.visible = True
        self._set(look)

    def _look(self) -> Look:
        return Look(**{name: float(s.value) for name, s in self._sliders.items()})

    def _set(self, look: Look) -> None:
        for name, value in dataclasses.asdict(look).items():
            self._sliders[name].value = value

    async def _turn(self, _: object) -> None:
        look = self._look()
        self._bindings.value = "\n".join(look.bindings())
        self._turned(look)

    async def _start_or_cancel(self, _: object) -> None:
        self._pick.label = PICK if self.is_picking else CANCEL

    async def _take_back(self, _: object) -> None:
        self._undo.visible = False
        if self._before:
            before = self._before
            self._set(
                dataclasses.replace(
                    self._look(), temperature=before.temperature, tint=before.tint
                )
            )

    async def _reset(self, _: object) -> None:
        self._undo.visible = False
        self._set(NEUTRAL)
