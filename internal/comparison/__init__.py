# SPDX-License-Identifier: Apache-2.0
"""compare.py: many methods on many scenes, one table. Start at `jobs`."""
