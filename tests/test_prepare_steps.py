# SPDX-License-Identifier: Apache-2.0
"""Laws of the steps from photos to a scene, each by itself."""

import dataclasses
import fractions
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational
from scipy import ndimage

from internal import color
from internal.errors import UserError
from internal.files import color_profile, image_io, made_folder, raw, video
from internal.prepare import (
    attempts,
    brighten,
    checks,
    frame_choice,
    matching,
    photos,
    pipeline,
    plots,
    reasons,
    scene_files,
    statistics,
)
from internal.prepare.checking import epipolar_error, neighbours
from internal.prepare.mapping import Mapped
from internal.prepare.orient import DISTANCE, scene_frame
from internal.prepare.photos import find_photos
from internal.prepare.pipeline import NOTES
from internal.prepare.video_frames import extract_frames
from internal.prepare.zooms import split
from internal.scene import colmap, exposures
from internal.scene.pose_comparison import compare_poses
from tests.scene_writers import (
    facing_world,
    flat_picture,
    random_rotation,
    surrounding_world,
)

RECIPE = brighten.Recipe(brighten=True, blur=1.0)


def random_light(seed=0, size=(40, 60, 3)):
    return np.random.default_rng(seed).uniform(0.01, 0.05, size)


def srgb(linear):
    return np.asarray(color.linear_to_srgb(linear), np.float32)


def test_a_copy_does_not_depend_on_how_dark_the_photo_is():
    light = random_light()
    copies = [brighten.make_copy(srgb(light * e), RECIPE) for e in (1.0, 0.1, 0.01)]
    np.testing.assert_allclose(copies[0], copies[1], atol=1e-4)
    np.testing.assert_allclose(copies[0], copies[2], atol=1e-3)
    assert 0.5 < copies[0].mean() < 1.0


def test_light_by_table_is_light_by_formula():
    levels = np.arange(256, dtype=np.float32) / 255.0
    expected = np.asarray(color.srgb_to_linear(levels))
    np.testing.assert_allclose(color.photo_to_linear(levels), expected, rtol=1e-6)


def test_a_plain_copy_keeps_grey_as_it_is():
    grey = flat_picture(40.0)
    copy = brighten.make_copy(grey, brighten.AS_IT_IS)
    np.testing.assert_allclose(copy, grey[..., :1], atol=1e-6)


def test_large_photos_shrink_in_proportion():
    assert brighten.copy_size(4000, 3000) == (1600, 1200)
    assert brighten.copy_size(500, 375) == (500, 375)
    copy = brighten.make_copy(flat_picture(9.0, 3200, 16), brighten.AS_IT_IS)
    assert copy.shape == (8, 1600, 1)


