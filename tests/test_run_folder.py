# SPDX-License-Identifier: Apache-2.0
"""A run folder: whose it is, of which scene, and what may differ when it is used."""

import copy
import json
import subprocess
import sys
from pathlib import Path

import pytest

from internal import configs
from internal.cli import load_split
from internal.configs import load_config
from internal.errors import UserError
from internal.scene import identity
from internal.training import run_folder
from tests.conftest import TINY_MODEL, bindings

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def scene(night):
    return load_split(load_config([], bindings(night)), "train").identity


def begin(folder, scene, *own):
    """A run that has begun, as training leaves it, without the training."""
    config = load_config([], [*TINY_MODEL, f"Config.checkpoint_dir = {str(folder)!r}"])
    folder.mkdir()
    run_folder.open_run(config, scene)
    (folder / "checkpoints" / "3").mkdir(parents=True)
    return config


def test_the_run_alone_gives_its_configuration_back(tmp_path, scene):
    config = begin(tmp_path / "run", scene)
    named = f"Config.checkpoint_dir = {str(tmp_path / 'run')!r}"
    assert run_folder.config_of_run([], [named]) == config
    free = run_folder.config_of_run([], [named, "Render.frames = 9"])
    assert free.render.frames == 9 and free.model == config.model
    with pytest.raises(UserError, match=r"Config\.near was 0\.0, is 2\.0"):
        run_folder.config_of_run([], [named, "Config.near = 2.0"])
    with pytest.raises(UserError, match="--run"):
        run_folder.config_of_run([], [])


def test_a_training_without_gin_files_goes_on_with_its_own(tmp_path, scene, capsys):
    config = begin(tmp_path / "run", scene)
    named = f"Config.checkpoint_dir = {str(tmp_path / 'run')!r}"
    more = run_folder.config_to_train([], [named, "Train.max_steps = 8"])
    assert more.model == config.model and more.train.max_steps == 8
    assert "its own" in capsys.readouterr().out


def test_what_has_not_begun_does_not_block_its_folder(tmp_path, scene):
    begin(tmp_path / "run", scene)
    (tmp_path / "run" / "checkpoints" / "3").rmdir()
    (tmp_path / "run" / "config.json").write_text("{torn")
    named = f"Config.checkpoint_dir = {str(tmp_path / 'run')!r}"
    other = run_folder.config_to_train([], [*TINY_MODEL, named, "Losses.coarse = 0.7"])
    run_folder.open_run(other, scene)
    assert '"coarse": 0.7' in (tmp_path / "run" / "config.json").read_text()


def test_the_folder_names_what_it_was_trained_on(tmp_path, scene):
    begin(tmp_path / "run", scene)
    saved = json.loads((tmp_path / "run" / "scene.json").read_text())
    assert identity.changes(saved, scene) == []
    assert len(saved["views"]) == 6
    assert [v["split"] for v in saved["views"].values()].count("test") == 1


CHANGES = {
    "split": ("split", lambda v: "test", "1 of 6 views in the other split"),
    "pose": ("camtoworld", lambda v: [v[0] + 1e-3, *v[1:]], "another pose"),
    "lens": ("lens", lambda v: [*v[:-1], v[-1] + 0.1], "another lens"),
    "photo": ("digest", lambda v: "0" * 32, "another photo"),
    "gain": ("gain", lambda v: [1.1, 1.0, 1.0], "another exposure"),
}


@pytest.mark.parametrize("what", CHANGES)
def test_what_changed_of_the_scene_is_counted_and_refused(
    what, tmp_path, scene, capsys
):
    key, change, words = CHANGES[what]
    begin(tmp_path / "run", scene)
    other = copy.deepcopy(scene)
    name = list(other["views"])[2]
    other["views"][name][key] = change(other["views"][name][key])
    with pytest.raises(UserError, match=f"{words} .{name}"):
        run_folder.check_same_scene(tmp_path / "run", other)
    run_folder.check_same_scene(tmp_path / "run", other, scored=False)
    assert words in capsys.readouterr().out
    other["bounds"][0] *= 1.1
    with pytest.raises(UserError, match=words):
        run_folder.check_same_scene(tmp_path / "run", other, scored=False)


def test_views_that_come_and_go_and_a_frame_alone_are_named(scene):
    other = copy.deepcopy(scene)
    first = next(iter(other["views"]))
    other["views"]["new.png"] = other["views"].pop(first)
    assert identity.changes(scene, other) == [
        f"1 of 6 views gone ({first})",
        "1 of 6 views new (new.png)",
    ]
    other = copy.deepcopy(scene)
    other["bounds"][1] *= 2.0
    assert identity.changes(scene, other) == [identity.FRAME]


def test_the_last_digit_of_a_number_is_no_change(scene):
    other = copy.deepcopy(scene)
    for view in other["views"].values():
        view["camtoworld"] = [x * (1.0 + 1e-12) + 1e-15 for x in view["camtoworld"]]
    assert identity.changes(scene, other) == []


def test_a_torn_scene_file_is_one_line(tmp_path, scene):
    begin(tmp_path / "run", scene)
    (tmp_path / "run" / "scene.json").write_text('{"views": {}')
    with pytest.raises(UserError, match=r"scene\.json: cannot be read"):
        run_folder.check_same_scene(tmp_path / "run", scene)


HOLD = """
import sys, time
from internal.configs import load_config
from internal.training import run_folder
config = load_config([], [f"Config.checkpoint_dir = {sys.argv[1]!r}"])
with run_folder.claimed(config):
    print("held", flush=True)
    time.sleep(600)
"""


def test_a_second_training_is_refused_until_the_first_is_killed(tmp_path):
    config = configs.load_config([], [f"Config.checkpoint_dir = {str(tmp_path)!r}"])
    holds = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(holds, cwd=ROOT, stdout=subprocess.PIPE, text=True) as first:
        try:
            assert first.stdout and first.stdout.readline() == "held\n"
            with (
                pytest.raises(UserError, match="another training is running"),
                run_folder.claimed(config),
            ):
                pass
        finally:
            first.kill()
    with run_folder.claimed(config) as folder:
        assert folder == tmp_path
