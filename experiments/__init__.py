# SPDX-License-Identifier: Apache-2.0
"""Commands behind what docs/experiments.md reports. Each prints one Markdown table."""
