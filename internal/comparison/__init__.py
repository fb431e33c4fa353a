# SPDX-License-Identifier: Apache-2.0
"""Many trainings in one table: compare.py's, methods on scenes, start at `jobs`;
sweep.py's, variants of a configuration, at `variants`."""
