# SPDX-License-Identifier: Apache-2.0
"""Everything that touches files: whole-or-nothing writes, images, RAW, videos. Start
at `image_io`."""
