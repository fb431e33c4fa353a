# SPDX-License-Identifier: Apache-2.0
"""A real headless Chromium for tests, where one is installed."""

import contextlib
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest

# Software WebGL, and no calls home: tests run where there is neither GPU nor network.
PLAIN = (
    "--no-sandbox --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --disable-dev-shm-usage --mute-audio"
).split()
ARGUMENTS = (
    *PLAIN,
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
)
WITHOUT_WEBGL = (*PLAIN, "--disable-3d-apis")
NAMES = ("chromium", "google-chrome", "chromium-browser")
PATIENCE = 90.0  # seconds; machines may be busy


@contextlib.contextmanager
def chromium() -> Iterator:
    """A browser; skips the test where none is installed or none starts."""
    sync_api = pytest.importorskip("playwright.sync_api")
    if installed() is None:
        pytest.skip("no Chromium is installed (Debian: apt-get install chromium)")
    with sync_api.sync_playwright() as playwright:
        try:
            browser = launched(playwright.chromium, ARGUMENTS)
        except sync_api.Error as error:
            pytest.skip(f"{installed()}: no start: {str(error).splitlines()[0]}")
        yield browser
        browser.close()


def installed() -> str | None:
    """The path of the browser that is used."""
    return next(filter(None, map(shutil.which, NAMES)), None)


def launched(browser_type: Any, arguments: Sequence[str]) -> Any:
    """A browser of its own with these arguments."""
    return browser_type.launch(executable_path=installed(), args=list(arguments))


def until(holds: Callable[[], object], what: str) -> None:
    """Waits for something to hold; fails when it does not in ``PATIENCE``."""
    end = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < end, f"not in {PATIENCE} s: {what}"
        time.sleep(0.05)
