# SPDX-License-Identifier: Apache-2.0
"""Commands behind the numbers in docs/, and those that break scenes, runs and scripts
(faults, kills, shortages, messages). Each prints a Markdown table or a line per case.

python -m benchmarks.train_step DATA_DIR
"""
