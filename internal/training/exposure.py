# SPDX-License-Identifier: Apache-2.0
"""What an enhancement takes from the photos before the first step.

It stands in the run's config.json, so that whatever renders the run lights it alike.
"""

import dataclasses

import numpy as np

from internal.color import from_uint16
from internal.configs import Config
from internal.scene.scene import Scene

PIXELS_METERED = 300_000  # of what counts in all training photos, evenly


def metered(config: Config, scene: Scene) -> Config:
    """The configuration with an enhancement that knows the scene's light.

    Args:
        scene: the training split.
    """
    enhancement = config.model.enhancement
    if enhancement is None:
        return config
    views = range(len(scene.images))
    total = sum(int(np.count_nonzero(scene.mask(view))) for view in views)
    stride = max(total // PIXELS_METERED, 1)
    pixels = [scene.pixels(view)[::stride] for view in views]
    found = enhancement.metered(from_uint16(np.concatenate(pixels)))
    return dataclasses.replace(
        config, model=dataclasses.replace(config.model, enhancement=found)
    )
