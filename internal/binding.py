# SPDX-License-Identifier: Apache-2.0
"""What makes a frozen dataclass bindable: gin fills it, beartype checks its types.

Only this module and ``configs.py`` know gin.
"""

from typing import Any

import gin
from beartype import BeartypeConf, beartype

configurable: Any = gin.configurable
typed: Any = beartype(conf=BeartypeConf(is_pep484_tower=True))
