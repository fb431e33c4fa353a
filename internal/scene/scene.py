# SPDX-License-Identifier: Apache-2.0
"""A scene: dark pictures, cameras, bounds, split, and truth where there is any.

Readers (``internal/scene/readers``) turn a folder into ``SceneFiles`` and share nothing
but that structure; ``load_scene`` turns ``SceneFiles`` into a ``Scene``, by the
steps of ``loading``, ``extent`` and ``gains``.
Pictures are kept as uint16 sRGB (65535 is 1.0): 8-bit levels are exact in it and
an area average keeps the precision it gained.
"""

import dataclasses
import functools
import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, UInt16

from internal.cameras import NODES, Cameras, Lens
from internal.color import UINT16_ONE, from_uint16
from internal.coord import Space
from internal.errors import UserError
from internal.files import image_io
from internal.files.picture_store import StoredPicture, hold
from internal.poses import Similarity
from internal.scene import readers
from internal.scene.colmap import lens_table
from internal.scene.config import SceneConfig
from internal.scene.extent import (
    Bounds,
    ModelFrame,
    choose_frame,
    find_bounds,
    known_bounds,
)
from internal.scene.gains import find_gains
from internal.scene.identity import Identity, identify
from internal.scene.loading import (
    Truth,
    find_truth,
    fit_lenses,
    held_out,
    load_picture,
    load_truth,
)
from internal.scene.masks import Mask, everything, load_masks, masked_share, report
from internal.scene.noise import Noise, noise_of_files
from internal.scene.pairing import some
from internal.scene.plausible import check_depths, warn_of_other_frame
from internal.scene.pose_checks import (
    check_lenses,
    check_poses,
    check_sides,
    warn_of_leaks,
    warn_of_one_place,
    warn_of_strays,
)
from internal.scene.readers.base import SceneFiles

# LOM's dark pictures average 0.05 to 0.1 in sRGB, their normal-light twins 0.5.
BRIGHT_MEAN = 0.35
FEW_BITS, FULL_BITS = (8, 10, 12), 14  # of cameras, in files of 16
EVERY = 8  # row and column of a photo are compared: no two shots have equal noise
SPLITS = ("train", "test")
FindPoints = Callable[
    [SceneFiles, Sequence[int], Sequence[Path]], Float[np.ndarray, "m 3"]
]


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
    images: Sequence[StoredPicture]  # dark input; () where test views have truth alone
    truth: Mapping[int, StoredPicture]  # by view, of those that have it
    masks: tuple[Mask, ...]  # of ``images`` and ``truth``; () if every pixel counts
    gains: Float[np.ndarray, "n 3"]  # photo over scene, linear light
    space: Space
    near: float  # depth, in the pose file's units
    far: float
    model_from_world: Similarity  # from the frame of the pose file
    upright: bool  # ``images`` are the files turned by EXIF, else as stored
    identity: Identity  # of all views, whatever the split

    def mask(self, view: int) -> Mask:
        """Which pixels of a view count."""
        lens = self.lenses[view]
        return self.masks[view] if self.masks else everything(lens.width, lens.height)

    def photo(self, view: int) -> Float[np.ndarray, "_height _width 3"] | None:
        """The dark photo of a view, sRGB in [0, 1], if it has one."""
        return from_uint16(self.images[view]) if self.images else None

    def true_photo(self, view: int) -> Float[np.ndarray, "_height _width 3"] | None:
        """The normal-light truth of a view, sRGB in [0, 1], if it has one."""
        return from_uint16(self.truth[view]) if view in self.truth else None

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


@dataclasses.dataclass(frozen=True)
class _Layout:
    """What is decided from all views, whatever the split."""

    files: SceneFiles
    lenses: tuple[Lens, ...]  # at the size of the pictures as trained on
    is_test: Bool[np.ndarray, " n"]
    has_photo: Bool[np.ndarray, " n"]  # a dark one; else truth alone
    bounds: Bounds
    frame: ModelFrame
    truth: Truth
    gains: Float[np.ndarray, "n 3"]
    gains_source: str  # for messages
    masks: tuple[Mask, ...]

    def mask(self, view: int) -> Mask:
        """Which pixels of a view count."""
        lens = self.lenses[view]
        return self.masks[view] if self.masks else everything(lens.width, lens.height)

    @functools.cached_property
    def identity(self) -> Identity:
        """By which a run knows the scene again."""
        return identify(
            self.files, self.lenses, self.is_test, self.gains, self.bounds, self.frame
        )


