# SPDX-License-Identifier: Apache-2.0
"""Commands behind docs/performance.md. Each prints one Markdown table.

python -m benchmarks.train_step DATA_DIR
"""
