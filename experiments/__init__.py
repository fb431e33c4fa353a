# SPDX-License-Identifier: Apache-2.0
"""Commands that fit the numbers this project ships and write what was tried.

``README.md`` is the notebook, the other texts are what a command of that name printed.
"""
