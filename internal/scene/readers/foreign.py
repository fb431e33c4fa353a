# SPDX-License-Identifier: Apache-2.0
"""Poses that no reader here reads, known by their files: what to say of them."""

from collections.abc import Iterator
from pathlib import Path

from internal.files.listing import is_file
from internal.scene.colmap_files import ENDINGS, PARTS

# Files below a scene's folder, and whose they are.
PROGRAMS = (
    ("bundle.out", "Bundler"),
    ("*/bundle.out", "Bundler"),
    ("*.nvm", "VisualSFM"),
    ("keyframes/cameras", "Polycam's raw data"),
    ("keyframes/corrected_cameras", "Polycam's raw data"),
    ("rgbd", "Record3D"),
    ("metadata.json", "Record3D"),
    ("*.xml", "Metashape"),
    ("*.csv", "RealityScan (RealityCapture)"),
    ("*.xmp", "RealityScan (RealityCapture)"),
    ("reconstruction.json", "OpenSfM"),
    ("sfm_data*.json", "OpenMVG"),
    ("*.sfm", "Meshroom"),
    ("cameras_sphere.npz", "NeuS"),
    ("cams/*_cam.txt", "MVSNet"),
    ("pose", "NSVF or ScanNet"),
)
DEPTHS = ("", "*/", "*/*/")  # at which COLMAP models are looked for


def describe(folder: Path) -> str:
    """What a folder that is no scene has instead; "" where nothing is known."""
    for path in _models(folder):
        parts = [f"{part}{path.suffix}" for part in PARTS]
        gone = [part for part in parts if not is_file(path.parent / part)]
        if gone:
            return (
                f"{path.parent} is a COLMAP model without {', '.join(gone)}: export it "
                "whole"
            )
        return f"{path.parent} is a COLMAP model: move its files to a folder sparse/0"
    for path in sorted(folder.glob("*transforms*.json")):
        return f"{path}: call it transforms.json if it is one"
    for pattern, program in PROGRAMS:
        found = next(iter(sorted(folder.glob(pattern))), None)
        if found:
            return (
                f"{found} may be of {program}, which is not read: export a COLMAP "
                "model, or nerfstudio's transforms.json"
            )
    return ""


def _models(folder: Path) -> Iterator[Path]:
    """The files of cameras of COLMAP models, whole or not, the nearest first."""
    for depth in DEPTHS:
        found = sorted(folder.glob(f"{depth}cameras.*"))
        yield from (path for path in found if path.suffix in ENDINGS)
