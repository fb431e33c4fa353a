# SPDX-License-Identifier: Apache-2.0
"""Single cameras that a user steers, in a few fixed sizes.

Poses are camera-to-world ``[3, 4]``, OpenGL, model frame. All sizes and shapes of
windows share one compiled program.
"""

import dataclasses
import math

import numpy as np
from jaxtyping import Float

from internal.cameras import Cameras, Lens
from internal.scene.colmap import focal_lengths, lens_table

PIXELS = {"200 x 150": 200 * 150, "500 x 375": 500 * 375, "1000 x 750": 1000 * 750}
# On the way to a full picture; each about half of the next or less.
COARSE_PIXELS = (50 * 38, 100 * 75, 141 * 106, 200 * 150)
SMALLEST_SIDE = 4  # pixels; windows may be arbitrarily thin
SAME_PLACE = 1e-5  # model units; browsers round
ALIKE = 2e-3  # radians and model units: a pixel or two
WIDEST_FOV = math.radians(150.0)


@dataclasses.dataclass(frozen=True)
class FreeCamera:
    """Where a user stands, and through what window the scene is seen."""

    camtoworld: Float[np.ndarray, "3 4"]
    fov: float  # vertical, radians
    aspect: float  # width over height

    def lens(self, pixels: int) -> Lens:
        """A pinhole of this window with at most about ``pixels`` pixels."""
        height = max(round(math.sqrt(pixels / self.aspect)), SMALLEST_SIDE)
        width = max(min(round(height * self.aspect), pixels // height), SMALLEST_SIDE)
        half_height = math.tan(min(self.fov, WIDEST_FOV) / 2.0)
        # Whole pixels have other proportions than the window they are stretched to.
        fx = width / 2.0 / (half_height * self.aspect)
        fy = height / 2.0 / half_height
        return Lens("PINHOLE", width, height, (fx, fy, width / 2, height / 2))

    def seen_in(self, aspect: float) -> "FreeCamera":
        """As wide as this one at least, in a window of other proportions."""
        wider = math.tan(self.fov / 2.0) * max(self.aspect / aspect, 1.0)
        fov = min(2.0 * math.atan(wider), WIDEST_FOV)
        return dataclasses.replace(self, fov=fov, aspect=aspect)

    def is_at(self, other: "FreeCamera") -> bool:
        """Whether nobody could tell the two from each other."""
        return self._is_near(other, SAME_PLACE)

    def looks_like(self, other: "FreeCamera") -> bool:
        """Whether nobody would see the one's picture jump to the other's."""
        return self._is_near(other, ALIKE)

    def _is_near(self, other: "FreeCamera", tolerance: float) -> bool:
        apart = np.abs(self.camtoworld - other.camtoworld).max()
        return (
            bool(apart < tolerance)
            and math.isclose(self.fov, other.fov, rel_tol=tolerance)
            and self.aspect == other.aspect
        )


def single_camera(camtoworld: Float[np.ndarray, "3 4"], lens: Lens) -> Cameras:
    """One camera, ready to be rendered without compiling anew."""
    return Cameras(
        camtoworlds=camtoworld[None].astype(np.float32),
        directions=lens_table(lens),
        table_starts=np.zeros(1, np.int32),
        widths=np.array([lens.width], np.int32),
        heights=np.array([lens.height], np.int32),
    )


def vertical_fov(lens: Lens) -> float:
    """The angle in radians between the rays through the top and bottom of a picture,
    for an undistorted lens whose axis meets the middle."""
    return 2.0 * math.atan(lens.height / 2.0 / focal_lengths(lens)[1])
