# SPDX-License-Identifier: Apache-2.0
"""Fields: what answers at a sample. One module each; all are known to gin by name.

A field is a frozen, gin-configurable dataclass with the two methods of
``base.FieldConfig``; ``Model.field = @HashGrid()`` chooses it. A new one is a new
module in this folder and no edit elsewhere.
"""

import importlib
import pkgutil


def register() -> None:
    """Imports every module here, so that gin knows each field's name."""
    for module in pkgutil.iter_modules(__path__):
        importlib.import_module(f"{__name__}.{module.name}")
