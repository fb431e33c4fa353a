# SPDX-License-Identifier: Apache-2.0
"""A trained scene in other tools' formats: ``folder.py`` is where to start reading.

Points ``[n, 3]`` are in the model's frame unless a name says otherwise; *field
space* is where the field looks positions up (NDC, or the contracted ball).
"""