@pytest.mark.parametrize("deviation", [0.004, 0.02])
def test_noise_is_measured_and_edges_are_not(deviation):
    noise = np.random.default_rng(0).normal(0.0, deviation, (200, 200))
    edges = np.where(np.arange(200) // 20 % 2, 0.2, 0.6)
    assert statistics.noise_level(noise + 0.5) == pytest.approx(deviation, rel=0.05)
    assert statistics.noise_level(noise + edges) == pytest.approx(deviation, rel=0.25)


def test_statistics_of_a_flat_photo():
    found = statistics.measure_photo(flat_picture(17.0))
    assert (found.mean, found.noise, found.used_levels) == (17.0, 0.0, 1.0)
    assert found.histogram[17] == 24 * 18 * 3
    assert statistics.measure_photo(flat_picture(2.0)).is_black
    assert not found.is_black
    assert not found.is_white


def test_a_photo_is_white_up_to_a_thousandth():
    picture = flat_picture(255.0, 100, 100)
    picture[0, :9] = 0.4
    assert statistics.measure_photo(picture).is_white
    picture[1, :9] = 0.4
    assert not statistics.measure_photo(picture).is_white


def test_a_folder_that_has_a_video_alone_says_how_to_give_it(tmp_path):
    (tmp_path / "day 1").mkdir()
    (tmp_path / "day 1" / "GOPR0001.MP4").touch()
    with pytest.raises(UserError, match=r"no photo .* video .*1/GOPR0001\.MP4 give"):
        photos.list_names(tmp_path)


def test_a_step_that_no_two_frames_show_is_no_number():
    said = frame_choice.ChosenFrames((0, 1), 0, 0, float("inf")).describe()
    assert "moved on farther than can be followed;" in said
    assert "by 5% of" in frame_choice.ChosenFrames((0,), 0, 0, 0.05).describe()


def test_a_blurred_picture_is_less_sharp():
    rng = np.random.default_rng(0)
    sharp = rng.uniform(0.0, 0.1, (16, 16)).repeat(4, axis=0).repeat(4, axis=1)
    soft = (sharp + np.roll(sharp, 3, axis=1) + np.roll(sharp, 6, axis=1)) / 3.0
    assert statistics.sharpness(soft) < statistics.sharpness(sharp)
    assert statistics.sharpness(0.3 * sharp) == pytest.approx(
        statistics.sharpness(sharp), rel=1e-3
    )


@pytest.mark.parametrize("world", [facing_world(), surrounding_world()])
def test_the_scene_frame_is_level_centred_and_blind_to_the_old_frame(world):
    poses = scene_frame(world.camtoworlds, world.points).poses(world.camtoworlds)
    up = poses[:, :, 1].sum(axis=0)
    np.testing.assert_allclose(up / np.linalg.norm(up), [0.0, 0.0, 1.0], atol=1e-6)
    distances = np.linalg.norm(poses[:, :, 3], axis=-1)
    assert np.median(distances) == pytest.approx(DISTANCE)
    moved = world.moved(3.0, random_rotation(), np.array([5.0, -2.0, 1.0]))
    again = scene_frame(moved.camtoworlds, moved.points).poses(moved.camtoworlds)
    np.testing.assert_allclose(
        distances, np.linalg.norm(again[:, :, 3], axis=-1), rtol=0.02
    )


def sightings(gains, points=60, noise=0.02, seed=0):
    """Log light of points that about half of the views see."""
    rng = np.random.default_rng(seed)
    light = rng.uniform(-5.0, -2.0, (points, 3))
    views, seen = np.nonzero(rng.random((len(gains), points)) < 0.6)
    log_light = (
        light[seen] + np.log(gains)[views] + rng.normal(0, noise, (len(seen), 3))
    )
    return views, seen, log_light


def test_random_exposures_are_recovered_despite_wrong_matches():
    rng = np.random.default_rng(1)
    gains = 2.0 ** rng.uniform(-1.0, 1.0, (8, 3))
    views, points, log_light = sightings(gains)
    log_light[rng.random(len(views)) < 0.1] += 1.5
    log_light[3] = np.nan
    found = exposures.estimate(views, points, log_light, 8)
    expected = gains / np.exp(np.log(gains).mean(axis=0))
    np.testing.assert_allclose(found.gains, expected, rtol=0.04)
    assert not found.equal


def test_equal_exposures_change_nothing():
    found = exposures.estimate(*sightings(np.ones((6, 3)), noise=0.1), 6)
    assert found.equal
    np.testing.assert_array_equal(found.gains, np.ones((6, 3)))
    assert 0.0 < np.abs(found.measured_stops).max() < exposures.EQUAL_STOPS


def test_a_view_without_sightings_keeps_gain_one():
    gains = np.array([[1.0] * 3, [2.0] * 3, [0.5] * 3])
    found = exposures.estimate(*sightings(gains), 4)
    np.testing.assert_array_equal(found.gains[3], np.ones(3))


def test_light_is_sampled_where_pixels_say_and_not_where_it_is_clipped():
    picture = flat_picture(0.0)
    picture[:, 12:] = 100.0 / 255.0
    light = exposures.sample_light(picture, np.array([[4.5, 4.5], [18.5, 4.5]]))
    assert np.isnan(light[0]).all()
    expected = np.log(float(color.srgb_to_linear(100.0 / 255.0)))
    np.testing.assert_allclose(light[1], expected, rtol=1e-5)


def test_what_stops_colmap_is_said_in_one_line(tmp_path):
    database = tmp_path / "database.db"
    database.write_bytes(b"no database" * 100)
    copies = [matching.Copy(8, 8, "one", 0.0)]
    with pytest.raises(UserError, match=r"COLMAP stopped \(.*\); .*--overwrite"):
        matching.extract_features(database, tmp_path, copies, 0.01)


def test_pairs_are_all_or_neighbours_and_ever_farther_ones():
    assert len(matching.choose_pairs(10, exhaustive=True)) == 45
    pairs = matching.choose_pairs(200, exhaustive=False)
    assert len(set(pairs)) == len(pairs)
    assert {j - i for i, j in pairs} == {*range(1, 13), 16, 32, 64, 128}


def test_groups_are_linked_by_strong_matches_alone():
    matches = {(0, 1): 90, (1, 2): 40, (2, 3): 16, (3, 4): 70, (4, 5): 50}
    assert reasons.linked_groups(matches, 7) == [[0, 1, 2], [3, 4, 5], [6]]
    assert reasons.second_scene(matches, 7, (0, 1, 2), 3) == [3, 4, 5]
    assert reasons.second_scene(matches, 7, (0, 1, 2, 3), 3) == []


def test_each_unplaced_photo_gets_its_reason():
    features = np.array([500, 10, 500, 500])
    matches = {(0, 2): 30}
    given = [reasons.why_unplaced(v, matches, features) for v in range(4)]
    assert "matches 1 photos" in given[0]
    assert "only 10 features" in given[1]
    assert "shares nothing" in given[3]


GOOD = checks.Geometry(20, 0.8, 1000, 30.0, has_depth_range=True)
DARK = statistics.measure_photo(srgb(random_light()))


def test_a_good_scene_is_fit_without_warnings():
    verdict = checks.judge(GOOD, [DARK] * 20, (), 0.0)
    assert (verdict.fit, verdict.warnings) == (True, ())


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"registered": 9}, "have a pose"),
        ({"error": 9.0}, "poses are wrong"),
        ({"error": float("nan")}, "poses are wrong"),
        ({"points": 3}, "texture"),
        ({"points": 8 * GOOD.registered}, "may be wrong"),
        ({"has_depth_range": False}, "Config.near"),
    ],
)
def test_each_fault_makes_a_scene_unfit(change, word):
    verdict = checks.judge(dataclasses.replace(GOOD, **change), [DARK] * 20, (), 0.0)
    assert not verdict.fit
    assert word in verdict.warnings[0]


