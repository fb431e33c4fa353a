# SPDX-License-Identifier: Apache-2.0
"""compare.py and figures.py end to end on tiny scenes; trainings are stood in for."""

import json
import urllib.parse
from pathlib import Path

import numpy as np
import pytest

import compare as compare_script
import figures as figures_script
from internal import extras
from internal.comparison import jobs, lime, scored_run
from internal.comparison.jobs import Job
from internal.errors import UserError
from internal.files import image_io
from internal.launching import launch
from internal.launching.run import RECORD
from internal.training import run_folder
from tests.scene_writers import facing_world, write_blender, write_llff

WORLD = facing_world()
LIST = """
["dark photo"]
["x gain"]
output = "gain_to_mean"
["LIME"]
photos = "lime"
["{folder}"]
photos = "enhanced/*"
["LIME + NeRF"]
photos = "lime"
train = ["tiny.gin"]
["ours"]
train = ["tiny.gin"]
output = "enhanced"
"""
needs_opencv = pytest.mark.skipif(
    not extras.has("cv2"), reason="the extra enhance2d is not installed"
)


@pytest.fixture
def trainings(monkeypatch):
    """Instead of training: writes what eval.py would, and notes each start. Whoever
    puts a name of a run folder into ``failing`` sees it fail."""
    started, failing = [], []

    class Here:
        def __init__(self, jobs):
            self.runs = []

        def submit(self, run):
            self.runs.append(run)

        def ended(self):
            over, self.runs = self.runs, []
            for run in over:
                images = [x for x in run.commands[0] if "images_dir" in x]
                started.append((run.folder.name, images))
                if run.folder.name not in failing:
                    write_scored(run)
            return over

        def leave(self):
            raise AssertionError("nothing stops it")

    monkeypatch.setattr(launch, "Machine", Here)
    return started, failing


def write_scored(run):
    for output in ("dark", "v", "r", "v_enhanced", "enhanced"):
        (run.folder / "eval" / output).mkdir(parents=True)
        picture = np.full((18, 24, 3), 0.7, np.float32)
        image_io.write(run.folder / "eval" / output / "00.png", picture)
    scores = {"unchanged": {"psnr": 11.0}, "enhanced": {"psnr": 12.0}}
    run.result.write_text(json.dumps({"mean": scores}))
    steps = [{"step": n, "seconds": 45.0 * n, "psnr": 10.0 * n} for n in (1, 2)]
    (run.folder / run_folder.LOG).write_text("\n".join(map(json.dumps, steps)))
    (run.folder / RECORD).write_text(run.record)


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """A scene with truth and a folder of enhanced photos; the current folder."""
    monkeypatch.chdir(tmp_path)
    Path("methods.toml").write_text(LIST)
    Path("tiny.gin").touch()
    folder = write_blender(Path("scene"), WORLD)
    for name in WORLD.names:
        bright = np.full((18, 24, 3), 150 / 255, np.float32)  # the truth of view 0
        (folder / "enhanced" / "mine").mkdir(parents=True, exist_ok=True)
        image_io.write(folder / "enhanced" / "mine" / f"enh_{name}", bright)
    return folder


def compare(*scenes):
    depths = [f"--gin_bindings=Config.{x}" for x in ("near = 2.5", "far = 7.0")]
    lists = ["--methods", "methods.toml"]
    return compare_script.main([*scenes, "--out", "out", *lists, *depths])


@needs_opencv
def test_every_method_has_a_row_and_a_picture(scene, trainings, capsys):
    assert compare("scene") == 0
    rows = json.loads(Path("out/results.json").read_text())["scene"]
    assert list(rows) == ["dark photo", "x gain", "LIME", "mine", "LIME + NeRF", "ours"]
    assert rows["mine"]["scores"]["psnr"] == 100.0  # equal to the truth
    assert rows["x gain"]["scores"]["psnr"] > rows["dark photo"]["scores"]["psnr"]
    assert rows["ours"]["scores"] == {"psnr": 12.0}
    assert rows["ours"]["train_minutes"] == 1.5
    dark = image_io.read_srgb(Path("scene/low/00.png"))
    enhanced = image_io.read_srgb(Path("out/scene/photos/lime/00.png"))
    np.testing.assert_allclose(enhanced, lime.lime(dark), atol=0.5 / 255 + 1e-6)
    assert len(list(Path("out/scene/photos/lime").glob("*.png"))) == len(WORLD.names)
    for name in ("comparison", "decomposition"):
        assert image_io.read_srgb(Path(f"out/scene/{name}.png")).size > 0
    assert {p.suffix for p in Path("out").glob("table.*")} == {".md", ".csv", ".tex"}
    page = Path("out/index.html").read_text()
    assert "scene/comparison.png" in page and "<h2>Command</h2>" in page
    shown = "scene/scores/lime/dark/00.png", "scene/runs/tiny@dark/eval/v/00.png"
    assert all(urllib.parse.quote(picture) in page for picture in shown)
    assert "Training on scene" in page
    assert "| mine | **100.00** |" in capsys.readouterr().out


