# SPDX-License-Identifier: Apache-2.0
"""Enhancements: what lights the dark scene up. A module each, which gin knows.

``gamma`` is the paper's, ``tone`` ours; ``Model.enhancement = @Tone()`` chooses. A new
one is a new module with the methods of ``base.Enhancement`` and no edit elsewhere.
``look`` is what a user asks of any, ``metering`` how ``tone`` finds its exposure.
"""

import importlib
import pkgutil


def register() -> None:
    """Imports every module here, so that gin knows each enhancement's name."""
    for module in pkgutil.iter_modules(__path__):
        importlib.import_module(f"{__name__}.{module.name}")
