# SPDX-License-Identifier: Apache-2.0
"""Laws, by module; what they share is in conftest and the modules without test_."""
