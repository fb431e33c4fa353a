# SPDX-License-Identifier: Apache-2.0
"""What a training or rendering process needs before it starts, in one place.

Scripts restart themselves once with these variables; importing the package sets
nothing. A variable that the user has set stays as it is, and LLNERF_PLAIN=1 turns all
of it off.

- GLIBC_TUNABLES: large pages and no returning of memory between steps; on a CPU page
  faults of large temporaries otherwise cost a third of the fast field's step.
- JAX_COMPILATION_CACHE_DIR: compiled programs are kept, so that the second start of
  the same command compiles nothing.
"""

import os
import sys
from pathlib import Path

_GIBIBYTE = 1 << 30
_MALLOC = {
    "hugetlb": 1,
    "mmap_threshold": 4 * _GIBIBYTE,
    "trim_threshold": 16 * _GIBIBYTE,
    "top_pad": _GIBIBYTE // 4,
}
_MARK = "LLNERF_PLAIN"


def wanted_environment(environment: dict[str, str]) -> dict[str, str]:
    """The variables to add to ``environment``; none where it says so itself."""
    if environment.get(_MARK):
        return {}
    malloc = ":".join(f"glibc.malloc.{name}={value}" for name, value in _MALLOC.items())
    home = environment.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    wanted = {
        "GLIBC_TUNABLES": malloc,
        "JAX_COMPILATION_CACHE_DIR": str(Path(home) / "llnerf-jax"),
    }
    return {k: value for k, value in wanted.items() if k not in environment}


def restart_tuned() -> None:
    """Replaces this process by the same command with the wanted variables, once."""
    wanted = wanted_environment(dict(os.environ))
    if wanted:
        environment = {**os.environ, **wanted, _MARK: "1"}
        os.execve(sys.executable, sys.orig_argv, environment)
