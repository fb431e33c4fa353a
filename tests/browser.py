# SPDX-License-Identifier: Apache-2.0
"""A real headless Chromium for tests, where one is installed."""

import os
import shutil
import time
from collections.abc import Callable, Iterator

import pytest

# Software WebGL, and no calls home: tests run where there is neither GPU nor network.
ARGUMENTS = (
    "--no-sandbox --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader "
    "--disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
).split()
PATIENCE = 120.0  # seconds; machines may be busy


def chromium() -> Iterator:
    """Yields a browser; skips the test unless it is asked for and can be had."""
    if not os.environ.get("LLNERF_BROWSER"):
        pytest.skip("set LLNERF_BROWSER=1 to drive the pages in Chromium")
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    if path is None:
        pytest.skip("no chromium installed (Debian: apt-get install chromium)")
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        yield browser
        browser.close()


def until(holds: Callable[[], object], what: str) -> None:
    """Waits for something to hold; fails when it does not in ``PATIENCE``."""
    end = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < end, f"not in {PATIENCE} s: {what}"
        time.sleep(0.1)
