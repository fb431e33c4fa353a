# SPDX-License-Identifier: Apache-2.0
"""prepare.py end to end on a rendered room: cameras, files, report, bad input."""

import contextlib
import json
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

import prepare as prepare_script
from internal.color import linear_to_srgb, srgb_to_linear
from internal.errors import UserError
from internal.files import image_io
from internal.prepare import attempts, brighten, mapping, sharpness
from internal.prepare.pipeline import Inputs, prepare
from internal.scene import colmap, readers
from internal.scene.config import SceneConfig
from internal.scene.gains import measured_exposures
from internal.scene.pose_comparison import compare_poses
from internal.scene.scene import load_scene
from tests.scene_writers import edit_json, flat_picture
from tests.textured_room import FOCAL, room_cameras, write_room

ROOT = Path(__file__).parents[1]
VIEWS = 7


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """Dark photos, one of them in a subfolder, among files that are none."""
    folder = tmp_path_factory.mktemp("photos")
    write_room(folder, VIEWS)
    (folder / "more").mkdir()
    (folder / "06.png").rename(folder / "more" / "06.png")
    (folder / "05.png").rename(folder / "05.jpg")  # a PNG under a wrong name
    shutil.copyfile(folder / "00.png", folder / "copy.png")
    (folder / "empty.jpg").touch()
    (folder / "torn.png").write_bytes((folder / "00.png").read_bytes()[:900])
    image_io.write(folder / "lid.png", flat_picture(1.0))
    (folder / "notes.txt").write_text("no photo")
    return folder


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    folder = tmp_path_factory.mktemp("truth")
    write_room(folder, VIEWS, exposure=1.0)
    (folder / "more").mkdir()
    (folder / "06.png").rename(folder / "more" / "06.png")
    return folder


