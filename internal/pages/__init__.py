# SPDX-License-Identifier: Apache-2.0
"""Result pages, tables, charts and figures. Start at `pages`."""
