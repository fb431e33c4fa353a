# SPDX-License-Identifier: Apache-2.0
"""Devices: the mesh, shares of processes, the line that says what computes."""

import jax
import pytest

from internal import parallel
from internal.errors import UserError


def test_all_devices_are_used_and_a_batch_must_divide_among_them():
    assert parallel.data_mesh(8).devices.size == jax.device_count() == 4
    with pytest.raises(UserError, match=r"batch_size = 6 .* 4 devices"):
        parallel.data_mesh(6)


def test_devices_are_named():
    assert parallel.describe_devices().startswith("devices: 4 x cpu")


def test_an_unused_gpu_is_shouted_about(monkeypatch):
    monkeypatch.setattr(parallel, "_gpu_present", lambda: True)
    line = parallel.describe_devices()
    assert "WARNING" in line and "jax[cuda13]" in line


def test_shares_of_processes_cover_the_batch(monkeypatch):
    monkeypatch.setattr(jax, "process_count", lambda: 4)
    rows = []
    for process in range(4):
        monkeypatch.setattr(jax, "process_index", lambda process=process: process)
        rows += range(20)[parallel.process_share(20)]
    assert rows == list(range(20))
