# SPDX-License-Identifier: Apache-2.0
"""A scene: dark pictures, cameras, bounds, split, and truth where there is any.

Readers (``internal/scene/readers``) turn a folder into ``SceneFiles`` and share nothing
but that structure; ``load_scene`` turns ``SceneFiles`` into a ``Scene``, by the
steps of ``loading.py`` and ``extent.py``.
Pictures are kept as uint16 sRGB (65535 is 1.0): 8-bit levels are exact in it and
an area average keeps the precision it gained.
"""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, UInt16

from internal.cameras import NODES, Cameras, Lens
from internal.coord import ForwardFacing, Unbounded
from internal.errors import UserError
from internal.files.picture_store import Picture, hold
from internal.poses import transform_poses
from internal.scene import readers
from internal.scene.colmap import lens_table
from internal.scene.extent import (
    Bounds,
    Frame,
    choose_frame,
    find_bounds,
    knows_depths,
)
from internal.scene.identity import Identity, identify
from internal.scene.loading import (
    GAINS_FILE,
    UINT16_ONE,
    Truth,
    check_lenses,
    check_poses,
    find_truth,
    fit_lenses,
    held_out,
    load_gains,
    load_picture,
    load_truth,
    warn_of_one_place,
)
from internal.scene.masks import Mask, everything, load_masks, masked_share, report
from internal.scene.noise import Noise, noise_of_files
from internal.scene.readers.base import SceneFiles

# LOM's dark pictures average 0.05 to 0.1 in sRGB, their normal-light twins 0.5.
BRIGHT_MEAN = 0.35
SPLITS = ("train", "test")
FindPoints = Callable[[SceneFiles, Sequence[int]], Float[np.ndarray, "m 3"]]


@dataclasses.dataclass(frozen=True)
class Scene:
    """One split of a scene, loaded, in the frame the model is trained in."""

    name: str
    format: str
    split: str  # "train" or "test"
    view_names: tuple[str, ...]
    image_paths: tuple[Path, ...]  # files of ``images``; of truth where there are none
    lenses: tuple[Lens, ...]  # at the size of ``images``
    cameras: Cameras  # NumPy arrays, model frame
    images: Sequence[Picture]  # dark input; () where test views have truth alone
    truth: Mapping[int, Picture]  # by view, of those that have it
    masks: tuple[Mask, ...]  # of ``images`` and ``truth``; () if every pixel counts
    gains: Float[np.ndarray, "n 3"]  # photo over scene, linear light
    space: ForwardFacing | Unbounded
    near: float  # depth, in the pose file's units
    far: float
    model_from_world: Float[np.ndarray, "4 4"]  # similarity: pose file to model
    upright: bool  # ``images`` are the files turned by EXIF, else as stored
    identity: Identity  # of all views, whatever the split

    def mask(self, view: int) -> Mask:
        """Which pixels of a view count."""
        lens = self.lenses[view]
        return self.masks[view] if self.masks else everything(lens.width, lens.height)

    def pixels(self, view: int) -> UInt16[np.ndarray, "_n 3"]:
        """The pixels of an image that count."""
        image = self.images[view]
        return image[self.masks[view]] if self.masks else np.reshape(image, (-1, 3))

    @property
    def masked(self) -> dict[str, float]:
        """The masked part, 0 to 1, of each view of which anything is masked."""
        named = zip(self.view_names, self.masks, strict=False)
        return {name: masked_share([mask]) for name, mask in named if not mask.all()}

    @functools.cached_property
    def brightness(self) -> float:
        """Mean of the pictures, sRGB in [0, 1]; 0 without any."""
        if not self.images:
            return 0.0
        seen = [self.pixels(v) for v in range(len(self.images)) if self.mask(v).any()]
        return float(np.mean([pixels.mean() for pixels in seen])) / UINT16_ONE

    @functools.cached_property
    def noise(self) -> Noise:
        """Noise of the photos' own pixels, estimated from the files."""
        return noise_of_files(self.image_paths, self.masks, self.upright)


