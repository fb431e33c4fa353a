# SPDX-License-Identifier: Apache-2.0
"""The library behind the scripts at the root of the repository.

They run from there; nothing named ``internal`` is installed.
"""