def test_photos_that_do_not_fit_their_poses_make_a_scene_unfit():
    verdict = checks.judge(GOOD, [DARK] * 20, (), 0.0, ("a.png", "b.png"))
    assert not verdict.fit
    assert "2 photos do not fit their poses (a.png, b.png)" in verdict.warnings[0]


def attempt_on(views, points):
    """An attempt that placed so many views, on so many points."""
    options = pycolmap.SyntheticDatasetOptions(
        num_rigs=1, num_frames_per_rig=views, num_points3D=points
    )
    model = Mapped(pycolmap.synthesize_dataset(options), tuple(range(views)))
    return attempts.Attempt(attempts.WAYS[0], Path(), (model,))


def test_the_best_attempt_rests_on_points_then_places_most():
    shaky, whole, partial = attempt_on(8, 50), attempt_on(8, 200), attempt_on(6, 200)
    nothing = attempts.Attempt(attempts.WAYS[0], Path(), ())
    assert [a.solid for a in (shaky, whole, nothing)] == [False, True, False]
    ranked = sorted([nothing, shaky, partial, whole], key=lambda a: a.rank)
    assert ranked == [whole, partial, shaky, nothing]


def test_a_similarity_is_no_difference_and_a_turn_is():
    world = surrounding_world()
    moved = world.moved(0.3, random_rotation(), np.ones(3))
    same = compare_poses(moved.camtoworlds, world.camtoworlds)
    assert max(same.rotations.max(), same.centres.max()) < 1e-6
    turned = world.camtoworlds.copy()
    turned[0, :, :3] = turned[0, :, :3] @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    assert compare_poses(turned, world.camtoworlds).rotations[0] > 60.0


def test_neighbours_on_a_circle_are_beside_each_other():
    pairs = neighbours(surrounding_world(views=12).camtoworlds)
    steps = {min((j - i) % 12, (i - j) % 12) for i, j in pairs}
    assert {1} < steps <= {1, 2}


