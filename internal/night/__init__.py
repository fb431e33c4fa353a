# SPDX-License-Identifier: Apache-2.0
"""A ray-traced scene, and the capture model that darkens any. Start at `dataset`."""
