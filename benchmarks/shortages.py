# SPDX-License-Identifier: Apache-2.0
"""Scripts without disk, memory or a folder of their own: does each say so in one line,
and does the same command then make what it makes anywhere?

python -m benchmarks.shortages [--places 20]

Needs root: the place of the trials is a tmpfs that is made too small at so many sizes,
or read-only. Without memory: an address space too small for settings that ask for much.
Two at once: the second is refused, or both make the same. Prints a row per script and
shortage and exits with 1 if there is a fault.

Last run, 3 sizes of disk per script: no fault. Found and mended: pictures that a
full disk had taken in part counted as rendered (PNG, TIFF, EXR, WebP), writing a JPEG
ended the process without a word, a training ended in tracebacks of Orbax's threads,
and a chunk larger than a picture took memory for it.
"""

import argparse
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks import trials, workload
from benchmarks.trials import Script

LARGEST = 1 << 27  # bytes that any script writes, at least
MEMORY = 12 << 30  # of address space
GREEDY = "Train.batch_size = 33554432"  # other scripts ask for a picture at most


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--places", type=int, default=20, help="where the disk is full")
    args = parser.parse_args()
    rows = []
    with trials.trials() as folder:
        for script in trials.SCRIPTS:
            whole, _ = trials.undisturbed(script, folder)
            sizes = np.geomspace(4096, LARGEST, args.places).astype(int)
            shortages = {
                "full disk": full(script, folder, whole, sizes),
                "read-only": read_only(script, folder, whole),
                "memory": without_memory(script, folder),
                "two at once": two_at_once(script, folder, whole),
            }
            for name, shortage in shortages.items():
                found = list(shortage)
                faults = [what for what in found if what]
                rows.append((script.name, name, len(found), "; ".join(faults) or "ok"))
                print(rows[-1], flush=True)
    print(workload.markdown(("script", "shortage", "trials", "result"), rows))
    return int(any(row[-1] != "ok" for row in rows))


def full(script: Script, folder: Path, whole: object, sizes) -> Iterator[str]:
    """A disk of each size, that a script may fill; then one that is large."""
    place = folder / trials.PLACE
    for size in sizes:
        with Mounted(place) as disk:
            trials.set_up(script, folder)
            used = sum(x.stat().st_blocks * 512 for x in place.rglob("*"))
            disk.remount(f"size={-(-(used + size) // 4096) * 4096}")
            process = trials.start(script, folder)
            _, error = process.communicate()
            if process.returncode:
                said = trials.fault(error)
                if said or process.returncode != 2:
                    yield f"{size} bytes: exit {process.returncode}: {said}"
                torn = trials.half_written(script, folder, whole)
                if torn:
                    yield f"{size} bytes: half-written {torn}"
            disk.remount(f"size={8 * LARGEST}")
            yield trials.ended(script, folder, whole)


def read_only(script: Script, folder: Path, whole: object) -> Iterator[str]:
    """A disk that nobody may write to; then one that takes it."""
    with Mounted(folder / trials.PLACE) as disk:
        trials.set_up(script, folder)
        disk.remount("ro")
        process = trials.start(script, folder)
        _, error = process.communicate()
        if process.returncode != 2:
            yield f"exit {process.returncode}"
        if said := trials.fault(error):
            yield said
        disk.remount("rw")
        yield trials.ended(script, folder, whole)


def without_memory(script: Script, folder: Path) -> Iterator[str]:
    """A batch that needs more than there is."""
    if script.name != "train":
        return
    trials.set_up(script, folder)
    process = trials.start(
        script, folder, [f"--gin_bindings={GREEDY}"],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY)),
    )  # fmt: skip
    _, error = process.communicate()
    said = trials.fault(error)
    yield said or (f"exit {process.returncode}" if process.returncode != 2 else "")


def two_at_once(script: Script, folder: Path, whole: object) -> Iterator[str]:
    """Two of a script in one folder, a moment apart."""
    trials.set_up(script, folder)
    first = trials.start(script, folder)
    time.sleep(1.0)
    second = trials.start(script, folder)
    for process in (first, second):
        _, error = process.communicate()
        if process.returncode and (said := trials.fault(error)):
            yield f"exit {process.returncode}: {said}"
    yield trials.ended(script, folder, whole)


class Mounted:
    """A disk of its own at a folder, while it is entered."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __enter__(self) -> "Mounted":
        command = ["mount", "-t", "tmpfs", "tmpfs", str(self._folder)]
        subprocess.run(command, check=True)
        return self

    def remount(self, options: str) -> None:
        """With another size or ``ro`` or ``rw``; what it holds stays."""
        command = ["mount", "-o", f"remount,{options}", str(self._folder)]
        subprocess.run(command, check=True)

    def __exit__(self, *_: object) -> None:
        subprocess.run(["umount", str(self._folder)], check=True)


if __name__ == "__main__":
    sys.exit(main())
