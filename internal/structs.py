# SPDX-License-Identifier: Apache-2.0
"""What passes between field, sampler, enhancement and losses, as pytrees.

Rays are flat, ``*rays``; samples along a ray are the axis after them. Colours and
their factors are display-coded (sRGB), non-negative, and may exceed 1.
"""

from typing import Any

import numpy as np
from flax import struct
from jax import Array
from jaxtyping import Float

Params = Any  # flax's nested dictionary of arrays by module name
Terms = dict[str, Float[Array, ""]]  # weighted loss terms by name


@struct.dataclass
class Colored:
    """A plain field's answer at samples: density and colour."""

    density: Float[Array, "*b n"]
    rgb: Float[Array, "*b n 3"]


@struct.dataclass
class Decomposed:
    """A decomposed field's answer at samples; its colour is v * r (LLNeRF Eq. 3)."""

    density: Float[Array, "*b n"]
    v: Float[Array, "*b n 1"]  # view-dependent lighting component
    r: Float[Array, "*b n 3"]  # view-independent colour basis
    features: Float[Array, "*b n f"]  # what phi sees besides v

    @property
    def rgb(self) -> Float[Array, "*b n 3"]:
        """The dark colour."""
        return self.v * self.r


@struct.dataclass
class Histogram:
    """One level of hierarchical sampling: where along the rays, and how much there."""

    s_edges: Float[Array, "*rays n_edges"]
    weights: Float[Array, "*rays n"]


@struct.dataclass
class Level(Histogram):
    """A level at which the field itself was asked."""

    rgb: Float[Array, "*rays 3"]  # dark colour
    samples: Decomposed | Colored  # ``[rays, n, ...]``


@struct.dataclass
class Levels:
    """All levels of hierarchical sampling, coarse before fine."""

    proposals: tuple[Histogram, ...]  # of a field that has a proposal
    coarse: tuple[Level, ...]  # of one that has none
    last: Level


@struct.dataclass
class Rendering:
    """Pixels of the last level."""

    rgb: Float[Array | np.ndarray, "*rays 3"]  # the dark picture, c
    depth: Float[Array | np.ndarray, "*rays 1"]  # along the camera's axis, model units


@struct.dataclass
class Lit:
    """What an enhancement makes of rays; each adds what explains its own."""

    enhanced: Float[Array | np.ndarray, "*rays 3"]  # c_hat


@struct.dataclass
class LitRendering(Rendering):
    """A rendering with its decomposition and enhancement."""

    v: Float[Array | np.ndarray, "*rays 1"]
    r: Float[Array | np.ndarray, "*rays 3"]
    lit: Lit

    @property
    def enhanced(self) -> Float[Array | np.ndarray, "*rays 3"]:
        """The lit picture, c_hat."""
        return self.lit.enhanced