def load_scene(
    data_dir: Path,
    *,
    split: str,
    dataset_loader: str = "auto",
    factor: int = 1,
    images_dir: str = "",
    pair_by: str = "name",
    gt_dir: str = "",
    near: float = 0.0,
    far: float = 0.0,
    projection: str = "auto",
    end_at_far: bool = False,
    holdout: int = 8,
    photo_gains: bool = True,
    unrounded: bool = False,
    max_image_memory: float = np.inf,
    find_points: FindPoints | None = None,
) -> Scene:
    """Loads one split of a scene and prints what was found and how.

    Everything but the pictures is decided from all views, so the splits of a scene
    agree on frame and bounds.

    Args:
        data_dir: the scene's folder.
        split: "train" or "test".
        dataset_loader: name of a reader, or "auto" to detect the format.
        factor: pictures shrink by it, by area average of their sRGB values.
        images_dir: folder in ``data_dir`` to take the input pictures from instead
            of the one the pose file states.
        pair_by: how those pictures may find their poses: "name"; "number", also by
            the one number in their names; "order", also by order.
        gt_dir: folder of normal-light truth, absolute or in ``data_dir``; "" looks
            beside the dark pictures (``pairing.TRUTH_FOLDERS``).
        near: depth before which there is nothing, in the pose file's units; 0 takes
            the pose file's, or estimates it from sparse points.
        far: likewise the depth past which there is nothing.
        projection: "ndc" for cameras that face one way, "contract" for any others,
            "auto" to detect.
        end_at_far: with "ndc", rays end at ``far`` and not at infinity.
        holdout: every ``holdout``-th view, from the first, is a test view if the
            files state no split; 0 trains on all.
        photo_gains: the light of each photo over the scene's, from the file that
            prepare.py writes, where there is one; training then explains the photos
            by it and renderings are free of it. Not for other ``images_dir``.
        unrounded: takes the steps of rounding out of the colours of the training
            photos (``internal/scene/unround.py``); test photos stay as they are.
        max_image_memory: gigabytes of pictures to keep in memory; more lie in a
            temporary file.
        find_points: asked for points, from the views that are trained on, where
            nothing else says how deep the scene is.

    Raises:
        UserError: anything about the input that the user has to fix.
    """
    if split not in SPLITS:
        raise UserError(f"unknown split {split!r}; choose {' or '.join(SPLITS)}")
    files = readers.read_files(data_dir, dataset_loader, images_dir, pair_by)
    check_poses(files)
    check_lenses(files)
    warn_of_one_place(files)
    lenses = fit_lenses(files, factor)
    is_test = held_out(files, holdout)
    trained = int((~is_test).sum())
    if trained < 2:
        raise UserError(
            f"{data_dir}: {trained} training views of {len(is_test)}; expected at "
            "least 2: add photos, or hold out fewer for testing (Config.holdout)"
        )
    is_known = bool(near and far) or knows_depths(files, lenses, ~is_test)
    if find_points and not is_known:
        points = find_points(files, np.flatnonzero(~is_test).tolist())
        files = dataclasses.replace(
            files, points=points, points_source="points found in the photos"
        )
    bounds = find_bounds(files, lenses, ~is_test, near, far)
    frame = choose_frame(files, lenses, bounds, projection, end_at_far)
    truth = _find_truth(files, data_dir, gt_dir, is_test, needed=split == "test")
    own_photos = photo_gains and not images_dir
    unrounds = unrounded and split == "train"
    gains = np.ones((len(is_test), 3), np.float32)
    dark = ~is_test if truth.is_alone else np.ones_like(is_test)
    dark_paths = [
        path for path, is_dark in zip(files.image_paths, dark, strict=True) if is_dark
    ]
    gains[dark] = load_gains(data_dir, dark_paths, own_photos)
    masks = load_masks(files, lenses, is_test)

    views = np.flatnonzero(is_test == (split == "test"))
    if len(views) == 0:
        raise UserError(f"{data_dir}: no test views; set Config.holdout above 0")
    own_lenses = tuple(lenses[v] for v in views)
    own_masks = [
        masks[v] if masks else everything(lenses[v].width, lenses[v].height)
        for v in views
    ]
    shown = list(zip(views.tolist(), own_masks, strict=True))
    camtoworlds = transform_poses(frame.model_from_world, files.camtoworlds[views])
    scene = Scene(
        name=data_dir.resolve().name,
        format=files.format,
        split=split,
        view_names=tuple(files.names[v] for v in views),
        image_paths=tuple(files.image_paths[v] for v in views),
        lenses=own_lenses,
        cameras=posed_cameras(own_lenses, camtoworlds),
        images=hold(
            (
                load_picture(
                    files.image_paths[v],
                    lenses[v],
                    mask,
                    files.upright,
                    unrounded=unrounds,
                )
                for v, mask in shown
                if dark[v]
            ),
            max_image_memory,
        ),
        truth=dict(
            zip(
                [place for place, (v, _) in enumerate(shown) if v in truth.paths],
                hold(
                    (
                        load_truth(
                            truth.paths[v],
                            files.image_paths[v],
                            lenses[v],
                            mask,
                            files.upright,
                        )
                        for v, mask in shown
                        if v in truth.paths
                    ),
                    max_image_memory,
                ),
                strict=True,
            )
        ),
        masks=() if all(mask.all() for mask in own_masks) else tuple(own_masks),
        gains=gains[views],
        space=frame.space,
        near=bounds.near,
        far=bounds.far,
        model_from_world=frame.model_from_world,
        upright=files.upright,
        identity=identify(files, lenses, is_test, gains, bounds, frame),
    )
    _report(scene, files, is_test, bounds, frame, truth)
    report(masks)
    if scene.images and scene.brightness == 0.0:
        raise UserError(
            f"{scene.image_paths[0].parent}: all {len(scene.images)} photos are black, "
            "without a pixel above 0: there is no light to bring out"
        )
    if not images_dir:  # else the user chose, and LLE + NeRF chooses bright photos
        _warn_of_normal_light(scene)
    return scene


