# SPDX-License-Identifier: Apache-2.0
"""What the live viewer computes per second while its camera moves, and how long a
whole picture takes once it stands still.

python -m benchmarks.viewer_speed FLAGS OF view.py [--seconds 10]

A thread plays the browser: it moves the camera at 30 Hz around the first photo, stops,
and waits for the finished picture, several times. Nothing is encoded or sent.
"""

if __name__ == "__main__":  # before the imports: they would happen twice
    from internal import process

    process.restart_tuned()

import dataclasses
import statistics
import threading
import time

import numpy as np

from benchmarks import workload
from internal import cli, flags
from internal.viewer.free_camera import FreeCamera
from internal.viewer.session import Delivery, Session
from internal.viewer.studio import Studio

ASPECT = 4.0 / 3.0  # of the window
UPDATES = 30.0  # per second, about what a browser sends
STOPS = 5


@dataclasses.dataclass
class Screen:
    """Notes when each picture arrived and how large it was."""

    frames: list[tuple[float, Delivery]] = dataclasses.field(default_factory=list)

    def show(self, frame: Delivery) -> None:
        """Takes a picture."""
        self.frames.append((time.perf_counter(), frame))

    def wait(self, after: float) -> float:
        """Seconds from then until the finished picture."""
        while True:
            for arrived, frame in reversed(self.frames):
                if arrived > after and frame.finished:
                    return arrived - after
            time.sleep(0.005)


def main() -> None:
    parser = flags.trained(__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="of moving")
    args = parser.parse_args()
    config = cli.start_trained(args)
    studio = Studio(config, cli.load_split(config, "train"))
    screen = Screen()
    session = Session(studio, screen.show, print)
    studio.turns.join(session)
    threading.Thread(target=studio.turns.run_forever, daemon=True).start()
    first = dataclasses.replace(studio.view_camera(0), aspect=ASPECT)
    session.stand(first)
    screen.wait(0.0)  # knows its speed now

    moving, waits, coarse = [], [], []
    for _ in range(STOPS):
        began = time.perf_counter()
        camera = first
        while (now := time.perf_counter()) - began < args.seconds / STOPS:
            camera = circling(first, now - began, studio.spread())
            session.stand(camera)
            time.sleep(1.0 / UPDATES)
        stopped = time.perf_counter()
        session.stand(camera)
        moving += [frame for t, frame in screen.frames if began < t <= stopped]
        waits.append(screen.wait(stopped))
        coarse.append(next(t for t, _ in screen.frames if t > stopped) - stopped)
    studio.turns.stop()
    rows = [
        ("frames / s while moving", f"{len(moving) / args.seconds:.1f}"),
        ("median size while moving", size(moving)),
        ("first picture after a stop, s", f"{statistics.median(coarse):.2f}"),
        (f"finished ({size([screen.frames[-1][1]])}), s",
         f"{statistics.median(waits):.2f}"),
        ("rays / s while moving", f"{studio.draft_speed.rays_per_second:,.0f}"),
        ("rays / s, finished", f"{studio.final_speed.rays_per_second:,.0f}"),
    ]  # fmt: skip
    print(workload.markdown(("what", "measured"), rows))


def circling(camera: FreeCamera, seconds: float, radius: float) -> FreeCamera:
    """The camera on a circle through its place, a turn in four seconds."""
    angle = 2.0 * np.pi * seconds / 4.0
    pose = camera.camtoworld.copy()
    right, up = pose[:, 0], pose[:, 1]
    pose[:, 3] += 0.3 * radius * (np.sin(angle) * right + (1 - np.cos(angle)) * up)
    return dataclasses.replace(camera, camtoworld=pose)


def size(frames: list[Delivery]) -> str:
    """The median picture's."""
    shapes = sorted(frame.picture.shape for frame in frames)
    height, width, _ = shapes[len(shapes) // 2]
    return f"{width} x {height}"


if __name__ == "__main__":
    main()
