# SPDX-License-Identifier: Apache-2.0
"""Features of copies and their matches, in a COLMAP database.

Views are numbered in the order of their names; the copy of view i is ``copy_name(i)``
and its pixel coordinates are (x, y), (0.5, 0.5) at the centre of the top-left pixel.
What a database holds already is not computed again, so an interrupted run goes on.
Which thread finishes first changes nothing: images are entered before their features,
and every RANSAC starts from ``SEED``.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pycolmap
from jaxtyping import Float, Int

from internal import progress
from internal.prepare.room import room

SEED = 1
EXHAUSTIVE_UP_TO = 100  # views; beyond, neighbours in order of names come first
SEQUENCE_OVERLAP = 12
MAX_FEATURES = 4096  # per copy: the largest ones, which noise disturbs least
COPIES_PER_CALL = 8
PAIRS_PER_CALL = 200
BYTES_PER_FEATURE = 200  # in the database: position and descriptor
BYTES_PER_MATCH = 20  # both ends, before and after verification
BYTES_PER_COPY = 2000  # name, lens, frame
LOGGED = 2  # the database writes twice: its log first
# Focal length over the longer side where EXIF says nothing: about 43 mm equivalent.
UNKNOWN_FOCAL = 1.2
LENS_MODEL = "SIMPLE_RADIAL"

Pairs = list[tuple[int, int]]


@dataclasses.dataclass(frozen=True)
class Copy:
    """A picture that features are looked for in."""

    width: int
    height: int
    camera: str  # copies with equal ones share a lens
    focal: float  # pixels; 0 if unknown


def copy_name(view: int) -> str:
    """File name of a view's copy."""
    return f"{view:06}.png"


def view_of(name: str) -> int:
    """The view whose copy has that name."""
    return int(Path(name).stem)


def choose_pairs(count: int, *, exhaustive: bool) -> Pairs:
    """Pairs of views to match: all, or neighbours and ever farther ones.

    The distances 16, 32, 64, ... close the loops of a walk around a place.
    """
    if exhaustive:
        return list(itertools.combinations(range(count), 2))
    near = range(1, SEQUENCE_OVERLAP + 1)
    far = itertools.takewhile(lambda s: s < count, (2**k for k in itertools.count(4)))
    steps = [*near, *far]
    return [(i, i + s) for i in range(count) for s in steps if i + s < count]


def extract_features(
    database: Path, folder: Path, copies: Sequence[Copy], peak_threshold: float
) -> None:
    """Finds features in the copies in ``folder``; shows progress."""
    _enter_copies(database, copies)
    options = pycolmap.FeatureExtractionOptions(use_gpu=False)
    options.sift.peak_threshold = peak_threshold
    options.sift.max_num_features = MAX_FEATURES
    names = [copy_name(view) for view in range(len(copies))]
    with progress.bar(len(names), "finding features", "photo") as shown:
        for start in range(0, len(names), COPIES_PER_CALL):
            chunk = names[start : start + COPIES_PER_CALL]
            features = len(chunk) * MAX_FEATURES
            with room(database.parent, LOGGED * features * BYTES_PER_FEATURE):
                pycolmap.extract_features(
                    database, folder, image_names=chunk, extraction_options=options
                )
            shown.update(len(chunk))


def match(database: Path, pairs: Pairs) -> None:
    """Matches pairs of views and keeps what one motion explains; shows progress."""
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = SEED
    matching = pycolmap.FeatureMatchingOptions(use_gpu=False)
    listing = database.with_suffix(".pairs.txt")
    pairing = pycolmap.ImportedPairingOptions(match_list_path=str(listing))
    with progress.bar(len(pairs), "matching", "pair") as shown:
        for start in range(0, len(pairs), PAIRS_PER_CALL):
            chunk = pairs[start : start + PAIRS_PER_CALL]
            lines = [f"{copy_name(i)} {copy_name(j)}" for i, j in chunk]
            matches = len(chunk) * MAX_FEATURES
            with room(database.parent, LOGGED * matches * BYTES_PER_MATCH):
                listing.write_text("\n".join(lines) + "\n")
                pycolmap.match_image_pairs(database, matching, pairing, verification)
            shown.update(len(chunk))


