# SPDX-License-Identifier: Apache-2.0
"""A look: how a user wants the scene lit, in the words of ``RenderConfig``.

What the numbers mean and their ranges stand in ``internal/editing.py``.
"""

import dataclasses

from internal.configs import RenderConfig
from internal.enhancements.editing import LightEdit, light_edit


@dataclasses.dataclass(frozen=True)
class Look:
    """Light settings; the defaults show the scene as learned."""

    strength: float = 1.0  # 0: dark, 1: enhanced
    exposure: float = 0.0  # stops
    temperature: float = 6500.0  # kelvin
    tint: float = 0.0  # stops of magenta over green
    contrast: float = 1.0

    def edit(self) -> LightEdit:
        """What the model needs to know of it.

        Raises:
            UserError: a setting is out of range.
        """
        return light_edit(
            self.strength, self.exposure, self.temperature, self.tint, self.contrast
        )

    def bindings(self) -> tuple[str, ...]:
        """The gin bindings that make render.py show it."""
        settings = dataclasses.asdict(self)
        return tuple(f"Render.{name} = {value!r}" for name, value in settings.items())


def configured_look(render: RenderConfig) -> Look:
    """The look that a configuration asks for."""
    names = [field.name for field in dataclasses.fields(Look)]
    return Look(**{name: getattr(render, name) for name in names})