@pytest.fixture(scope="module")
def scene(photos, truth, tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes") / "room"
    before = sorted((p, p.stat().st_mtime_ns) for p in photos.rglob("*"))
    code = prepare_script.main([str(photos), str(folder), "--gt", str(truth)])
    assert code == 0
    assert before == sorted((p, p.stat().st_mtime_ns) for p in photos.rglob("*"))
    return folder


@pytest.fixture
def only_first_way(monkeypatch):
    monkeypatch.setattr(attempts, "WAYS", attempts.WAYS[:1])


def inputs(photos, pose_images=None, truth=None):
    return Inputs(photos, pose_images, truth)


def test_every_photo_finds_its_camera(scene):
    files = readers.read_files(scene, "auto", "")
    assert len(files.names) == VIEWS
    difference = compare_poses(files.camtoworlds, room_cameras(VIEWS))
    assert difference.rotations.max() < 0.5
    assert difference.centres.max() < 0.01


def test_the_trainer_loads_both_splits_with_truth(scene):
    views = {
        split: load_scene(SceneConfig(str(scene)), split).view_names
        for split in ("train", "test")
    }
    assert views["test"] == ("00.png",)
    assert len(views["train"]) == VIEWS - 1
    assert len(load_scene(SceneConfig(str(scene)), "train").truth) == VIEWS - 1


def test_photos_are_copied_byte_by_byte(photos, scene):
    for name in ("00.png", "05.jpg", "more/06.png"):
        assert (scene / "images" / name).read_bytes() == (photos / name).read_bytes()


def test_the_report_says_what_is_missing_and_why(scene):
    report = json.loads((scene / "report" / "report.json").read_text())
    assert (report["photos"], report["registered"], report["fit"]) == (11, VIEWS, True)
    reasons = {entry["name"]: entry["reason"] for entry in report["failed"]}
    assert set(reasons) == {"copy.png", "empty.jpg", "torn.png", "lid.png"}
    assert "same file as 00.png" in reasons["copy.png"]
    assert "black" in reasons["lid.png"]
    assert "not a readable image" in reasons["torn.png"]
    assert 0.0 < report["near"] < report["far"]
    page = (scene / "report" / "index.html").read_text()
    for shown in ("cameras.png", "brightness.png", "exposures.png", "train.py"):
        assert shown in page
    assert (scene / "report" / "cameras.png").is_file()
    assert not (scene / "work").exists()


def test_the_same_photos_make_the_same_scene(photos, scene, tmp_path):
    again = tmp_path / "again"
    prepare(inputs(photos), again, overwrite=False)
    for name in ("transforms.json", "sparse/0/points3D.bin", "exposures.json"):
        assert (again / name).read_bytes() == (scene / name).read_bytes()


def test_a_prepared_scene_is_not_prepared_again(photos, truth, scene, monkeypatch):
    monkeypatch.setattr(attempts, "try_ways", None)
    argv = [str(photos), str(scene), "--gt", str(truth)]
    assert prepare_script.main(argv) == 0
    with pytest.raises(UserError, match=r"made with other settings.*--overwrite"):
        prepare_script.main(argv[:2])


def test_an_interrupted_run_goes_on(photos, tmp_path, monkeypatch, only_first_way):
    def interrupt(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(mapping, "map_incrementally", interrupt)
        with pytest.raises(KeyboardInterrupt):
            prepare(inputs(photos), tmp_path / "scene", overwrite=False)
    assert not (tmp_path / "scene" / "transforms.json").exists()
    monkeypatch.setattr(brighten, "make_copy", interrupt)
    monkeypatch.setattr(attempts, "make_copy", interrupt)
    report = prepare(inputs(photos), tmp_path / "scene", overwrite=False)
    assert report.registered == VIEWS


def test_bright_twins_give_poses_where_photos_are_too_dark(truth, tmp_path):
    dark = tmp_path / "dark"
    write_room(dark, VIEWS, exposure=2e-3)
    (dark / "more").mkdir()
    (dark / "06.png").rename(dark / "more" / "06.png")
    report = prepare(inputs(dark, pose_images=truth), tmp_path / "s", overwrite=False)
    assert report.registered == VIEWS
    assert report.tried[0].way == "as it is"
    assert report.mean_level < 10.0


def test_random_exposures_are_written(tmp_path, only_first_way):
    stops = np.array([0.5, -1.0, 0.0, 1.0, -0.5, 0.25, -0.25])
    write_room(tmp_path / "photos", VIEWS, exposure=0.05 * 2.0**stops)
    prepare(inputs(tmp_path / "photos"), tmp_path / "scene", overwrite=False)
    content = json.loads((tmp_path / "scene" / "exposures.json").read_text())
    gains = np.array([content["gains"][f"{view:02}.png"] for view in range(VIEWS)])
    expected = 2.0 ** (stops - stops.mean())
    np.testing.assert_allclose(gains, np.tile(expected, (3, 1)).T, rtol=0.03)


def test_a_photo_that_moved_is_named_and_left_out_unless_asked_for(tmp_path, capsys):
    photos = tmp_path / "photos"
    write_room(photos, VIEWS)
    for name, axis in (("02.png", 1), ("05.png", 0)):
        light = srgb_to_linear(image_io.read_srgb(photos / name))
        moved = ndimage.uniform_filter1d(np.asarray(light), 9, axis)
        image_io.write(photos / name, np.asarray(linear_to_srgb(moved)))
    scene = tmp_path / "scene"
    assert prepare_script.main([str(photos), str(scene)]) == 0
    assert (
        "7 of 7 photos have a pose (2 left out as blurred)" in capsys.readouterr().out
    )
    kept = tuple(f"{view:02}.png" for view in (0, 1, 3, 4, 6))
    assert readers.read_files(scene, "auto", "").names == kept
    assert readers.read_files(scene, "colmap", "").names == kept
    assert sorted(path.name for path in (scene / "images").iterdir()) == [*kept]
    report = json.loads((scene / "report" / "report.json").read_text())
    assert set(report["left_out"]) == {"02.png", "05.png"}
    assert min(report["sharpness"][name] for name in kept) > sharpness.BLURRED
    argv = [str(photos), str(scene), "--keep-blurred"]
    with pytest.raises(UserError, match="other settings"):
        prepare_script.main(argv)
    assert prepare_script.main([*argv, "--overwrite"]) == 0
    assert len(readers.read_files(scene, "auto", "").names) == VIEWS
    assert "blurred: 02.png: 0." in (shown := capsys.readouterr().out)
    assert "kept" in shown and "left out" not in shown


def test_photos_without_tags_at_two_zooms_get_a_lens_each(tmp_path):
    zooms = {2: 1.5, 5: 1.5, 8: 1.5}
    cameras = write_room(tmp_path / "photos", 10, zooms=zooms)
    prepare(inputs(tmp_path / "photos"), tmp_path / "scene", overwrite=False)
    files = readers.read_files(tmp_path / "scene", "auto", "")
    assert len(files.names) == len(cameras)
    focal_lengths = [colmap.focal_lengths(lens)[0] for lens in files.lenses]
    expected = FOCAL * np.array([zooms.get(view, 1.0) for view in range(10)])
    np.testing.assert_allclose(focal_lengths, expected, rtol=0.03)
    assert compare_poses(files.camtoworlds, cameras).rotations.max() < 1.0
    report = json.loads((tmp_path / "scene" / "report" / "report.json").read_text())
    assert "a lens per zoom" in report["tried"][0]["way"]


def test_check_accepts_right_poses_and_refuses_wrong_ones(scene, tmp_path, capsys):
    assert prepare_script.main(["--check", str(scene), "--reference", str(scene)]) == 0
    assert "rotation median 0.000" in capsys.readouterr().out
    report = json.loads((scene / "report" / "report.json").read_text())
    files = readers.read_files(scene, "auto", "")
    trained_with = measured_exposures(scene, files, np.ones(len(files.names), bool), ())
    assert trained_with is not None
    largest = np.abs(trained_with.measured_stops).max()
    assert report["exposure_stops"] == pytest.approx(largest, rel=1e-6)
    wrong = tmp_path / "wrong"
    shutil.copytree(scene, wrong)
    shutil.rmtree(wrong / "sparse")

    def exchange(content):
        frames = content["frames"]
        poses = [frame["transform_matrix"] for frame in frames]
        for frame, pose in zip(frames, poses[1::2] + poses[::2], strict=True):
            frame["transform_matrix"] = pose

    edit_json(wrong / "transforms.json", exchange)
    page = tmp_path / "page"
    assert prepare_script.main(["--check", str(wrong), "--report", str(page)]) == 1
    assert "the poses are wrong" in (page / "index.html").read_text()


def test_a_scene_without_points_is_checked_on_points_of_its_photos(
    scene, tmp_path, capsys
):
    bare = tmp_path / "bare"
    shutil.copytree(scene, bare, ignore=shutil.ignore_patterns("sparse", "report"))
    edit_json(bare / "transforms.json", lambda c: c.pop("ply_file_path", None))
    assert prepare_script.main(["--check", str(bare)]) == 0
    report = json.loads((bare / "report/report.json").read_text())
    assert report["points"] > 12 * VIEWS
    assert "no points under these poses" not in capsys.readouterr().out
    for photo in (bare / "images").rglob("*.*"):
        image_io.write(photo.with_suffix(".png"), flat_picture(9.0, 240, 180))
    prepare_script.main(["--check", str(bare)])
    assert "no points under these poses" in capsys.readouterr().out


def test_two_scenes_are_told_apart(tmp_path, only_first_way):
    folder = tmp_path / "photos"
    write_room(folder, 4)
    write_room(folder, 4, seed=5, first=10)
    with pytest.raises(UserError, match=r"two scenes: 4 photos .* 4 with 1?0"):
        prepare(inputs(folder), tmp_path / "scene", overwrite=False)
    assert not (tmp_path / "scene" / "transforms.json").exists()
    assert (tmp_path / "scene" / "report" / "index.html").is_file()


def test_photos_without_overlap_are_refused(tmp_path, only_first_way):
    folder = tmp_path / "photos"
    for seed in range(3):
        write_room(folder, 1, seed=seed, first=seed)
    with pytest.raises(UserError, match="0 of 3 photos could be placed: too few"):
        prepare(inputs(folder), tmp_path / "scene", overwrite=False)


def test_black_photos_are_refused(tmp_path):
    for level in range(3):
        image_io.write(tmp_path / f"{level}.png", flat_picture(float(level)))
    with pytest.raises(UserError, match=r"0 usable photos of 3.*0\.png: black"):
        prepare(inputs(tmp_path), tmp_path.parent / "scene", overwrite=False)


@pytest.mark.parametrize(
    ("level", "message"),
    [
        (0.0, r"2 usable photos of 3.*empty\.png: black"),
        (255.0, r"2 usable .*empty\.png: white.* shorter"),
    ],
    ids=["black", "white"],
)
def test_too_few_usable_photos_are_refused(level, message, tmp_path):
    folder = tmp_path / "photos"
    write_room(folder, 2)
    image_io.write(folder / "empty.png", flat_picture(level))
    with pytest.raises(UserError, match=message):
        prepare(inputs(folder), tmp_path / "scene", overwrite=False)


def test_a_full_disk_stops_before_the_work(photos, tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)._replace(free=1000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    with pytest.raises(UserError, match="free space"):
        prepare(inputs(photos), tmp_path / "scene", overwrite=False)


@contextlib.contextmanager
def files_of_at_most(size):
    """Writing more bytes into a file fails, in COLMAP's threads as well."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_disk_that_fills_up_keeps_what_was_computed(
    photos, tmp_path, monkeypatch, only_first_way
):
    scene = tmp_path / "scene"
    with (
        files_of_at_most(1 << 20),
        pytest.raises(UserError, match=r"scene.*cannot write.*goes on from here"),
    ):
        prepare(inputs(photos), scene, overwrite=False)
    assert len([*scene.glob("work/blur_1/*.png")]) == VIEWS
    monkeypatch.setattr(attempts, "make_copy", None)
    assert prepare(inputs(photos), scene, overwrite=False).registered == VIEWS


def test_the_folder_of_photos_is_never_written_to(photos, tmp_path):
    with pytest.raises(UserError, match="lies in"):
        prepare(inputs(photos), photos / "scene", overwrite=False)
    (tmp_path / "mine.txt").write_text("precious")
    with pytest.raises(UserError, match="not made by this program"):
        prepare(inputs(photos), tmp_path, overwrite=True)


def test_bad_input_is_one_line_and_exit_code_two(tmp_path):
    (tmp_path / "film.mp4").write_bytes(b"not a film")
    result = subprocess.run(
        [sys.executable, "prepare.py", str(tmp_path / "film.mp4"), str(tmp_path / "s")],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert result.returncode == 2
    lines = result.stderr.strip().splitlines()
    assert lines[-1].startswith("error: ")
    assert "film.mp4: not a readable video" in lines[-1]
    assert "Traceback" not in result.stderr