def test_matches_lie_where_right_poses_put_them_and_not_where_others_do():
    world = facing_world()
    local = [(world.points - c[:, 3]) @ c[:, :3] for c in world.camtoworlds]
    seen = np.stack([colmap.project(world.lens, points) for points in local], axis=1)
    inside = ((seen > 0) & (seen < [world.lens.width, world.lens.height])).all((1, 2))
    pixels = {(i, i + 1): seen[inside, i : i + 2] for i in range(5)}
    lenses = [world.lens] * 6
    assert epipolar_error(world.camtoworlds, lenses, pixels) < 1e-6
    assert epipolar_error(world.camtoworlds[::-1], lenses, pixels) > 0.1
    turned = world.camtoworlds * np.array([-1.0, 1.0, -1.0, 1.0])  # looking backwards
    assert epipolar_error(turned, lenses, pixels) > 0.5
    assert epipolar_error(world.camtoworlds, lenses, {}) == world.lens.width


# Steps of a walk along the wall, in pixels per frame: it stands still, goes on, goes
# faster with blur in two frames of three, and jumps to another wall.
STEPS = [0] * 10 + [2] * 20 + [4] * 12 + [0] * 5
BLURRED = {i for i in range(30, 42) if i % 3}


def dark_film(noise=1.0):
    """Frames [96, 128, 3] uint8 of at most 20 levels, as a hand-held camera takes."""
    rng = np.random.default_rng(0)
    walls = [ndimage.gaussian_filter(rng.normal(size=(96, 400)), 2.0) for _ in range(2)]
    places = [*np.cumsum(STEPS), *([150] * 3)]
    for number, place in enumerate(places):
        wall = walls[number >= len(STEPS)]
        if number in BLURRED:
            wall = ndimage.uniform_filter1d(wall, 11, axis=1)
        level = 10.0 + 4.0 * wall[:, place : place + 128] / walls[0].std()
        noisy = level[..., None] + rng.normal(0.0, noise, (96, 128, 3))
        yield np.clip(np.round(noisy), 0, 255).astype(np.uint8)


def test_frames_of_a_dark_video_are_sharp_and_a_step_apart(tmp_path, capsys):
    pytest.importorskip("av")
    path = tmp_path / "film.mp4"
    video.write_video(dark_film(), path, 10)
    extract_frames(path, tmp_path / "frames")
    chosen = [int(p.stem) for p in sorted((tmp_path / "frames").iterdir())]
    places = np.cumsum(STEPS)
    walk = [place for place in places[[c for c in chosen if c < len(STEPS)]]]
    assert not BLURRED & set(chosen)
    assert sum(c < 10 for c in chosen) == 1  # one of a standstill
    assert sum(c >= len(STEPS) for c in chosen) == 1  # and one of the other wall
    assert np.diff(walk).min() >= 0.01 * 128 and np.diff(walk).max() <= 0.11 * 128
    said = capsys.readouterr().out
    assert f"50 frames, {len(chosen)} chosen" in said and "8 blurred" in said


def test_steps_are_as_long_as_a_video_allows():
    """A long walk has enough frames at full steps, a short one takes smaller ones."""
    rng = np.random.default_rng(1)
    wall = ndimage.gaussian_filter(rng.normal(size=(96, 700)), 3.0) / 0.1
    levels = np.clip(128 + 40 * wall, 0, 255).astype(np.uint8)
    walk = [levels[:, place : place + 128] for place in range(0, 560, 4)]
    steps = []
    for copies in (walk, walk[:20]):
        choice = frame_choice.choose(
            copies, rng.uniform(0.6, 1.0, len(copies)).tolist()
        )
        assert len(choice.chosen) + choice.blurred + choice.alike == len(copies)
        steps.append(np.diff(choice.chosen).mean() * 4 / 128)
    assert frame_choice.NEAREST <= steps[0] <= 1.5 * frame_choice.FARTHEST
    assert steps[1] < 0.6 * steps[0]


