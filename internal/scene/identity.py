# SPDX-License-Identifier: Apache-2.0
"""What a scene is, so that a run can tell whether it is still the one it learned from.

An identity is a tree of JSON values: the frame, near and far the model is trained in,
and for each view its split, photo (name and a digest of the file), lens, pose (in the
pose file's frame), the photo's gain, and a digest of its mask if it has one. Truth is
no part of it: nothing is trained on it.
"""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from internal.cameras import Lens
from internal.scene.extent import Bounds, ModelFrame
from internal.scene.readers.base import SceneFiles

TOLERANCE = 1e-6  # relative: libraries differ in the last digit
FRAME = "the frame, near or far of the scene"

Identity = dict[str, Any]


def identify(
    files: SceneFiles,
    lenses: tuple[Lens, ...],
    is_test: Bool[np.ndarray, " n"],
    gains: Float[np.ndarray, "n 3"],
    bounds: Bounds,
    frame: ModelFrame,
) -> Identity:
    """The identity of a scene of these views; reads every photo's bytes."""
    views = {
        files.names[view]: {
            "split": "test" if is_test[view] else "train",
            "photo": files.image_paths[view].name,
            "digest": _digest(files.image_paths[view]),
            "lens": [lens.model, lens.width, lens.height, *lens.params],
            "camtoworld": np.ravel(files.camtoworlds[view]).tolist(),
            "gain": np.float64(gains[view]).tolist(),
            **({"mask": _digest(mask)} if (mask := files.mask_paths[view]) else {}),
        }
        for view, lens in enumerate(lenses)
    }
    sizes = [x for value in vars(frame.space).values() for x in np.ravel(value)]
    return {
        "space": [type(frame.space).__name__, *map(float, sizes)],
        "bounds": [float(bounds.near), float(bounds.far)],
        "model_from_world": np.ravel(frame.model_from_world.matrix).tolist(),
        "views": views,
    }


def frame_changed(old: Identity, new: Identity) -> bool:
    """Whether a model of one would be looked at in another frame or depth range."""
    return any(
        not _equal(old[name], new[name])
        for name in ("space", "bounds", "model_from_world")
    )


def changes(old: Identity, new: Identity) -> list[str]:
    """What differs, in words with counts and the first name; empty: the same scene."""
    before, after = old["views"], new["views"]
    shared = [name for name in before if name in after]

    def differ(what: str) -> list[str]:
        return [
            v for v in shared if not _equal(before[v].get(what), after[v].get(what))
        ]

    kinds = {
        "gone": [name for name in before if name not in after],
        "new": [name for name in after if name not in before],
        "in the other split": differ("split"),
        "with another pose": differ("camtoworld"),
        "with another lens": differ("lens"),
        "with another photo": sorted({*differ("digest"), *differ("photo")}),
        "with another exposure": differ("gain"),
        "with another mask": differ("mask"),
    }
    found = [
        f"{len(names)} of {len(before)} views {kind} ({_first(names)})"
        for kind, names in kinds.items()
        if names
    ]
    return found or [FRAME] * frame_changed(old, new)


def _first(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{names[0]}, ..."


def _equal(old: Any, new: Any) -> bool:
    """Whether two values are equal, numbers up to the tolerance."""
    if not (isinstance(old, list) and isinstance(new, list)):
        return old == new
    if len(old) != len(new):
        return False
    texts = [[x for x in values if isinstance(x, str)] for values in (old, new)]
    a, b = ([x for x in values if not isinstance(x, str)] for values in (old, new))
    scale = max(map(abs, a), default=0.0)
    return texts[0] == texts[1] and np.allclose(
        a, b, rtol=TOLERANCE, atol=TOLERANCE * min(scale, 1.0)
    )


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "blake2b").hexdigest()[:32]