def _find_truth(
    files: SceneFiles,
    data_dir: Path,
    gt_dir: str,
    is_test: Bool[np.ndarray, " n"],
    *,
    needed: bool,
) -> Truth:
    """Truth as ``find_truth`` finds it. Training needs none: what is wrong with it is
    then only said."""
    try:
        return find_truth(files, data_dir, gt_dir, is_test)
    except UserError as error:
        if needed:
            raise
        return Truth({}, f"WARNING: none for scores: {error}")


def posed_cameras(
    lenses: Sequence[Lens], camtoworlds: Float[np.ndarray, "n 3 4"]
) -> Cameras:
    """Cameras with these lenses; tables of different ones lie end to end."""
    different = list(dict.fromkeys(lenses))
    starts = {lens: NODES**2 * index for index, lens in enumerate(different)}
    return Cameras(
        camtoworlds=camtoworlds.astype(np.float32),
        directions=np.concatenate([lens_table(lens) for lens in different]),
        table_starts=np.array([starts[lens] for lens in lenses], np.int32),
        widths=np.array([lens.width for lens in lenses], np.int32),
        heights=np.array([lens.height for lens in lenses], np.int32),
    )


def _report(
    scene: Scene,
    files: SceneFiles,
    is_test: Bool[np.ndarray, " n"],
    bounds: Bounds,
    frame: Frame,
    truth: Truth,
) -> None:
    """Prints what was found and decided."""
    sizes = {f"{lens.width}x{lens.height}" for lens in scene.lenses}
    models = {lens.model for lens in scene.lenses}
    print(
        f"scene {scene.name}: format {files.format}, {len(is_test)} views "
        f"({(~is_test).sum()} train, {is_test.sum()} test), loading {scene.split}\n"
        f"  pictures: {', '.join(sorted(sizes))} pixels, {', '.join(sorted(models))} "
        f"lens, mean brightness {255 * scene.brightness:.1f} of 255\n"
        f"  depth: near {bounds.near:.4g}, far {bounds.far:.4g} ({bounds.source}), "
        f"{len(files.points)} points\n"
        f"  projection: {frame.reason}\n"
        f"  exposures: {_describe_gains(scene.gains)}\n"
        f"  truth: {truth.reason}"
    )


def _describe_gains(gains: Float[np.ndarray, "n 3"]) -> str:
    if np.all(gains == 1.0):
        return "equal"
    stops = np.log2(gains).mean(axis=-1)
    return f"differ, {stops.min():+.2f} to {stops.max():+.2f} stops ({GAINS_FILE})"


def _warn_of_normal_light(scene: Scene) -> None:
    if scene.brightness > BRIGHT_MEAN:
        print(
            f"WARNING: this does not look like a low-light scene: mean brightness "
            f"{255 * scene.brightness:.0f} of 255. The enhancement is made for dark "
            "photos; give the dark folder with Config.images_dir"
        )