@pytest.mark.parametrize("zoom, turn", [(0.06, 0.0), (0.0, 0.1)])
def test_motion_that_leaves_the_middle_in_place_counts(zoom, turn):
    rng = np.random.default_rng(2)
    wall = ndimage.gaussian_filter(rng.normal(size=(96, 128)), 3.0)
    levels = np.clip(128 + 400 * wall, 0, 255).astype(np.uint8)
    y, x = np.mgrid[:96, :128] - np.array([48.0, 64.0])[:, None, None]
    there = np.stack([y + turn * x, x - turn * y]) * (1.0 - zoom)
    moved = ndimage.map_coordinates(
        levels, there + np.array([48.0, 64.0])[:, None, None], order=1, mode="nearest"
    )
    assert 0.005 < frame_choice.motion(levels, moved) < 0.06
    assert frame_choice.motion(levels, levels) == 0.0
    assert frame_choice.motion(levels, levels[::-1, ::-1]) == np.inf


def write_ten_bits(path, levels, codes, tags=""):
    """A film of one 16-bit picture, coded without loss in 10 bits.

    In Matroska: FFmpeg fails to write x265's first film to MOV and MP4 now and then.

    Args:
        codes: of matrix, primaries and transfer (H.273).
    """
    av = pytest.importorskip("av")
    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx265", rate=10)
        stream.height, stream.width, _ = levels.shape
        stream.pix_fmt = "yuv420p10le"
        stream.options = {"x265-params": f"log-level=none:lossless=1{tags}"}
        codec = stream.codec_context
        codec.colorspace, codec.color_primaries, codec.color_trc = codes
        frame = av.VideoFrame.from_ndarray(levels, format="rgb48le")
        coded = frame.reformat(format="yuv420p10le", dst_colorspace=codes[0])
        file.mux(stream.encode(coded))
        file.mux(stream.encode())


@pytest.mark.parametrize(
    ("transfer", "name", "white"),
    [(16, "smpte2084", 0.5806), (18, "arib-std-b67", 0.7499)],
)
def test_frames_of_hdr_videos_are_srgb(tmp_path, capsys, transfer, name, white):
    """Grey at white's signal is white, at half of it is far below half."""
    path = tmp_path / "film.mkv"
    levels = np.full((64, 64, 3), round(white * 65535), np.uint16)
    levels[:, 32:] = round(0.5 * white * 65535)
    tags = f":colorprim=bt2020:colormatrix=bt2020nc:transfer={name}:range=limited"
    write_ten_bits(path, levels, (9, 9, transfer), tags)
    extract_frames(path, tmp_path / "frames")
    srgb = image_io.read_srgb(tmp_path / "frames" / "00000.png")
    half = color_profile.to_srgb(
        np.full((1, 1, 3), white / 2, np.float32),
        color_profile.from_codes(9, transfer),
    )
    np.testing.assert_allclose(srgb[:, :30], 1.0, atol=0.01)
    np.testing.assert_allclose(srgb[:, 34:], float(half.mean()), atol=0.005)
    assert half.mean() < 0.45
    assert "brought to sRGB" in capsys.readouterr().out


def test_ten_bits_of_a_video_stay(tmp_path):
    path = tmp_path / "film.mkv"
    ramp = np.linspace(4000, 8000, 64).astype(np.uint16)
    levels = np.broadcast_to(ramp[None, :, None], (64, 64, 3)).copy()
    write_ten_bits(path, levels, (1, 1, 1))
    extract_frames(path, tmp_path / "frames")
    srgb = image_io.read_srgb(tmp_path / "frames" / "00000.png")
    assert len(np.unique(srgb[0, :, 1])) > 40  # 8 bits have 16 levels there
    np.testing.assert_allclose(srgb[0, :, 1], ramp / 65535.0, atol=0.002)


@pytest.mark.parametrize(("aspect", "width"), [((4, 3), 85), ((200, 201), 64)])
def test_frames_have_square_pixels_whatever_the_video_has(tmp_path, aspect, width):
    av = pytest.importorskip("av")
    path = tmp_path / "film.mp4"
    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx264", rate=10)
        stream.height, stream.width, stream.pix_fmt = 48, 64, "yuv420p"
        stream.codec_context.sample_aspect_ratio = fractions.Fraction(*aspect)
        grey = np.full((48, 64, 3), 60, np.uint8)
        frame = av.VideoFrame.from_ndarray(grey, format="rgb24")
        file.mux(stream.encode(frame.reformat(format="yuv420p")))
        file.mux(stream.encode())
    extract_frames(path, tmp_path / "frames")
    srgb = image_io.read_srgb(tmp_path / "frames" / "00000.png")
    assert srgb.shape == (48, width, 3)
    np.testing.assert_allclose(srgb, 60 / 255, atol=0.02)