def load_scene(
    config: SceneConfig,
    split: str,
    find_points: FindPoints | None = None,
    folders: Sequence[Path] = (),
) -> Scene:
    """Loads one split of a scene and prints what was found and how.

    Everything but the pictures is decided from all views, so the splits of a scene
    agree on frame and bounds.

    Args:
        split: "train" or "test".
        find_points: asked for points, from the views that are trained on, where
            nothing else says how deep the scene is.
        folders: where points and exposures that were found may be kept, best first.

    Raises:
        UserError: anything about the input that the user has to fix.
    """
    if split not in SPLITS:
        raise UserError(f"unknown split {split!r}; choose {' or '.join(SPLITS)}")
    layout = _lay_out(config, find_points, folders, needs_truth=split == "test")
    views = np.flatnonzero(layout.is_test == (split == "test")).tolist()
    if not views:
        raise UserError(f"{config.data_dir}: no test views; set Config.holdout above 0")
    scene = _load(config, layout, split, views)
    _report(scene, layout)
    report(layout.masks)
    if scene.images and scene.brightness == 0.0:
        raise UserError(
            f"{scene.image_paths[0].parent}: all {len(scene.images)} photos are black, "
            "without a pixel above 0: there is no light to bring out"
        )
    _warn_of_copies(scene)
    _warn_of_few_bits(scene)
    if not config.images_dir:  # else the user chose: LLE + NeRF chooses bright photos
        _warn_of_normal_light(scene)
        _warn_of_dark_truth(scene)
    return scene


def _lay_out(
    config: SceneConfig,
    find_points: FindPoints | None,
    folders: Sequence[Path],
    *,
    needs_truth: bool,
) -> _Layout:
    """Reads the scene's files and decides split, frame and bounds."""
    data_dir = Path(config.data_dir)
    files = readers.read_files(
        data_dir, config.dataset_loader, config.images_dir, config.pair_by
    )
    check_poses(files)
    check_lenses(files)
    check_sides(files)
    warn_of_strays(files)
    lenses = fit_lenses(files, config.factor)
    is_test = held_out(files, config.holdout)
    warn_of_leaks(files, is_test)
    warn_of_other_frame(files, lenses, is_test)
    trained = int((~is_test).sum())
    if trained < 2:
        raise UserError(
            f"{data_dir}: {trained} training views of {len(is_test)}; expected at "
            "least 2: add photos, or hold out fewer for testing (Config.holdout)"
        )
    files, bounds = _bound(config, files, lenses, ~is_test, find_points, folders)
    warn_of_one_place(files, bounds)
    check_depths(files, lenses, bounds, ~is_test)
    frame = choose_frame(files, lenses, bounds, config.projection, config.end_at_far)
    truth = _find_truth(files, data_dir, config.gt_dir, is_test, needed=needs_truth)
    has_photo = ~is_test if truth.is_alone else np.ones_like(is_test)
    gains, gains_source = find_gains(config, files, has_photo, folders)
    masks = load_masks(files, lenses, is_test)
    return _Layout(
        files,
        lenses,
        is_test,
        has_photo,
        bounds,
        frame,
        truth,
        gains,
        gains_source,
        masks,
    )


def _bound(
    config: SceneConfig,
    files: SceneFiles,
    lenses: tuple[Lens, ...],
    is_train: Bool[np.ndarray, " n"],
    find_points: FindPoints | None,
    folders: Sequence[Path],
) -> tuple[SceneFiles, Bounds]:
    """Near and far, and the files with the points that were found if nothing else told
    them."""
    is_given = bool(config.near and config.far)
    known = None if is_given else known_bounds(files, lenses, is_train)
    if find_points and not (is_given or known):
        points = find_points(files, np.flatnonzero(is_train).tolist(), folders)
        files = dataclasses.replace(
            files, points=points, points_source="points found in the photos"
        )
        known = known_bounds(files, lenses, is_train)
    return files, find_bounds(files, known, config.near, config.far)


def _load(
    config: SceneConfig, layout: _Layout, split: str, views: Sequence[int]
) -> Scene:
    """The scene of some views, with their pictures."""
    files, frame, truth = layout.files, layout.frame, layout.truth
    lenses = tuple(layout.lenses[view] for view in views)
    masks = {view: layout.mask(view) for view in views}
    camtoworlds = frame.model_from_world.poses(files.camtoworlds[views])
    photos = (
        load_picture(
            files.image_paths[view],
            layout.lenses[view],
            masks[view],
            files.upright,
            unrounded=config.unrounded and split == "train",
        )
        for view in views
        if layout.has_photo[view]
    )
    places = {place: view for place, view in enumerate(views) if view in truth.paths}
    truths = (
        load_truth(
            truth.paths[view],
            files.image_paths[view],
            layout.lenses[view],
            masks[view],
            files.upright,
        )
        for view in places.values()
    )
    return Scene(
        name=Path(config.data_dir).resolve().name,
        format=files.format,
        split=split,
        view_names=tuple(files.names[view] for view in views),
        image_paths=tuple(files.image_paths[view] for view in views),
        lenses=lenses,
        cameras=posed_cameras(lenses, camtoworlds),
        images=hold(photos, config.max_image_memory),
        truth=dict(zip(places, hold(truths, config.max_image_memory), strict=True)),
        masks=() if all(x.all() for x in masks.values()) else tuple(masks.values()),
        gains=layout.gains[views],
        space=frame.space,
        near=layout.bounds.near,
        far=layout.bounds.far,
        model_from_world=frame.model_from_world,
        upright=files.upright,
        identity=layout.identity,
    )


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


