# SPDX-License-Identifier: Apache-2.0
"""Bad input as a user meets it: one line, exit code 2, nothing half-written.

What a scene folder can have wrong is in test_scene.py and test_readers.py.
"""

import importlib.machinery
import importlib.util
import socket
import subprocess
import sys
from pathlib import Path

import pytest

import eval as eval_script
import export as export_script
import render as render_script
import train as train_script
import view as view_script
from internal import cli
from internal.configs import load_config
from internal.errors import Diverged, UserError
from internal.training import run_folder
from tests.conftest import flags

ROOT = Path(__file__).parents[1]


def bindings(*texts):
    return [f"--gin_bindings={text}" for text in texts]


def exit_code(main, argv, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["script", *argv])
    with pytest.raises(SystemExit) as stop:
        cli.run_script(main)
    return stop.value.code


def test_a_script_prints_one_line_and_exits_with_two():
    result = subprocess.run(
        [sys.executable, "train.py", *bindings("Config.data_dir = 'no/such/scene'")],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert result.returncode == 2
    assert result.stderr.startswith("error: no/such/scene")
    assert len(result.stderr.strip().splitlines()) == 1
    assert "Traceback" not in result.stderr
    assert result.stdout.startswith("devices: ")


@pytest.mark.parametrize(
    "script", [train_script, eval_script, render_script, view_script, export_script]
)
def test_an_unknown_gin_name_exits_with_two(script, monkeypatch, capsys):
    code = exit_code(script.main, bindings("Config.nonsense = 1"), monkeypatch)
    assert code == 2
    assert "nonsense" in capsys.readouterr().err


def test_no_data_dir_says_how_to_name_one():
    with pytest.raises(UserError, match=r"data_dir is empty.*--gin_bindings"):
        train_script.main([])


@pytest.mark.parametrize("script", [eval_script, render_script, export_script])
def test_no_checkpoint_says_so(script, tmp_path):
    with pytest.raises(UserError, match="holds no checkpoint"):
        script.main(bindings(f"Config.checkpoint_dir = {str(tmp_path)!r}"))
    assert not list(tmp_path.iterdir())


def test_no_checkpoint_dir_says_how_to_name_one():
    with pytest.raises(UserError, match="checkpoint_dir is empty"):
        run_folder.open_run(load_config([], []))


def test_an_unwritable_checkpoint_dir_is_named(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    config = load_config([], [f"Config.checkpoint_dir = {str(blocked / 'run')!r}"])
    with pytest.raises(UserError, match="file/run: cannot be made"):
        run_folder.open_run(config)


def test_a_full_disk_is_one_line_and_leaves_no_part(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(UserError, match="No space left"):
        run_folder.write_text(tmp_path / "config.json", "{}")
    assert not list(tmp_path.iterdir())


def test_divergence_exits_with_one_and_an_interrupt_with_130(monkeypatch, capsys):
    def diverge(argv):
        raise Diverged("step 7: not finite: loss data")

    def interrupt(argv):
        raise KeyboardInterrupt

    assert exit_code(diverge, [], monkeypatch) == 1
    assert "step 7" in capsys.readouterr().err
    assert exit_code(interrupt, [], monkeypatch) == 130


def test_a_light_edit_out_of_range_is_refused(monkeypatch, capsys):
    argv = bindings("Render.temperature = 10.0")
    assert exit_code(render_script.main, argv, monkeypatch) == 2
    assert "temperature" in capsys.readouterr().err


def test_a_taken_port_is_one_line(monkeypatch, capsys):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = str(other.getsockname()[1])
        code = exit_code(view_script.main, ["--port", port], monkeypatch)
    assert_one_line(code, f"127.0.0.1:{port}: cannot listen", capsys)


@pytest.mark.parametrize(
    "own, words",
    [
        (["Config.checkpoint_dir = 'no/run'"], "no/run: holds no checkpoint"),
        (["MLP.width = 24"], "holds a model of another shape"),
        (["Config.data_dir = 'no/scene'"], "no/scene"),
    ],
)
def test_the_viewer_says_what_it_cannot_show(
    own, words, night, night_run, monkeypatch, capsys
):
    argv = [*flags(night, night_run, *own), "--port", "0"]
    assert_one_line(exit_code(view_script.main, argv, monkeypatch), words, capsys)


def test_the_viewer_names_a_missing_gin_file(monkeypatch, capsys):
    code = exit_code(view_script.main, ["--gin_configs=no/file.gin"], monkeypatch)
    assert_one_line(code, "no/file.gin", capsys)


def assert_one_line(code, words, capsys):
    (line,) = capsys.readouterr().err.splitlines()
    assert code == 2
    assert line.startswith("error: ") and words in line


@pytest.mark.parametrize(
    "script, extra", [(view_script, "viser"), (export_script, "trimesh")]
)
def test_a_missing_extra_says_what_to_install(script, extra, monkeypatch, capsys):
    def none_of_it(name, *_):
        return None if name == extra else importlib.machinery.ModuleSpec(name, None)

    monkeypatch.setattr(importlib.util, "find_spec", none_of_it)
    code = exit_code(script.main, [], monkeypatch)
    assert_one_line(code, "run pip install -e '.[", capsys)
