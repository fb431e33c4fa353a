# SPDX-License-Identifier: Apache-2.0
"""Scores of pictures against the truth. Start at `metrics`."""
