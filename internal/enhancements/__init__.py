# SPDX-License-Identifier: Apache-2.0
"""Enhancements: what turns the dark rendering into the lit one. One module each."""