@needs_opencv
def test_models_train_on_the_photos_of_their_method(scene, trainings):
    compare("scene")
    lime_photos = str(Path("out/scene/photos/lime").resolve())
    assert dict(trainings[0]) == {
        "tiny@lime": [f"--gin_bindings=Config.images_dir = {lime_photos!r}"],
        "tiny@dark": [],
    }


@needs_opencv
def test_a_second_run_does_only_what_is_new(scene, trainings):
    compare("scene")
    kept = Path("out/scene/scores/lime/metrics.json").stat().st_mtime_ns
    photos = Path("out/scene/photos/lime/00.png").stat().st_mtime_ns
    Path("methods.toml").write_text(LIST + '["gamma"]\noutput = "gamma_curve"')
    compare("./scene")
    assert "| gamma |" in Path("out/table.md").read_text()
    assert Path("out/scene/scores/lime/metrics.json").stat().st_mtime_ns == kept
    assert Path("out/scene/photos/lime/00.png").stat().st_mtime_ns == photos
    assert len(trainings[0]) == 2


@needs_opencv
def test_a_training_that_fails_costs_only_its_rows(scene, trainings, capsys):
    trainings[1].append("tiny@lime")
    assert compare("scene") == 1
    rows = json.loads(Path("out/results.json").read_text())["scene"]
    assert list(rows) == ["dark photo", "x gain", "LIME", "mine", "ours"]
    assert "tiny on lime photos of scene failed" in capsys.readouterr().err


