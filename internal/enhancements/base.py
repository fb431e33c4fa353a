# SPDX-License-Identifier: Apache-2.0
"""The small interface behind which enhancements differ.

The field, its losses, sampling, rendering, pages and the viewer are the same for all
of them. An enhancement reads what the field holds and never moves it.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jax import Array
from jaxtyping import Float

from internal.enhancements.look import LightEdit
from internal.structs import Level, Lit, LitRendering, Terms


@dataclasses.dataclass(frozen=True)
class Output:
    """A picture that an enhancement adds to the results."""

    explanation: str  # one line, for people
    of: Callable[[Any], Float[Array | np.ndarray, "*rays _channels"]]  # a rendering
    scaled: bool = False  # shown over its 99th percentile, else as it is


@runtime_checkable
class Network(Protocol):
    """A Flax module: the one way to the lit colours, in training and rendering."""

    def __call__(self, level: Level, edit: LightEdit) -> Lit:
        """Lights rays up.

        Args:
            level: what the field holds along rays, without gradients.
            edit: the light that the user wants.
        """
        ...

    def relight(self, rendering: LitRendering, edit: LightEdit) -> Lit:
        """The same rays under ``edit``, of a rendering under ``along_rays(edit)``."""
        ...


@runtime_checkable
class Enhancement(Protocol):
    """Sizes, weights and constants of one kind of enhancement."""

    @property
    def neighbors(self) -> int:
        """Pixels beside each one that its losses look at: 0, or 2 (right and below)."""
        ...

    @property
    def whole_batch(self) -> bool:
        """Whether its losses are of a batch as a whole, not means over its pixels."""
        ...

    @property
    def outputs(self) -> Mapping[str, Output]:
        """What it adds to the pictures of a view, by name; "enhanced" among them."""
        ...

    def network(self, name: str) -> Network:
        """Its Flax module, called ``name`` inside its parent."""
        ...

    def metered(self, dark_srgb: Float[np.ndarray, "n 3"]) -> "Enhancement":
        """The same, with what it takes from the training photos before the first
        step; most take nothing and return themselves."""
        ...

    def along_rays(self, edit: LightEdit) -> LightEdit:
        """The part of an edit that must be known while rays are followed; ``relight``
        does the rest on finished pixels."""
        ...

    def terms(self, rendering: LitRendering) -> Terms:
        """Its weighted losses.

        Args:
            rendering: of a batch's rays in the neutral light; the ``neighbors`` of a
                pixel follow it.
        """
        ...
