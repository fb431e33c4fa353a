# SPDX-License-Identifier: Apache-2.0
"""Commands that fit the numbers this project ships and write what was tried."""
