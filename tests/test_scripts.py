# SPDX-License-Identifier: Apache-2.0
"""The scripts end to end on a tiny night scene: train, resume, evaluate, render."""

import dataclasses
import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import av
import chex
import jax
import numpy as np
import pytest

import eval as eval_script
import render as render_script
import sweep as sweep_script
import train as train_script
from internal import parallel
from internal.cli import load_split
from internal.comparison import scored_run
from internal.comparison.variants import parse_variant
from internal.configs import load_config
from internal.errors import Diverged, UserError
from internal.files import image_io
from internal.launching.run import RECORD
from internal.pages import parts
from internal.scoring import metrics
from internal.training import run_folder
from internal.training.checkpoints import load_trained
from tests.conftest import TINY_MODEL, TINY_PLAIN, bindings, flags
from tests.scene_writers import (
    LENS,
    facing_world,
    frame_entries,
    intrinsics,
    write_json,
    write_pictures,
)

ROOT = Path(__file__).parents[1]


def trained_state(run):
    config = load_config([], [*TINY_MODEL, f"Config.checkpoint_dir = {str(run)!r}"])
    return load_trained(config, parallel.data_mesh(jax.device_count()))[1]


def test_pictures_take_their_shares_of_the_samples_of_the_same_model(run):
    own = [*TINY_MODEL, f"Config.checkpoint_dir = {str(run)!r}"]
    mesh = parallel.data_mesh(jax.device_count())
    whole, _ = load_trained(load_config([], own), mesh)
    assert whole.config.num_samples == (6, 7)
    halved = load_config([], [*own, "Render.sample_shares = (0.5, 0.01)"])
    model, _ = load_trained(halved, mesh)
    assert model.config.num_samples == (3, 1)
    same = dataclasses.replace(model.config, num_samples=(6, 7))
    assert same == whole.config == halved.model


@pytest.fixture
def scene(night):
    return night


@pytest.fixture
def run(night_run):
    return night_run


