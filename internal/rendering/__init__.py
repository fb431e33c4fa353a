# SPDX-License-Identifier: Apache-2.0
"""Whole pictures of a trained model, along camera paths. Start at `renderer`."""
