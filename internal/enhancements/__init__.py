# SPDX-License-Identifier: Apache-2.0
"""Enhancements: what lights the dark scene up. One module each, known to gin by name.

``gamma`` is the paper's, ``tone`` ours; ``Model.enhancement = @Tone()`` chooses. A new
one is a new module with the methods of ``base.Enhancement`` and no edit elsewhere.
"""

import importlib
import pkgutil


def register() -> None:
    """Imports every module here, so that gin knows each enhancement's name."""
    for module in pkgutil.iter_modules(__path__):
        importlib.import_module(f"{__name__}.{module.name}")
