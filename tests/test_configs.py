# SPDX-License-Identifier: Apache-2.0
"""Configuration: every file loads, every field is used, every mistake is named."""

import ast
import dataclasses
import json
import re
from pathlib import Path

import pytest

from internal import configs, saved_config
from internal.configs import Config, load_config
from internal.enhancements.gamma import Gamma
from internal.enhancements.tone import Tone
from internal.errors import UserError
from internal.fields.hash_grid import HashGrid
from internal.fields.mlp import MLP

ROOT = Path(__file__).parents[1]
FILES = sorted(ROOT.glob("configs/**/*.gin"))
UNDER = {"small_size": ["configs/nerf.gin"]}  # of files that go on top of another


@pytest.fixture(autouse=True)
def at_the_root(monkeypatch):
    monkeypatch.chdir(ROOT)


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_every_file_loads_and_says_what_it_is(file):
    load_config([*UNDER.get(file.stem, []), str(file)], [])
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
        ("Render.sample_shares = (0.5,)", "sample_shares"),
        ("Render.sample_shares = (0.0, 1.0)", "sample_shares"),
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


SECTIONS = {
    "Model": configs.ModelConfig,
    "Losses": configs.LossConfig,
    "Optimizer": configs.OptimizerConfig,
    "Train": configs.TrainConfig,
    "Render": configs.RenderConfig,
    "Config": Config,
    "Gamma": Gamma,
    "Tone": Tone,
    "HashGrid": HashGrid,
    "MLP": MLP,
}
FIELDS = [
    (section, field.name)
    for section, config in SECTIONS.items()
    for field in dataclasses.fields(config)
]


READ_AS = {  # what a section is called where it is read; the others read themselves
    "Model": ("model", "config"),
    "Losses": ("losses", "config"),
    "Optimizer": ("optimizer",),
    "Train": ("train",),
    "Render": ("render", "self"),
    "Config": ("config",),
}
HOMES = {
    "Gamma": "enhancements/gamma.py",
    "Tone": "enhancements/tone.py",
    "HashGrid": "fields/hash_grid.py",
    "MLP": "fields/mlp.py",
}


def test_every_setting_is_read():
    """As an attribute of what is called like its section; one of a field or of an
    enhancement in its own module."""
    reads = set()
    for file in [*ROOT.glob("*.py"), *ROOT.glob("internal/**/*.py")]:
        name = file.relative_to(ROOT).as_posix().removeprefix("internal/")
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
                owner = getattr(node.value, "id", getattr(node.value, "attr", ""))
                reads |= {(owner, node.attr), (name, owner, node.attr)}
    unread = [
        (section, name)
        for section, name in FIELDS
        if not any(
            (HOMES[section], owner, name) in reads
            if section in HOMES
            else (owner, name) in reads
            for owner in READ_AS.get(section, ("self", "config"))
        )
    ]
    assert unread == []


def test_every_setting_is_changed_by_a_configuration_or_a_test():
    files = [*ROOT.glob("configs/**/*.gin"), *ROOT.glob("tests/*.py")]
    text = "\n".join(file.read_text() for file in files)
    sections = {"model", "losses", "optimizer", "train", "render"}
    unchanged = [
        (section, name)
        for section, name in FIELDS
        if name not in sections and not re.search(rf"\b{name} ?=[^=]", text)
    ]
    assert unchanged == []


def test_json_holds_every_section():
    saved = json.loads(saved_config.to_json(load_config([], [])))
    assert saved["model"]["enhancement"]["gamma0"] == 2.2
    assert {"losses", "optimizer", "train", "render"} <= saved.keys()


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_a_saved_configuration_comes_back(file, tmp_path):
    own = "Config.data_dir = 'it\\'s [a] \"scene\" \\\\ é\\n'"
    config = load_config([*UNDER.get(file.stem, []), str(file)], [own])
    (tmp_path / "config.json").write_text(saved_config.to_json(config))
    assert saved_config.read(tmp_path / "config.json") == config
    assert load_config([], [], saved_config.as_bindings(config)) == config


def test_what_differs_has_the_name_that_gin_knows():
    old = load_config([], [])
    new = load_config([], ["Model.field = @HashGrid()", "Losses.distortion = 0.5"])
    found = saved_config.differences(old, new)
    assert found["Losses.distortion"] == "was 0.01, is 0.5"
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


