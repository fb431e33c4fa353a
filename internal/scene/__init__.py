# SPDX-License-Identifier: Apache-2.0
"""From a folder of photos and poses to arrays. Start at `scene`."""
