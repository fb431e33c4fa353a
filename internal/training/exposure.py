# SPDX-License-Identifier: Apache-2.0
"""What an enhancement takes from the photos before the first step.

It stands in the run's config.json, so that whatever renders the run lights it alike.
"""

import dataclasses

import numpy as np

from internal.color import from_uint16
from internal.configs import Config
from internal.scene.scene import Scene

PIXELS_METERED = 300_000  # of all training photos, evenly


def metered(config: Config, scene: Scene) -> Config:
    """The configuration with an enhancement that knows the scene's light.

    Args:
        scene: the training split.
    """
    enhancement = config.model.enhancement
    if enhancement is None:
        return config
    total = sum(image.shape[0] * image.shape[1] for image in scene.images)
    stride = max(total // PIXELS_METERED, 1)
    pixels = [np.reshape(image, (-1, 3))[::stride] for image in scene.images]
    found = enhancement.metered(from_uint16(np.concatenate(pixels)))
    return dataclasses.replace(
        config, model=dataclasses.replace(config.model, enhancement=found)
    )
