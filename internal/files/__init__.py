# SPDX-License-Identifier: Apache-2.0
"""Kinds of files, one module each: pictures, RAW, videos, PLY, HTML; how they appear
whole or not at all (`atomic`, `made_folder`), what is `kept`. Start at `image_io`."""
