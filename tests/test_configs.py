# SPDX-License-Identifier: Apache-2.0
"""Configuration: every file loads, every field is used, every mistake is named."""

import dataclasses
import json
from pathlib import Path

import pytest

from internal import configs, saved_config
from internal.configs import Config, load_config
from internal.errors import UserError

ROOT = Path(__file__).parents[1]
FILES = sorted(ROOT.glob("configs/**/*.gin"))


@pytest.fixture(autouse=True)
def at_the_root(monkeypatch):
    monkeypatch.chdir(ROOT)


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_every_file_loads_and_says_what_it_is(file):
    load_config([str(file)], [])
    assert file.read_text().startswith("# ")


def test_the_papers_file_holds_the_defaults():
    in_one_pass = ["Train.passes = 1"]  # parts change nothing but the memory
    assert load_config(["configs/llnerf.gin"], in_one_pass) == load_config([], [])


def test_later_bindings_win_and_do_not_leak_into_the_next_load():
    changed = load_config(["configs/llnerf_small.gin"], ["MLP.width = 7"])
    assert changed.model.field.width == 7
    assert load_config([], []).model.field.width == 256


@pytest.mark.parametrize(
    ("binding", "named"),
    [
        ("Model.widht = 64", "widht"),
        ("Modle.width = 64", "Modle"),
        ("MLP.width = 'wide'", "width"),
        ("Model.num_samples = [1, 2]", "num_samples"),
        ("MLP.width = ", "parse"),
        ("Model.ray_shape = 'square'", "ray_shape"),
        ("Losses.observation = 'lucky'", "observation"),
        ("Config.factor = 0", "factor"),
        ("Train.log_every = 0", "log_every"),
        ("Train.checkpoints_kept = 0", "checkpoints_kept"),
        ("Optimizer.lr_init = 0.0", "lr_init"),
        ("Render.chunk = 0", "chunk"),
        ("Model.head_width = 0", "head_width"),
        ("MLP.width = 0", "field"),
        ("Train.passes = 2\nModel.enhancement = @Tone()", "passes"),
    ],
)
def test_a_wrong_binding_is_one_line_that_names_it(binding, named):
    with pytest.raises(UserError, match=named) as error:
        load_config([], [binding])
    assert "\n" not in str(error.value)


def test_a_missing_file_is_named():
    with pytest.raises(UserError, match="configs/no_such"):
        load_config(["configs/no_such.gin"], [])


def test_every_field_is_read_somewhere():
    files = [*ROOT.glob("*.py"), *ROOT.glob("internal/**/*.py")]
    code = "\n".join(file.read_text() for file in files)
    sections = [
        configs.ModelConfig,
        configs.LossConfig,
        configs.OptimizerConfig,
        configs.TrainConfig,
        configs.RenderConfig,
        Config,
    ]
    for section in sections:
        for field in dataclasses.fields(section):
            assert f".{field.name}" in code, f"{section.__name__}: {field.name}"


def test_json_holds_every_section():
    saved = json.loads(saved_config.to_json(load_config([], [])))
    assert saved["model"]["enhancement"]["gamma0"] == 2.2
    assert {"losses", "optimizer", "train", "render"} <= saved.keys()


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_a_saved_configuration_comes_back(file, tmp_path):
    own = "Config.data_dir = 'it\\'s [a] \"scene\" \\\\ é\\n'"
    config = load_config([str(file)], [own])
    (tmp_path / "config.json").write_text(saved_config.to_json(config))
    assert saved_config.read(tmp_path / "config.json") == config
    assert load_config([], [], saved_config.as_bindings(config)) == config


def test_what_differs_has_the_name_that_gin_knows():
    old = load_config([], [])
    new = load_config([], ["Model.field = @HashGrid()", "Losses.coarse = 0.5"])
    found = saved_config.differences(old, new)
    assert found["Losses.coarse"] == "was 0.1, is 0.5"
    assert found["Model.field"] == "was @MLP(), is @HashGrid()"
    assert found["MLP.width"] == "was 256, is not there"
    assert saved_config.differences(old, old) == {}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: s[: len(s) // 2], "cannot be read .it is cut short"),
        (lambda s: "[]", "another version"),
        (lambda s: s.replace('"seed"', '"sead"'), r"another version .*Train\.sea?e?d"),
        (lambda s: s.replace('"@": "MLP"', '"@": "Net"'), "another version .*Net"),
        (lambda s: s.replace('"@": "MLP",', ""), "another version .*no @"),
        (lambda s: s.replace('"depth": 8', '"depth": "8"'), "another version .*depth"),
    ],
)
def test_a_torn_or_old_configuration_is_one_line(change, message, tmp_path):
    path = tmp_path / "config.json"
    path.write_text(change(saved_config.to_json(load_config([], []))))
    with pytest.raises(UserError, match=message) as error:
        saved_config.read(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


def test_an_enhancement_that_never_starts_is_an_error():
    best = ["configs/llnerf_best.gin"]
    with pytest.raises(UserError, match=r"enhance_start = 9500 .*max_steps = 1500"):
        load_config(best, ["Train.max_steps = 1500"])
    load_config(["configs/nerf_fast.gin"], ["Train.max_steps = 1500"])