def copy_matches(source: Path, database: Path, copies: Sequence[Copy]) -> None:
    """Makes a database of the same features and verified matches with other cameras."""
    size = source.stat().st_size
    _enter_copies(database, copies)
    with (
        room(database.parent, LOGGED * size),
        _opened(source) as read,
        _opened(database) as written,
        pycolmap.DatabaseTransaction(written),
    ):
        numbers = {i.name: i.image_id for i in written.read_all_images()}
        same = {i.image_id: numbers[i.name] for i in read.read_all_images()}
        for old, new in same.items():
            written.write_keypoints(new, read.read_keypoints(old))
        for pair, geometry in zip(*read.read_two_view_geometries(), strict=True):
            a, b = pycolmap.pair_id_to_image_pair(pair)
            written.write_two_view_geometry(same[a], same[b], geometry)


def feature_counts(database: Path) -> Int[np.ndarray, " views"]:
    """Number of features of each view."""
    with _opened(database) as opened:
        images = sorted(opened.read_all_images(), key=lambda image: image.name)
        counts = [opened.num_keypoints_for_image(image.image_id) for image in images]
    return np.array(counts, np.int64)


def match_counts(database: Path) -> dict[tuple[int, int], int]:
    """Number of verified matches of each pair of views that has any."""
    with _opened(database) as opened:
        views = {i.image_id: view_of(i.name) for i in opened.read_all_images()}
        pair_ids, counts = opened.read_two_view_geometry_num_inliers()
    pairs = (pycolmap.pair_id_to_image_pair(pair_id) for pair_id in pair_ids)
    return {
        (min(views[a], views[b]), max(views[a], views[b])): count
        for (a, b), count in zip(pairs, counts, strict=True)
        if count
    }


def matched_pixels(
    database: Path,
) -> dict[tuple[int, int], Float[np.ndarray, "_matches 2 2"]]:
    """Pixel coordinates of the verified matches of each pair: [match, view, xy]."""
    found = {}
    with _opened(database) as opened:
        images = opened.read_all_images()
        views = {image.image_id: view_of(image.name) for image in images}
        keypoints = {i.image_id: opened.read_keypoints(i.image_id) for i in images}
        pair_ids, geometries = opened.read_two_view_geometries()
    for pair_id, geometry in zip(pair_ids, geometries, strict=True):
        a, b = pycolmap.pair_id_to_image_pair(pair_id)
        first, second = np.asarray(geometry.inlier_matches).reshape(-1, 2).T
        if len(first):
            ends = keypoints[a][first, :2], keypoints[b][second, :2]
            found[views[a], views[b]] = np.stack(ends, axis=1).astype(np.float64)
    return found


def _opened(database: Path) -> pycolmap.Database:
    return pycolmap.Database.open(database)


def _enter_copies(database: Path, copies: Sequence[Copy]) -> None:
    """Enters lenses and images, numbered by view: all of them, and only once."""
    size = LOGGED * len(copies) * BYTES_PER_COPY
    with (
        room(database.parent, size),
        _opened(database) as opened,
        pycolmap.DatabaseTransaction(opened),
    ):
        if opened.num_images():
            return
        rigs: dict[str, tuple[int, int]] = {}
        for view, copy in enumerate(copies):
            if copy.camera not in rigs:
                rigs[copy.camera] = _enter_camera(opened, copy)
            camera_id, rig_id = rigs[copy.camera]
            image = pycolmap.Image(name=copy_name(view), camera_id=camera_id)
            image_id = opened.write_image(image)
            frame = pycolmap.Frame()
            frame.rig_id = rig_id
            frame.add_data_id(opened.read_image(image_id).data_id)
            opened.write_frame(frame)


def _enter_camera(opened: pycolmap.Database, copy: Copy) -> tuple[int, int]:
    """Writes a lens and the rig of it alone; returns both ids."""
    focal = copy.focal or UNKNOWN_FOCAL * max(copy.width, copy.height)
    params = [focal, copy.width / 2.0, copy.height / 2.0, 0.0]
    camera = pycolmap.Camera(
        model=LENS_MODEL, width=copy.width, height=copy.height, params=params
    )
    camera.has_prior_focal_length = copy.focal > 0.0
    camera_id = opened.write_camera(camera)
    rig = pycolmap.Rig()
    rig.add_ref_sensor(opened.read_camera(camera_id).sensor_id)
    return camera_id, opened.write_rig(rig)