def test_training_explains_its_folder(run):
    assert (
        json.loads((run / "config.json").read_text())["model"]["field"]["width"] == 16
    )
    assert (run / "command.txt").is_file()
    lines = [json.loads(x) for x in (run / "metrics.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines] == [2, 4, 6]
    assert lines[0]["loss/exposure"] == 0.0 < lines[-1]["loss/exposure"]
    assert 0.0 < lines[0]["seconds"] < lines[-1]["seconds"]
    assert run_folder.training_seconds(run) == lines[-1]["seconds"]
    assert any((run / "tensorboard").iterdir())


def test_a_log_line_that_was_cut_short_stops_nothing(tmp_path):
    rows = [{"step": 2, "seconds": 1.0}, {"step": 4, "seconds": 2.5}]
    whole = "".join(json.dumps(row) + "\n" for row in rows)
    (tmp_path / run_folder.LOG).write_text(whole + '{"step": 6, "sec')
    assert run_folder.read_log(tmp_path) == rows
    assert run_folder.training_seconds(tmp_path) == 2.5
    with run_folder.RunLog(tmp_path, 2) as log:
        log.scalars(4, {"psnr": 30.0})
    assert [row["step"] for row in run_folder.read_log(tmp_path)] == [2, 4]


def test_other_poses_or_sizes_are_another_path(scene):
    cameras = load_split(load_config([], bindings(scene)), "train").cameras
    path, back = cameras.take(np.array([0, 1])), cameras.take(np.array([1, 0]))
    larger = dataclasses.replace(path, widths=np.asarray(path.widths) + 1)
    prints = {render_script.fingerprint(c) for c in (path, back, larger)}
    assert len(prints) == 3
    assert render_script.fingerprint(cameras.take(np.array([0, 1]))) in prints


def test_a_resumed_run_equals_an_uninterrupted_one(scene, run, tmp_path, monkeypatch):
    half = tmp_path / "half"
    check_finite = train_script.check_finite

    def interrupt_after_three(stats, step):
        if step == 3:
            signal.raise_signal(signal.SIGINT)
        check_finite(stats, step)

    monkeypatch.setattr(train_script, "check_finite", interrupt_after_three)
    assert train_script.main(flags(scene, half)) == 130
    assert int(trained_state(half).step) == 4
    monkeypatch.undo()
    assert train_script.main(flags(scene, half)) == 0
    chex.assert_trees_all_equal(trained_state(half), trained_state(run))
    lines = (half / "metrics.jsonl").read_text().splitlines()
    assert [json.loads(line)["step"] for line in lines] == [2, 4, 6]


def test_other_settings_do_not_go_on_in_the_same_folder(scene, run):
    with pytest.raises(UserError, match=r"Gamma\.gray was 0\.1, is 0\.5"):
        train_script.main(flags(scene, run, "Gamma.gray = 0.5"))


def test_seconds_of_training_add_up_over_starts(tmp_path):
    assert run_folder.training_seconds(tmp_path) == 0.0
    lines = [{"step": 1, "seconds": 60.0}, {"step": 2, "seconds": 100.0}]
    path = tmp_path / run_folder.LOG
    path.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    with run_folder.RunLog(tmp_path, 1) as log:  # step 2 was lost with a crash
        log.scalars(2, {})
    assert 60.0 <= run_folder.training_seconds(tmp_path) < 100.0


KILLED = """
import os, signal, sys, train
from tests import conftest  # its devices and compiler flags
check_finite = train.check_finite
def killed_after_five(stats, step):
    check_finite(stats, step)
    if step == 5:
        os.kill(os.getpid(), signal.SIGKILL)
train.check_finite = killed_after_five
train.main(sys.argv[1:])
"""


def test_a_killed_run_goes_on_as_if_nothing_was(scene, run, tmp_path):
    """Killed between checkpoints 3 and 6, when step 4 was logged already."""
    killed = tmp_path / "[2024] it's killed"
    command = [sys.executable, "-c", KILLED, *flags(scene, killed)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert [row["step"] for row in run_folder.read_log(killed)] == [2, 4]
    assert train_script.main(flags(scene, killed)) == 0
    chex.assert_trees_all_equal(trained_state(killed), trained_state(run))
    assert [row["step"] for row in run_folder.read_log(killed)] == [2, 4, 6]


def test_a_finished_run_is_trained_for_longer(run, tmp_path):
    longer = tmp_path / "longer"
    shutil.copytree(run, longer)
    more = "--gin_bindings=Train.max_steps = 8"
    assert train_script.main([f"--run={longer}", more]) == 0
    assert int(trained_state(longer).step) == 8


@pytest.mark.parametrize(
    "own",
    ["MLP.width = 24", "Config.near = 0.7", "Config.factor = 2", "Train.seed = 9"],
)
def test_a_run_is_used_with_its_own_settings_alone(scene, run, own):
    name = own.partition(" ")[0]
    for script in (eval_script, render_script):
        with pytest.raises(UserError, match=rf"other settings \({name} was"):
            script.main([f"--run={run}", f"--gin_bindings={own}"])


def test_a_run_that_diverges_stops_and_keeps_the_last_good_checkpoint(scene, tmp_path):
    run = tmp_path / "wild"
    wild = ("Optimizer.lr_init = 1e30", "Train.checkpoint_every = 1")
    with pytest.raises(Diverged, match=r"step \d+: not finite: "):
        train_script.main(flags(scene, run, *wild))
    leaves = jax.tree.leaves(trained_state(run).params)
    assert all(np.all(np.isfinite(leaf)) for leaf in leaves)


def test_evaluation_writes_pictures_and_scores(run):
    assert eval_script.main([f"--run={run}"]) == 0
    result = json.loads((run / "eval" / "metrics.json").read_text())
    assert result["step"] == 6
    assert list(result["views"]) == ["000.png"]
    enhanced, dark = (result["mean"][name] for name in ("enhanced", "dark"))
    assert {"psnr", "ssim", "psnr_exposure_matched", "psnr_color_corrected"} <= set(
        enhanced
    )
    assert enhanced["psnr_exposure_matched"] >= enhanced["psnr"]
    assert {"psnr", "ssim"} <= set(dark)
    assert {"gain_to_mean", "gamma_curve"} <= result["mean"].keys()
    outputs = "enhanced dark truth v r v_enhanced alpha gamma depth gain_to_mean"
    for output in [*outputs.split(), "evidence"]:
        picture = image_io.read_srgb(run / "eval" / output / "000.png")
        assert picture.shape == (32, 36, 3)
    assert (run / "eval" / "index.html").is_file()


def test_test_views_of_bright_photos_alone_are_scored_against_them(tmp_path):
    """A scene as RealX3D's."""
    world, folder, own = facing_world(), tmp_path / "scene", tmp_path / "run"
    for split, views, level in (("train", (0, 1, 2, 3), 4.0), ("test", (4, 5), 150.0)):
        write_pictures(folder / split, world.names, level)
        frames = [frame_entries(world, split)[view] for view in views]
        content = {**intrinsics(LENS), "near": 2.0, "far": 7.0, "frames": frames}
        write_json(folder / f"transforms_{split}.json", content)
    assert train_script.main(flags(folder, own)) == 0
    assert eval_script.main([f"--run={own}"]) == 0
    result = json.loads((own / "eval/metrics.json").read_text())
    assert result["views"].keys() == {"04.png", "05.png"}
    assert "enhanced" in result["mean"] and "dark" not in result["mean"]
    assert not (own / "eval/input").exists() and (own / "eval/truth/04.png").is_file()


def test_evaluation_shows_and_leaves_out_what_is_masked(run, tmp_path, monkeypatch):
    shutil.copytree(run, tmp_path / "run")
    mask = np.ones((32, 36), bool)
    mask[:8] = False

    def load_masked(config, split):
        scene = load_split(config, split)
        if split == "train":
            return scene
        hidden = np.uint16(40000)
        under = {
            view: np.where(mask[..., None], truth, hidden)
            for view, truth in scene.truth.items()
        }
        return dataclasses.replace(scene, masks=(mask,), truth=under)

    monkeypatch.setattr(eval_script.cli, "load_split", load_masked)
    assert eval_script.main([f"--run={tmp_path / 'run'}"]) == 0
    folder = tmp_path / "run" / "eval"
    result = json.loads((folder / "metrics.json").read_text())
    assert result["masked"] == {"000.png": 0.25}
    enhanced, truth = (
        image_io.read_srgb(folder / output / "000.png")
        for output in ("enhanced", "truth")
    )
    scores = metrics.score(enhanced, truth, mask)
    assert result["views"]["000.png"]["enhanced"] == pytest.approx(scores, rel=1e-4)
    assert len(np.unique(truth[:8].reshape(-1, 3), axis=0)) == 2  # stripes
    text = "Hatched pixels of photo and truth (25.0 % on average) are masked"
    assert text in (folder / "index.html").read_text()


def test_rendering_writes_videos_and_goes_on_where_it_stopped(scene, run):
    arguments = [f"--run={run}"]
    assert render_script.main(arguments) == 0
    folder = run / "render" / "auto"
    for name in "enhanced dark v r depth evidence".split():
        with av.open(folder / f"{name}.mp4") as video:
            assert video.streams.video[0].frames == 3
            assert video.streams.video[0].codec_context.pix_fmt == "yuv420p"
    (folder / "settings.json").write_text('{"step": ')  # cut short: all anew
    assert render_script.main(arguments) == 0
    kept, lost = (folder / "enhanced" / f"000{k}.png" for k in (0, 1))
    before, lost_bytes = kept.stat().st_mtime_ns, lost.read_bytes()
    lost.unlink()
    assert render_script.main(arguments) == 0
    assert kept.stat().st_mtime_ns == before
    assert lost.read_bytes() == lost_bytes


def test_other_light_renders_anew_and_only_changes_the_enhanced_scene(scene, run):
    folder = run / "render" / "auto"
    render_script.main(flags(scene, run))
    plain = image_io.read_srgb(folder / "enhanced" / "0000.png")
    dark = (folder / "dark" / "0000.png").read_bytes()
    render_script.main(flags(scene, run, "Render.exposure = 1.0"))
    brighter = image_io.read_srgb(folder / "enhanced" / "0000.png")
    assert brighter.mean() > 1.2 * plain.mean()
    assert (folder / "dark" / "0000.png").read_bytes() == dark


def test_a_plain_nerf_trains_evaluates_and_renders(scene, tmp_path):
    arguments = flags(scene, tmp_path, model=TINY_PLAIN)
    for script in (train_script, eval_script, render_script):
        assert script.main(arguments) == 0
    mean = json.loads((tmp_path / "eval" / "metrics.json").read_text())["mean"]
    assert mean.keys() == {"dark", "unchanged", "gain_to_mean", "gamma_curve"}
    assert not (tmp_path / "eval" / "enhanced").exists()


def test_a_sweep_compares_what_is_done_and_runs_nothing_twice(scene, run, tmp_path):
    eval_script.main(flags(scene, run))
    arguments = flags(scene, tmp_path)
    variants = ["--variants", "bright: Gamma.exposure_target = 0.9"]
    for name, own in {"full": [], "bright": ["Gamma.exposure_target = 0.9"]}.items():
        shutil.copytree(run / "eval", tmp_path / name / "eval")
        folder = tmp_path / name
        done = scored_run.scored_run(name, folder, [], [*bindings(scene), *own])
        (folder / RECORD).write_text(done.record)
    assert sweep_script.main([*arguments, *variants]) == 0
    assert "| bright |" in (tmp_path / "table.md").read_text()
    assert len((tmp_path / "table.csv").read_text().splitlines()) == 3
    assert image_io.read_srgb(tmp_path / "sheet.png").shape[0] > 2 * 32
    page = (tmp_path / "index.html").read_text()
    for shown in ("bright/eval/depth/000.png", "full/eval/truth/000.png", "sheet.png"):
        assert shown in page
    assert 'href="bright/eval/index.html"' in page


def test_curves_of_several_runs_share_a_chart_and_leave_out_what_never_changes(
    run, tmp_path
):
    (tmp_path / run_folder.LOG).write_text("")
    runs = {"one": run, "two": run, "none yet": tmp_path}
    (part,) = parts.training_curves("Training", runs)
    assert part.html.count("loss/data") == 1
    assert "seconds" not in part.html
    assert "one" in part.html and "two" in part.html and "none yet" not in part.html
    assert parts.training_curves("Training", {"none yet": tmp_path}) == []


@pytest.mark.parametrize(
    ("variants", "message"),
    [
        (["a: Gamma.gray = 0.2", "a: Gamma.gray = 0.3"], "'a': two are called so"),
        (["full: Gamma.gray = 0.2"], "'full': two are called so"),
        (["a: Gamma.gray = 0.2", "b: Gamma.gray = 0.2"], "'b': .* those of 'a'"),
        (["a: Gamma.gray = 0.2", "b: Gamma.grey = 0.2"], "'b': gin: .*grey"),
    ],
)
def test_a_sweep_refuses_before_the_first_training(
    variants, message, scene, tmp_path, monkeypatch
):
    monkeypatch.setattr(sweep_script, "scored_run", pytest.fail)
    arguments = [*flags(scene, tmp_path), "--variants", *variants]
    with pytest.raises(UserError, match=message):
        sweep_script.main(arguments)
    with pytest.raises(UserError, match="--run"):
        sweep_script.main([])


@pytest.mark.parametrize("text", ["gray 0.2", "a/b: Gamma.gray = 0.2", ": x = 1"])
def test_a_variant_that_is_neither_file_nor_bindings_is_refused(text):
    with pytest.raises(UserError, match="variant"):
        parse_variant(text)