@needs_opencv
def test_what_is_masked_is_in_no_score_and_a_view_of_nothing_else_has_none(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    Path("methods.toml").write_text('["dark"]\n["LIME"]\nphotos = "lime"')
    rng = np.random.default_rng(0)
    own = rng.uniform(0.0, 0.2, (18, 24, 3)).astype(np.float32)
    mask = np.ones((18, 24, 1), bool)
    mask[4:8, 6:20] = False
    for folder in ("a", "b"):
        write_blender(Path(folder), WORLD, test=(0, 1))
        Path(folder, "masks").mkdir()
        for name, counted in (("00.png", mask), ("01.png", mask & ~mask)):
            image_io.write(Path(folder, "masks", name), np.repeat(counted, 3, -1) * 1.0)
            for kind in ("low", "high"):
                garbage = rng.random((18, 24, 3)).astype(np.float32)
                image_io.write(
                    Path(folder, kind, name), np.where(counted, own, garbage)
                )
    assert compare("a", "b") == 0
    for photos in ("dark", "lime"):
        scores = [
            Path("out", folder, "scores", photos, "metrics.json").read_text()
            for folder in ("a", "b")
        ]
        assert scores[0] == scores[1]
        found = json.loads(scores[0])
        assert list(found["views"]) == ["00.png"]
        assert found["masked"] == {"00.png": 1.0 - mask.mean(), "01.png": 1.0}
    truth = image_io.read_srgb(Path("out/a/scores/dark/truth/00.png"))
    assert len(np.unique(truth[~mask[..., 0]], axis=0)) == 2  # stripes


@needs_opencv
def test_enhanced_photos_are_transparent_where_the_photo_was(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_llff(Path("scene"), WORLD)
    rgba = np.full((18, 24, 4), 0.1, np.float32)
    rgba[..., 3] = np.arange(24) > 9
    image_io.write(Path("scene/images/00.png"), rgba)
    Path("methods.toml").write_text('["LIME"]\nphotos = "lime"')
    assert compare("scene") == 0
    photo = Path("out/scene/photos/lime/00.png")
    np.testing.assert_array_equal(image_io.read_alpha(photo), rgba[..., 3])
    assert not image_io.read_header(photo.with_name("01.png")).has_alpha


def test_scenes_without_truth_have_figures_and_no_scores(scene):
    write_llff(Path("plain"), WORLD)
    Path("methods.toml").write_text('["dark"]\n["x gain"]\noutput = "gain_to_mean"')
    assert compare("plain") == 0
    rows = json.loads(Path("out/results.json").read_text())["plain"]
    assert rows["x gain"]["scores"] == {}
    assert Path("out/plain/comparison.png").is_file()


def test_other_bindings_or_another_scene_of_that_name_are_refused(scene):
    jobs.open_comparison(Path("out"), [Path("a/s")], ["Config.factor = 2"])
    jobs.open_comparison(Path("out"), [Path("a/t")], ["Config.factor = 2"])
    assert set(jobs.scenes_of(Path("out"))) == {"s", "t"}
    with pytest.raises(UserError, match="other bindings"):
        jobs.open_comparison(Path("out"), [Path("a/s")], [])
    with pytest.raises(UserError, match="scene s was"):
        jobs.open_comparison(Path("out"), [Path("b/s")], ["Config.factor = 2"])
    with pytest.raises(UserError, match="same folder name"):
        jobs.open_comparison(Path("new"), [Path("a/s"), Path("b/s")], [])
    assert not Path("new").exists()


def test_each_method_gets_the_bindings_it_reads_and_one_that_none_reads_is_refused(
    monkeypatch,
):
    monkeypatch.chdir(Path(__file__).parents[1])
    scene = Path("scene")
    fast, plain = ("configs/llnerf_fast.gin",), ("configs/nerf_fast.gin",)
    photos, paper, nerf = (Job(scene, "", files) for files in ((), fast, plain))
    every = ["Config.factor = 2", "HashGrid.finest = 32", "Train.enhance_start = 12"]
    assert jobs.settings(paper, every) == every
    assert jobs.settings(nerf, every) == every[:2]
    assert jobs.settings(photos, every) == every[:1]
    jobs.check_settings([photos, paper], every)
    with pytest.raises(UserError, match=r"enhance_start = 12 has no effect"):
        jobs.check_settings([photos, nerf], every)


class TestFigures:
    @pytest.fixture(autouse=True)
    def _done(self, scene):
        Path("methods.toml").write_text('["mine"]\nphotos = "enhanced/mine"')
        compare("scene")

    def test_a_crop_and_a_view_can_be_chosen(self):
        figures = ["out", "--scene", "scene", "--methods", "mine", "--view", "00"]
        before = image_io.read_srgb(Path("out/scene/comparison.png"))
        assert figures_script.main([*figures, "--crop", "2", "3", "8", "6"]) == 0
        after = image_io.read_srgb(Path("out/scene/comparison.png"))
        assert after.shape != before.shape

    @pytest.mark.parametrize(
        ("arguments", "complaint"),
        [
            (["--crop", "20", "0", "8", "8"], "leaves the picture of 24x18"),
            (["--crop", "0", "0", "1", "1"] * 5, "at most 4"),
            (["--view", "77"], "no test view '77'; there are 00"),
            (["--scene", "other"], "no scene other; has scene"),
            (["--methods", "yours"], "no row 'yours'; it has mine"),
            (["--renderings-only"], "no rendering to show"),
            (["--columns", "0"], "--columns"),
        ],
    )
    def test_what_is_not_there_is_one_line(self, arguments, complaint):
        with pytest.raises(UserError, match=complaint):
            figures_script.main(["out", *arguments])

    def test_another_folder_is_refused(self):
        with pytest.raises(UserError, match="make it with compare"):
            figures_script.main(["scene"])


def test_a_run_is_done_only_with_its_configuration(tmp_path):
    run, other = (
        scored_run.scored_run("r", tmp_path, [], bindings)
        for bindings in ([], ["Train.log_every = 7"])
    )
    assert not run.is_done()
    write_scored(run)
    assert run.is_done() and not other.is_done()
    run.result.unlink()
    assert not run.is_done()