@pytest.mark.parametrize(
    ("name", "reason"), [("film.mp4", "not a readable"), ("film.mkv", "ends after")]
)
def test_a_video_that_was_copied_in_part_says_so(tmp_path, name, reason):
    path = tmp_path / name
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 255, (30, 64, 64, 3), dtype=np.uint8)
    video.write_video(iter(noise), path, 10)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(UserError, match=f"{name}: {reason}"):
        extract_frames(path, tmp_path / "frames")
    assert not (tmp_path / "frames").exists()


def test_pictures_that_are_not_taken_are_reported(tmp_path):
    for i in range(3):
        image_io.write(tmp_path / f"{i}.png", flat_picture(20.0 + i))
    (tmp_path / "9.gif").touch()
    (tmp_path / "gone.jpg").symlink_to("nowhere")
    before = pipeline._fingerprint(tmp_path)
    for name in ("@eaDir/0.png", ".DS_Store", "._0.png", "notes.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"metadata")
    found = find_photos(tmp_path, tmp_path.with_suffix(".notes"))
    assert [photo.name for photo in found.photos] == ["0.png", "1.png", "2.png"]
    reasons = {entry.name: entry.reason for entry in found.rejected}
    assert reasons.keys() == {"9.gif", "gone.jpg"}
    assert reasons["gone.jpg"] == "a link to nothing"
    assert pipeline._fingerprint(tmp_path) == before
    image_io.write(tmp_path / "3.png", flat_picture(9.0))
    assert pipeline._fingerprint(tmp_path) != before


def test_photos_at_two_zooms_do_not_share_a_lens_and_one_without_the_film_tag_neither(
    tmp_path,
):
    for i, focal in enumerate((24, 24, 40)):
        tags = Image.Exif()
        tags[0x010F] = "Maker"
        tags.get_ifd(0x8769)[0x920A] = IFDRational(focal, 1)
        picture = Image.new("RGB", (64, 48), (40 + 20 * i, 30, 20))
        picture.save(tmp_path / f"{i}.jpg", exif=tags)
    wide, also_wide, tele = find_photos(tmp_path, tmp_path / NOTES).photos
    assert wide.camera == also_wide.camera != tele.camera
    assert "24 mm" in wide.camera and "40 mm" in tele.camera


def test_a_camera_is_split_where_its_focal_lengths_jump():
    cameras = dict.fromkeys(range(5), "phone") | {5: "other"}
    focal_lengths = {0: 500.0, 1: 760.0, 2: 505.0, 3: 530.0, 4: 750.0, 5: 9000.0}
    zooms = split(cameras, focal_lengths)
    assert zooms[0] == zooms[2] == zooms[3] != zooms[1] == zooms[4]
    assert zooms[5] == "other"
    assert split(cameras, dict.fromkeys(range(6), 500.0)) == cameras


def test_heic_photos_become_png_and_their_jpeg_twin_is_one_shot(tmp_path):
    pytest.importorskip("pillow_heif").register_heif_opener()
    pictures = [Image.new("RGB", (64, 48), (40 + 20 * i, 30, 20)) for i in range(4)]
    for i, picture in enumerate(pictures):
        picture.save(tmp_path / f"{i}.heic", quality=90)
    pictures[3].save(tmp_path / "3.JPG")
    found = find_photos(tmp_path, tmp_path / NOTES)
    assert [p.scene_name for p in found.photos] == ["0.png", "1.png", "2.png", "3.JPG"]
    assert found.rejected[0].reason.startswith("the same shot as 3.JPG")
    scene_files.place_photo(found.photos[0], tmp_path / "scene")
    placed = image_io.read_srgb(tmp_path / "scene" / "images" / "0.png")
    np.testing.assert_allclose(placed[24, 32] * 255.0, (40, 30, 20), atol=3.0)


def test_what_was_read_before_is_not_read_again(tmp_path, monkeypatch):
    for i in range(4):
        image_io.write(tmp_path / f"{i}.png", flat_picture(10.0 * i))
    before = find_photos(tmp_path, tmp_path / NOTES)
    with (tmp_path / NOTES).open("a") as file:
        file.write('["5.png", {"na')
    monkeypatch.setattr(photos, "read_photo", None)
    assert find_photos(tmp_path, tmp_path / NOTES) == before
    assert [len(before.photos), before.rejected[0].name] == [3, "0.png"]


def test_raw_beside_its_jpeg_is_one_shot(tmp_path):
    for i in range(3):
        image_io.write(tmp_path / f"{i}.jpg", flat_picture(20.0 + i))
    (tmp_path / "1.dng").write_bytes(b"raw")
    found = find_photos(tmp_path, tmp_path / NOTES)
    assert [photo.name for photo in found.photos] == ["0.jpg", "1.jpg", "2.jpg"]
    assert found.rejected[0].reason.startswith("the same shot as 1.jpg")


def test_of_files_that_are_developed_to_one_name_one_is_taken(tmp_path):
    for name in ("1.dng", "1.EXR", "1.heic", "2.dng", "2.exr", "3.dng", "4.dng"):
        (tmp_path / name).write_bytes(name.encode())
    reasons = photos._twins(tmp_path, [p.name for p in sorted(tmp_path.iterdir())])
    assert reasons.keys() == {"1.dng", "1.EXR", "2.dng"}
    assert reasons["1.dng"].startswith("the same shot as 1.heic")


def test_a_broken_raw_photo_is_named(tmp_path):
    (tmp_path / "1.dng").write_bytes(b"raw")
    with pytest.raises(UserError, match=r"1\.dng: (not a readable RAW|RAW photo; run)"):
        raw.develop(tmp_path / "1.dng")


def test_linear_photos_become_8_bit_png(tmp_path):
    for i in range(3):
        image_io.write(tmp_path / f"{i}.exr", np.full((8, 8, 3), 0.01 * (i + 1)))
    photo = find_photos(tmp_path, tmp_path / NOTES).photos[0]
    assert photo.scene_name == "0.png"
    assert photo.statistics.mean == 25.0  # sRGB of 0.01 is 0.0999


def test_a_folder_begun_is_gone_on_with_until_it_is_finished(tmp_path):
    folder = tmp_path / "made"
    assert made_folder.begin_folder(folder, {"a": 1}, overwrite=False) is None
    (folder / "part").touch()
    assert made_folder.begin_folder(folder, {"a": 1}, overwrite=False) is None
    assert (folder / "part").exists()
    with pytest.raises(UserError, match="a was 1, now 2"):
        made_folder.begin_folder(folder, {"a": 2}, overwrite=False)
    made_folder.finish_folder(folder, {"n": 3.0})
    assert made_folder.begin_folder(folder, {"a": 1}, overwrite=False) == {"n": 3.0}
    assert made_folder.begin_folder(folder, {"a": 1}, overwrite=True) is None
    assert not (folder / "part").exists()


def test_the_histogram_of_photos_with_white_lamps_is_drawn(tmp_path):
    counts = np.full(256, 10)
    plots.plot_histogram(counts, tmp_path / "histogram.png")
    assert image_io.read_srgb(tmp_path / "histogram.png").std() > 0.0


def test_truth_in_linear_light_is_developed_like_a_photo(tmp_path):
    for i in range(3):
        image_io.write(tmp_path / f"{i}.png", flat_picture(9.0 + i, 8, 8))
    photo = find_photos(tmp_path, tmp_path / NOTES).photos[1]
    truth = tmp_path / "truth.exr"
    image_io.write(truth, np.full((8, 8, 3), 0.2))
    scene_files.place_truth(photo, truth, tmp_path / "scene")
    placed = image_io.read_srgb(tmp_path / "scene" / "high" / "1.png")
    expected = color.quantize(color.linear_to_srgb(np.full((8, 8, 3), 0.2)))
    np.testing.assert_allclose(placed, expected, atol=1e-6)
