# SPDX-License-Identifier: Apache-2.0
"""Which scene, and how it is read."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class SceneConfig:
    """A scene's folder and what its files leave open."""

    data_dir: str = ""
    dataset_loader: str = "auto"  # a reader's name; auto: by what the folder holds
    factor: int = 1  # pictures shrink by it, by area average of their sRGB values
    images_dir: str = ""  # other folder of input pictures, paired with the poses by
    pair_by: str = "name"  # name; number: of the names, too; order: that, too
    gt_dir: str = ""  # folder of normal-light truth, paired by name
    near: float = 0.0  # depth in the pose file's units; 0: from file or points
    far: float = 0.0
    projection: str = "auto"  # ndc, contract; auto: from the poses
    end_at_far: bool = False  # ndc: rays end at far, not at infinity
    holdout: int = 8  # every n-th view is a test view where files state no split
    photo_gains: bool = True  # photos differ in exposure: exposures.json, else measured
    unrounded: bool = False  # training photos' colours; internal/scene/unround.py
    max_image_memory: float = 4.0  # GB of pictures in memory; more stay on disk
