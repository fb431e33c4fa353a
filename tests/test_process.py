# SPDX-License-Identifier: Apache-2.0
"""What scripts set before they start: once, and never over the user's own."""

from internal import process


def test_what_the_user_set_stays():
    own = {"GLIBC_TUNABLES": "glibc.malloc.arena_max=1", "XDG_CACHE_HOME": "/cache"}
    wanted = process.wanted_environment(own)
    assert wanted == {"JAX_COMPILATION_CACHE_DIR": "/cache/llnerf-jax"}


def test_a_restarted_or_plain_process_wants_nothing():
    assert process.wanted_environment({"LLNERF_PLAIN": "1"}) == {}


def test_restarting_runs_the_same_command(monkeypatch):
    calls = []
    monkeypatch.setattr(process.os, "environ", {"PATH": "/bin"})
    monkeypatch.setattr(process.os, "execve", lambda *args: calls.append(args))
    monkeypatch.setattr(process.sys, "orig_argv", ["python", "-m", "tool", "--flag"])
    process.restart_tuned()
    ((_, arguments, environment),) = calls
    assert arguments == ["python", "-m", "tool", "--flag"]
    assert environment["PATH"] == "/bin" and environment["LLNERF_PLAIN"] == "1"
    assert "glibc.malloc.hugetlb=1" in environment["GLIBC_TUNABLES"]
