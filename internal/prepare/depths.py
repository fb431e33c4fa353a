# SPDX-License-Identifier: Apache-2.0
"""Points of a scene whose files say nothing of its depth: triangulated from its photos
with the poses as given, by ``prepare.py``'s brightened copies and matches.

They take a minute or more, so they are kept in a file beside the scene, or in the run's
folder where that cannot be written; it holds for these photos, poses and lenses alone.
"""

import functools
import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from internal.errors import UserError
from internal.files import image_io, kept
from internal.files.scratch import scratch_folder
from internal.prepare import attempts, mapping, matching
from internal.prepare.brighten import copy_size
from internal.prepare.checks import rests_on_points
from internal.prepare.matching import Copy
from internal.scene import colmap
from internal.scene.readers.base import SceneFiles

POINTS_FILE = "points_from_photos.npz"
VERSION = 1  # counts changes of how points are found
WAYS = (attempts.WAYS[0], attempts.WAYS[2])
CLEARLY = 1.5  # times the points with the poses as stated: of another custom
NOTHING = np.empty((0, 3))


def find_points(
    files: SceneFiles, views: Sequence[int], folders: Sequence[Path]
) -> Float[np.ndarray, "m 3"]:
    """Points that the photos of some views show, in the pose file's frame; none where
    too few are found to be trusted. Says which; shows progress.

    Args:
        folders: where they may be kept, the best first.

    Raises:
        UserError: a photo cannot be read, the disk is full, or the photos contradict
            the poses.
    """
    key = _key(files, views)
    before = kept.find(POINTS_FILE, key, folders)
    if before:
        path, arrays = before
        print(f"depth: {len(arrays['points'])} points of the photos, kept in {path}")
        return arrays["points"]
    print(
        f"depth: {files.pose_paths[0].name} states none and has no points: looking for "
        "points in the photos, with its poses",
        flush=True,
    )
    points = _triangulated(files, views)
    kept.keep(POINTS_FILE, key, folders, {"points": points})
    return points


def _triangulated(files: SceneFiles, views: Sequence[int]) -> Float[np.ndarray, "m 3"]:
    """Points by the first of ``WAYS`` that finds enough of them, or none."""
    if any(not colmap.has_depth(files.lenses[view]) for view in views):
        print("  lenses that see sideways: no points", flush=True)
        return NOTHING
    paths = [files.image_paths[view] for view in views]
    sizes = [copy_size(*image_io.read_size(path, files.upright)) for path in paths]
    lenses = [
        colmap.scale_lens(files.lenses[view], *size)
        for view, size in zip(views, sizes, strict=True)
    ]
    numbers = {lens: str(i) for i, lens in enumerate(dict.fromkeys(lenses))}
    copies = [Copy(lens.width, lens.height, numbers[lens], 0.0) for lens in lenses]
    pairs = matching.choose_pairs(
        len(views), exhaustive=len(views) <= matching.EXHAUSTIVE_UP_TO
    )
    for way in WAYS:
        with scratch_folder() as work:
            database = work / "database.db"
            attempts.make_copies(
                way.recipe,
                len(paths),
                lambda view: image_io.read_srgb(paths[view], files.upright),
                work,
            )
            matching.extract_features(database, work, copies, way.peak_threshold)
            matching.match(database, pairs)
            camtoworlds = files.camtoworlds[list(views)]
            triangulated = functools.partial(
                mapping.triangulate, database, work, lenses
            )
            points = triangulated(camtoworlds)
            print(f"  {way.name}: {len(points)} points", flush=True)
            others = {
                change: len(triangulated(changed))
                for change, changed in other_customs(camtoworlds).items()
            }
        _check_custom(files.pose_paths[0], len(points), others, len(views))
        if rests_on_points(len(points), len(views)):
            return points
    print("  too few to say how deep the scene is", flush=True)
    return NOTHING


def _check_custom(
    path: Path, stated: int, others: Mapping[str, int], views: int
) -> None:
    """Compares how many points there are with the poses as stated and otherwise.

    Raises:
        UserError: the poses are of another custom.
    """
    change = max(others, key=lambda change: others[change])
    if rests_on_points(others[change], views) and others[change] > CLEARLY * stated:
        raise UserError(
            f"{path}: its poses are of another custom: the photos show {stated} points "
            f"with them, but {others[change]} with {change}; expected camera to world "
            "and OpenGL's axes (x right, y up, z backwards), in COLMAP's files COLMAP's"
        )


def other_customs(
    camtoworlds: Float[np.ndarray, "n 3 4"],
) -> dict[str, Float[np.ndarray, "n 3 4"]]:
    """What poses would be if the file kept another custom, by the change to them."""
    rotations = np.swapaxes(camtoworlds[:, :, :3], 1, 2)
    inverse = np.concatenate([rotations, -rotations @ camtoworlds[:, :, 3:]], axis=-1)
    return {
        "their second and third column negated": colmap.other_axes(camtoworlds),
        "the matrices inverted": inverse,
        "the matrices inverted and those columns negated": colmap.other_axes(inverse),
    }


def _key(files: SceneFiles, views: Sequence[int]) -> str:
    """Of all that the points depend on."""
    digest = hashlib.sha256(json.dumps([VERSION, files.upright]).encode())
    for view in views:
        lens = files.lenses[view]
        lens_and_pose = [lens.model, lens.width, lens.height, *lens.params]
        lens_and_pose += np.ravel(files.camtoworlds[view]).tolist()
        digest.update(json.dumps(lens_and_pose).encode())
        digest.update(files.image_paths[view].read_bytes())
    return digest.hexdigest()
