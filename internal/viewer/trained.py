# SPDX-License-Identifier: Apache-2.0
"""A model as the viewer holds it."""

import dataclasses

from internal.rendering.pictures import Display
from internal.structs import Params


@dataclasses.dataclass(frozen=True)
class Trained:
    """A checkpoint that can be shown."""

    params: Params
    step: int
    display: Display  # of the first view, as in render.py
