# SPDX-License-Identifier: Apache-2.0
"""A real headless Chromium for tests, where one is installed."""

import contextlib
import shutil
import time
from collections.abc import Callable, Iterator

import pytest

# Software WebGL, and no calls home: tests run where there is neither GPU nor network.
ARGUMENTS = (
    "--no-sandbox --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader "
    "--disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --disable-dev-shm-usage --mute-audio"
).split()
NAMES = ("chromium", "google-chrome", "chromium-browser")
PATIENCE = 90.0  # seconds; machines may be busy


@contextlib.contextmanager
def chromium() -> Iterator:
    """A browser; skips the test where none is installed or none starts."""
    sync_api = pytest.importorskip("playwright.sync_api")
    path = next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        pytest.skip("no Chromium is installed (Debian: apt-get install chromium)")
    with sync_api.sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        except sync_api.Error as error:
            pytest.skip(f"{path} does not start: {str(error).splitlines()[0]}")
        yield browser
        browser.close()


def until(holds: Callable[[], object], what: str) -> None:
    """Waits for something to hold; fails when it does not in ``PATIENCE``."""
    end = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < end, f"not in {PATIENCE} s: {what}"
        time.sleep(0.05)
