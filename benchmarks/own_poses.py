# SPDX-License-Identifier: Apache-2.0
"""Poses that prepare.py found beside given ones: both trained, the same views scored.

python prepare.py GIVEN/low OWN --gt GIVEN/high
python -m benchmarks.own_poses GIVEN OWN OUT
"""

import argparse
import json
import shutil
from pathlib import Path

from benchmarks import workload
from internal.scene import readers

SHORT = (
    "Config.factor = 2",
    "Train.max_steps = 2500",
    "Train.enhance_start = 2100",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("given", type=Path)
    parser.add_argument("own", type=Path)
    parser.add_argument("out", type=Path)
    flags = parser.parse_args()
    scene = flags.out / "scene"
    if not scene.exists():
        split_alike(flags.own, flags.given, scene)
    rows = []
    for label, data_dir in (("given", flags.given), ("own", scene)):
        bindings = [*SHORT, f"Config.data_dir = {str(data_dir)!r}"]
        mean = workload.scores(flags.out / label, workload.FAST, bindings)["mean"]
        rows.append((label, *workload.score_cells(mean)))
    headers = ("poses", *workload.SCORE_HEADERS)
    print(workload.markdown(headers, rows))


def split_alike(own: Path, given: Path, scene: Path) -> None:
    """Copies a prepared scene, with the views and the split of another one."""
    files = readers.read_files(given, "auto", "")
    test = files.test_names or frozenset()
    shutil.copytree(own, scene)
    path = scene / "transforms.json"
    content = json.loads(path.read_text())
    by_name = {Path(f["file_path"]).name: f["file_path"] for f in content["frames"]}
    placed = [name for name in files.names if name in by_name]
    content["train_filenames"] = [by_name[n] for n in placed if n not in test]
    content["test_filenames"] = [by_name[n] for n in placed if n in test]
    path.write_text(json.dumps(content))


if __name__ == "__main__":
    main()
