# SPDX-License-Identifier: Apache-2.0
"""What a browser shows of the live viewer: how soon, how often, and whether it jumps.

python -m benchmarks.viewer_page --run RUN [--seconds 10] [MORE FLAGS OF view.py]

Starts ``view.py`` and a headless Chromium with software WebGL, which draws on the CPU
cores that render the field. The picture is 640 x 480. Counted are frames in which the
page drew other pixels than before (a grid of them is read back after every frame),
while the mouse drags the camera in circles. Seconds to the first picture begin with the
request for the page. Where the drag ends, the splats' picture is held against the
field's that replaces it: a channel's mean, and PSNR. For that the server is stopped
until the splats are drawn at rest.
"""

import argparse
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import trials, workload
from internal.files import image_io
from internal.scoring.metrics import psnr
from tests.browser import chromium

WIDTH, HEIGHT = 640, 480
PAGES = 5
STOPS = 5
PATIENCE = 1800.0  # seconds; splats may have to be baked
SPLATS = "() => window.__viserSceneTree?.getState()['/splats']?.effectiveVisibility"
CAMERA = "() => window.__viserMutable.cameraControl.camera.matrixWorld.elements.join()"
CLEAR = ".mantine-Notifications-root { visibility: hidden }"
# ``drawn``: when the page drew something new, ``first``: when that was a picture, of
# more colours than the empty stage has.
COUNT = """(() => {
  const seen = (window.seen = { drawn: [], first: null });
  let context = null, before = "";
  const kind = WebGL2RenderingContext.prototype;
  for (const name of ["drawElements", "drawArrays", "drawElementsInstanced"]) {
    const draw = kind[name];
    kind[name] = function (...parts) {
      if (this.canvas.isConnected) context = this;
      return draw.apply(this, parts);
    };
  }
  function look(gl) {
    const target = gl.getParameter(gl.FRAMEBUFFER_BINDING);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    const [wide, high] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
    const bytes = new Uint8Array(4 * wide * high), grid = [];
    gl.readPixels(0, 0, wide, high, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    gl.bindFramebuffer(gl.FRAMEBUFFER, target);
    for (let y = 0.5; y < 16; y++) for (let x = 0.5; x < 16; x++) {
      const at = 4 * (wide * Math.floor((y * high) / 16) + Math.floor((x * wide) / 16));
      grid.push((bytes[at] << 16) | (bytes[at + 1] << 8) | bytes[at + 2]);
    }
    const now = grid.join();
    if (now !== before) seen.drawn.push(performance.now());
    if (seen.first === null && new Set(grid).size > 40) seen.first = performance.now();
    before = now;
  }
  const ask = window.requestAnimationFrame.bind(window);
  window.requestAnimationFrame = (run) => ask((moment) => {
    context = null;
    run(moment);
    if (context) look(context);
  });
})();"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", required=True)
    parser.add_argument("--seconds", type=float, default=10.0, help="of moving")
    args, flags = parser.parse_known_args()
    with served(["--run", args.run, *flags]) as server, chromium() as browser:
        process, address = server
        cold = opened(browser, address).evaluate("() => window.seen.first")
        pages = [opened(browser, address) for _ in range(PAGES)]
        warm = [page.evaluate("() => window.seen.first") for page in pages]
        for page in pages[1:]:
            page.close()
        rows = [
            ("first picture, the server's first page, s", f"{cold / 1e3:.2f}"),
            (f"first picture, median of {PAGES} more, s",
             f"{statistics.median(warm) / 1e3:.2f}"),
        ]  # fmt: skip
        print(workload.markdown(("what", "measured"), rows), flush=True)
        walks = "--no_splats" not in flags
        rows = walked(pages[0], process, args.seconds, walks=walks)
    print(workload.markdown(("what", "measured"), rows))


@contextmanager
def served(flags: list[str]) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """``view.py`` with these flags, and its address."""
    command = [sys.executable, "-u", "view.py", "--port", "0", *flags]
    process = subprocess.Popen(
        command, cwd=trials.ROOT, stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout
        line = next((x for x in process.stdout if "is shown at" in x), "")
        if not line:
            sys.exit("view.py has ended")
        yield process, line.split()[-1]
    finally:
        process.send_signal(signal.SIGCONT)
        process.terminate()
        process.wait()


def opened(browser: Any, address: str) -> Any:
    """A page with its first picture, of ``WIDTH`` by ``HEIGHT``."""
    page = browser.new_page(viewport={"width": WIDTH + 320, "height": HEIGHT})
    page.set_default_timeout(PATIENCE * 1e3)
    page.add_init_script(COUNT)
    page.goto(address)
    page.wait_for_function("() => window.seen.first !== null")
    beside = WIDTH + 320 - canvas(page)["width"]
    page.set_viewport_size({"width": round(WIDTH + beside), "height": HEIGHT})
    return page


def canvas(page: Any) -> Any:
    """Where the picture lies."""
    return page.locator("canvas").first.bounding_box()


def walked(
    page: Any, server: subprocess.Popen[str], seconds: float, *, walks: bool
) -> list[tuple[str, str]]:
    """What is seen while the camera moves and where it stops."""
    if walks:
        page.wait_for_function(f"() => ({SPLATS})() != null")
    page.get_by_role("tab", name="Photos").click()
    page.get_by_label("Show photos").uncheck()
    rates, steps, scores = [], [], []
    for stop in range(STOPS):
        rates.append(dragged(page, seconds / STOPS, stop))
        if walks:
            splats, field = switched(page, server)
            levels = [x.reshape(-1, 3).mean(axis=0) for x in (splats, field)]
            steps.append(np.abs(20.0 * np.log10(levels[0] / levels[1])).max())
            scores.append(psnr(splats, field))
    rows = [
        ("frames / s while moving",
         f"{statistics.median(rates):.1f} ({min(rates):.1f} to {max(rates):.1f})"),
    ]  # fmt: skip
    if walks:
        rows += [
            ("largest step of a channel's mean, dB", f"{max(steps):.2f}"),
            ("PSNR, splats against the field, dB",
             f"{statistics.median(scores):.1f} (at least {min(scores):.1f})"),
        ]  # fmt: skip
    return rows


def dragged(page: Any, seconds: float, stop: int) -> float:
    """Frames per second while the mouse drags the camera, which is then let go."""
    mouse, began = page.mouse, time.perf_counter()
    mouse.move(WIDTH / 2, HEIGHT / 2)
    mouse.down()
    count = page.evaluate("() => window.seen.drawn.length")
    while (now := time.perf_counter() - began) < seconds:
        angle = 2.0 * np.pi * now / 4.0 + stop
        mouse.move(WIDTH / 2 + 60 * np.sin(angle), HEIGHT / 2 + 20 * np.cos(angle))
        time.sleep(1.0 / 30.0)
    elapsed = time.perf_counter() - began
    count = page.evaluate("() => window.seen.drawn.length") - count
    mouse.up()
    return count / elapsed


def switched(page: Any, server: subprocess.Popen[str]) -> tuple[np.ndarray, np.ndarray]:
    """The splats' picture where the camera comes to rest, and the field's."""
    page.mouse.down()  # a small move, which shows the splats
    page.mouse.move(WIDTH / 2 + 8, HEIGHT / 2)
    page.wait_for_function(SPLATS)
    server.send_signal(signal.SIGSTOP)
    page.mouse.up()
    camera, splats = "", np.empty(0)
    while page.evaluate(CAMERA) != camera:
        camera = page.evaluate(CAMERA)
        splats = shot(page)
    assert page.evaluate(SPLATS), "the field was faster than a screenshot of the splats"
    server.send_signal(signal.SIGCONT)
    page.wait_for_function(f"() => !({SPLATS})()")
    page.wait_for_timeout(1000)  # until it is drawn
    assert page.evaluate(CAMERA) == camera, "the camera has moved"
    return splats, shot(page)


def shot(page: Any) -> np.ndarray:
    """The picture as drawn, sRGB in [0, 1]."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "shot.png"
        page.screenshot(path=str(path), clip=canvas(page), style=CLEAR)
        return image_io.read_srgb(path)


if __name__ == "__main__":
    main()
