# SPDX-License-Identifier: Apache-2.0
"""Many runs, on this machine or on a cluster. Start at `launch`."""