TONE = ["configs/llnerf_best.gin"]
NO_GRAY = ["configs/ablations/no_gray.gin"]


@pytest.mark.parametrize(
    ("files", "bindings", "name", "reader"),
    [
        (
            [],
            ["Model.enhancement = @Tone()", "Gamma.gray = 0.2"],
            "Gamma.gray",
            "@Gamma",
        ),
        ([], ["Tone.stops = 2.0"], "Tone.stops", "Model.enhancement = @Tone()"),
        ([], ["HashGrid.levels = 4"], "HashGrid.levels", "Model.field = @HashGrid()"),
        ([], ["a/MLP.width = 4"], "a/MLP.width", "Model.field = @a/MLP()"),
        ([], ["max_steps = 20"], "max_steps", "nothing says %max_steps"),
        ([*TONE, *NO_GRAY], [], "no_gray.gin: Gamma.gray", "@Gamma()"),
        ([*NO_GRAY, *TONE], [], "no_gray.gin: Gamma.gray", "@Gamma()"),
        (NO_GRAY, ["Model.enhancement = @Tone()"], "no_gray.gin: Gamma.gray", "@Gamma"),
        (TONE, ["Losses.coarse = 0.2"], "Losses.coarse", "a coarse level"),
        ([], ["Losses.interlevel = 0.2"], "Losses.interlevel", "proposals"),
        (
            [],
            ["Model.num_samples = (8,)", "Model.resample_padding = 0.1"],
            "Model.resample_padding",
            "two levels",
        ),
        (
            [],
            ["Config.projection = 'contract'", "Config.end_at_far = True"],
            "Config.end_at_far",
            "Config.projection",
        ),
        *(
            (["configs/nerf.gin"], [f"{name} = 1"], name, "a Model.enhancement")
            for name in (
                *("Train.enhance_start", "Optimizer.enhancement_lr_init"),
                *("Render.exposure", "Render.strength"),
            )
        ),
    ],
)
def test_a_setting_that_nothing_reads_is_one_line_with_who_would(
    files, bindings, name, reader
):
    with pytest.raises(UserError) as error:
        load_config(files, bindings)
    assert f"{name} has no effect: " in str(error.value) and reader in str(error.value)
    assert "\n" not in str(error.value)


def test_what_an_included_file_or_a_runs_own_configuration_holds_is_exempt(tmp_path):
    included = tmp_path / "mine.gin"
    included.write_text(
        "include 'configs/llnerf_small.gin'\nModel.enhancement = None\n"
    )
    load_config([str(included)], [])
    base = saved_config.as_bindings(load_config(["configs/nerf.gin"], []))
    load_config([], ["Train.seed = 3"], base)
    with pytest.raises(UserError, match=r"Gamma\.gray has no effect"):
        load_config([], ["Gamma.gray = 0.2"], base)
    included.write_text("include 'configs/llnerf_best.gin'\nGamma.gray = 0.2\n")
    with pytest.raises(UserError, match=r"mine\.gin: Gamma\.gray has no effect"):
        load_config([str(included)], [])


@pytest.mark.parametrize(
    ("files", "bindings"),
    [
        (["configs/llnerf_fast.gin"], ["Model.enhancement = @Tone()"]),
        (["configs/llnerf_best.gin"], ["Model.enhancement = None"]),
        (["configs/llnerf.gin"], ["Model.field = @HashGrid()", "Train.passes = 1"]),
        (["configs/nerf.gin", "configs/small_size.gin"], []),
        ([], ["wide = 512", "MLP.width = %wide"]),
        (
            [],
            [
                "internal.fields.mlp.MLP.width = 512",
                "a/MLP.depth = 2\nModel.field = @a/MLP()",
            ],
        ),
    ],
)
def test_what_comes_later_may_choose_another_field_or_enhancement(files, bindings):
    load_config(files, bindings)


def test_bindings_for_several_configurations_are_kept_where_they_are_read():
    every = ["Config.factor = 2", "HashGrid.finest = 32", "Train.enhance_start = 12"]
    assert configs.with_effect(["configs/nerf_fast.gin"], every) == every[:2]
    assert configs.with_effect([], every) == [every[0], every[2]]