def _report(scene: Scene, layout: _Layout) -> None:
    """Prints what was found and decided."""
    files, is_test, truth = layout.files, layout.is_test, layout.truth
    bounds, frame = layout.bounds, layout.frame
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
        f"  exposures: {_describe_gains(scene.gains, layout.gains_source)}\n"
        f"  truth: {truth.reason}"
    )


def _describe_gains(gains: Float[np.ndarray, "n 3"], source: str) -> str:
    if np.all(gains == 1.0):
        return f"equal ({source})" if source else "taken as equal"
    stops = np.log2(gains).mean(axis=-1)
    return f"differ, {stops.min():+.2f} to {stops.max():+.2f} stops ({source})"


def _warn_of_normal_light(scene: Scene) -> None:
    if scene.brightness > BRIGHT_MEAN:
        print(
            f"WARNING: this does not look like a low-light scene: mean brightness "
            f"{255 * scene.brightness:.0f} of 255. The enhancement is made for dark "
            "photos; give the dark folder with Config.images_dir"
        )


def _warn_of_dark_truth(scene: Scene) -> None:
    """Says so if truth has no more light than the photos: it is a folder of these."""
    if not (scene.images and scene.truth):
        return
    photos = np.mean([scene.images[view].mean() for view in scene.truth])
    truth = np.mean([picture.mean() for picture in scene.truth.values()])
    if truth <= photos:
        print(
            f"WARNING: the truth is no brighter than the photos ({truth / 257:.1f} and "
            f"{photos / 257:.1f} of 255, mean): point Config.gt_dir at the "
            "normal-light twins, or scores are of something else"
        )


def _warn_of_few_bits(scene: Scene) -> None:
    """Says so if no value of files of 16 bits is above what fewer bits hold: cameras of
    10, 12 and 14 bits leave the upper ones empty, and photos are then dark by it."""
    headers = map(image_io.read_header, scene.image_paths)
    if not scene.images or not all(header.is_deep for header in headers):
        return
    top = max(int(np.max(image)) for image in scene.images)
    bits = next((bits for bits in FEW_BITS if top < 1 << bits), 0)
    if top == (1 << FULL_BITS) - 1:  # reached, so that it is no chance
        bits = FULL_BITS
    if bits:
        print(
            f"WARNING: {scene.image_paths[0].parent}: no value of its 16-bit pictures "
            f"is above {top} of {UINT16_ONE:.0f}: if these are values of {bits} bits, "
            f"multiply them by {1 << 16 - bits}; trained as they are"
        )


def _is_white(image: StoredPicture, counts: Mask) -> bool:
    """Whether all that counts in a photo is at its highest level."""
    at_most = np.iinfo(image.dtype).max
    if image[::EVERY, ::EVERY].max() < at_most or not counts.any():
        return False
    return bool((image[counts] == at_most).all())


def _warn_of_copies(scene: Scene) -> None:
    """Names photos that show nothing, and copies of one photo under several poses."""
    black, white, copies, first = [], [], [], {}
    for view, image in enumerate(scene.images):
        name = scene.view_names[view]
        looked_at = image[::EVERY, ::EVERY]
        digest = hashlib.sha256(looked_at.tobytes()).digest()
        original = first.setdefault(digest, name)
        if _is_white(image, scene.mask(view)):
            white.append(name)
        elif looked_at.any():
            copies += [f"{name} of {original}"] * (original != name)
        elif scene.mask(view).any() and not image.any():
            black.append(name)
    folder = scene.image_paths[0].parent
    if black:
        print(f"WARNING: {folder}: all black: {some(black)}: remove these views")
    if white:
        print(f"WARNING: {folder}: all white: {some(white)}: remove these views")
    if copies:
        print(
            f"WARNING: {folder}: copies of other photos, under poses of their own: "
            f"{some(copies)}: give each pose its photo"
        )
