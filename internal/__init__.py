# SPDX-License-Identifier: Apache-2.0
"""The library behind train.py, eval.py, render.py and sweep.py.

Scripts run from the repository root; nothing named ``internal`` is installed.
"""
