# SPDX-License-Identifier: Apache-2.0
"""How much more light each photo of a scene took than the others: as ``prepare.py``
wrote it beside the scene, else as ``exposures`` measures it, once.

Gains are of linear light, red, green and blue: photo = gain * scene.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from internal.errors import UserError
from internal.files import image_io, kept
from internal.files.listing import say_once
from internal.scene import exposures
from internal.scene.config import SceneConfig
from internal.scene.exposures import Exposures, Sighted
from internal.scene.readers.base import SceneFiles

GAINS_FILE = "exposures.json"  # written by prepare.py
KEPT_FILE = "exposures_from_photos.npz"
VERSION = 1  # counts changes of how exposures are measured


def find_gains(
    config: SceneConfig,
    files: SceneFiles,
    has_photo: Bool[np.ndarray, " n"],
    folders: Sequence[Path],
) -> tuple[Float[np.ndarray, "n 3"], str]:
    """Linear light of each photo over the scene's, and where that is known from: the
    scene's file, else the points that its COLMAP model says photos share; ones and ""
    where neither is there.

    Args:
        folders: as ``measured_exposures`` takes them.

    Raises:
        UserError: as ``load_gains``.
    """
    data_dir = Path(config.data_dir)
    gains = np.ones((len(files.names), 3), np.float32)
    if not config.photo_gains:
        return gains, ""
    if (data_dir / GAINS_FILE).is_file() and not config.images_dir:
        paths = [files.image_paths[view] for view in np.flatnonzero(has_photo)]
        gains[has_photo] = load_gains(data_dir, paths)
        return gains, GAINS_FILE
    found = measured_exposures(data_dir, files, has_photo, folders)
    if found is None:
        return gains, ""
    return found.gains.astype(np.float32), "measured at points that photos share"


def measured_exposures(
    data_dir: Path,
    files: SceneFiles,
    has_photo: Bool[np.ndarray, " n"],
    folders: Sequence[Path],
) -> Exposures | None:
    """Exposures of the photos at points that the scene's COLMAP model says they share;
    None where it says nothing. Shows progress the first time.

    Args:
        folders: where they may be kept, the best first.
    """
    try:
        sighted = exposures.find_sighted(data_dir, files.names)
    except UserError as error:  # a model beside other poses
        say_once(f"WARNING: {error}; photos are taken as equally exposed")
        return None
    sighted = {view: seen for view, seen in sighted.items() if has_photo[view]}
    if not sighted:
        return None
    key = _key(files, sighted)
    before = kept.find(KEPT_FILE, key, folders)
    if before:
        _, arrays = before
        return Exposures(arrays["gains"], arrays["measured_stops"])

    def read(view: int) -> Float[np.ndarray, "_height _width 3"]:
        try:
            return image_io.read_srgb(files.image_paths[view], upright=False)
        except UserError:  # said where the photo is used
            return np.zeros((1, 1, 3), np.float32)

    found = exposures.measure_gains(sighted, read, len(files.names))
    kept.keep(KEPT_FILE, key, folders, vars(found))
    return found


def _key(files: SceneFiles, sighted: Mapping[int, Sighted]) -> str:
    """Of all that the exposures depend on."""
    digest = hashlib.sha256(json.dumps([VERSION, len(files.names)]).encode())
    for view, seen in sighted.items():
        digest.update(json.dumps([view, len(seen.points)]).encode())
        digest.update(seen.points.tobytes())
        digest.update(seen.places.tobytes())
        digest.update(files.image_paths[view].read_bytes())
    return digest.hexdigest()


def load_gains(data_dir: Path, image_paths: Sequence[Path]) -> Float[np.ndarray, "n 3"]:
    """Linear light of each photo over the scene's, from the scene's file.

    The file names a photo by its path inside the folder of photos.

    Raises:
        UserError: the file cannot be read, or a photo's gain is missing or senseless.
    """
    path = data_dir / GAINS_FILE
    try:
        stored = json.loads(path.read_text())["gains"]
        gains = np.array([_own_gain(stored, path) for path in image_paths], np.float32)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise UserError(
            f"{path}: no gain for every photo ({error!r}); run prepare.py again, "
            "delete the file, or set Config.photo_gains = False"
        ) from error
    if gains.shape != (len(image_paths), 3) or not np.all(
        (gains > 0) & (gains < np.inf)
    ):
        raise UserError(
            f"{path}: expected three positive numbers per photo; run prepare.py again, "
            "delete the file, or set Config.photo_gains = False"
        )
    return gains


def _own_gain(stored: Mapping[str, Any], photo: Path) -> Any:
    """The gain under the longest end of a photo's path that has one."""
    parts = photo.parts[1:] if photo.is_absolute() else photo.parts
    for start in range(len(parts)):
        if (end := "/".join(parts[start:])) in stored:
            return stored[end]
    raise KeyError(photo.name)
