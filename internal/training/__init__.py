# SPDX-License-Identifier: Apache-2.0
"""One run: the train step, its pixels, its optimiser, its folder. Start at `step`."""
