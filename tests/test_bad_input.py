# SPDX-License-Identifier: Apache-2.0
"""Bad input as a user meets it: one line, exit code 2, nothing half-written.

What a scene folder can have wrong is in test_scene.py and test_readers.py.
"""

import importlib.machinery
import importlib.util
import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import jax
import pytest

import eval as eval_script
import export as export_script
import render as render_script
import train as train_script
import view as view_script
from internal import flags as flags_of
from internal import parallel, script
from internal.configs import load_config
from internal.errors import Diverged, UserError
from internal.files import atomic
from internal.training import run_folder
from tests.conftest import flags

ROOT = Path(__file__).parents[1]


def bindings(*texts):
    return [f"--gin_bindings={text}" for text in texts]


def exit_code(main, argv, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["script", *argv])
    with pytest.raises(SystemExit) as stop:
        script.run(main)
    return stop.value.code


def test_a_script_prints_one_line_and_exits_with_two():
    result = subprocess.run(
        [sys.executable, "train.py", "--scene=configs"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert result.returncode == 2
    assert result.stderr.startswith("error: configs: no scene found")
    assert len(result.stderr.strip().splitlines()) == 1
    assert "Traceback" not in result.stderr
    assert result.stdout.startswith("devices: ")


def test_letters_that_the_output_cannot_take_are_escaped(monkeypatch, capsys):
    def main(_):
        print("photo caf\udce9.jpg")
        raise UserError("error")

    assert exit_code(main, [], monkeypatch) == 2
    assert capsys.readouterr().out == "photo caf\\udce9.jpg\n"


def test_a_name_that_no_disk_takes_is_one_line(monkeypatch, capsys):
    long = "x" * 300
    code = exit_code(lambda _: (Path(long) / "y").is_file(), [], monkeypatch)
    assert code == 2
    assert (
        f"{long}/y: File name too long; give a shorter path" in capsys.readouterr().err
    )
    with pytest.raises(UserError, match="scene folder not found"):
        flags_of.check_folder(Path(long))


@pytest.mark.parametrize(
    "program", [train_script, eval_script, render_script, view_script, export_script]
)
def test_an_unknown_gin_name_exits_with_two(program, monkeypatch, capsys):
    code = exit_code(program.main, bindings("Config.nonsense = 1"), monkeypatch)
    assert code == 2
    assert "nonsense" in capsys.readouterr().err


def test_no_data_dir_says_how_to_name_one():
    with pytest.raises(UserError, match=r"no scene is named; .*--scene"):
        train_script.main([])


@pytest.mark.parametrize("program", [eval_script, render_script, export_script])
def test_no_checkpoint_says_so(program, tmp_path):
    with pytest.raises(UserError, match="holds no checkpoint"):
        program.main(bindings(f"Config.checkpoint_dir = {str(tmp_path)!r}"))
    assert not list(tmp_path.iterdir())


def test_no_run_folder_says_how_to_name_one():
    with (
        pytest.raises(UserError, match="--run outputs"),
        run_folder.claimed(load_config([], [])),
    ):
        pass


def test_an_unwritable_checkpoint_dir_is_named(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    config = load_config([], [f"Config.checkpoint_dir = {str(blocked / 'run')!r}"])
    with (
        pytest.raises(UserError, match="file/run: cannot be made"),
        run_folder.claimed(config),
    ):
        pass


def test_a_full_disk_is_one_line_and_leaves_no_part(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(UserError, match="No space left"):
        atomic.write_text(tmp_path / "config.json", "{}")
    assert not list(tmp_path.iterdir())


def test_divergence_exits_with_one_and_an_interrupt_with_130(monkeypatch, capsys):
    def diverge(argv):
        raise Diverged("step 7: not finite: loss data")

    def interrupt(argv):
        raise KeyboardInterrupt

    assert exit_code(diverge, [], monkeypatch) == 1
    assert "step 7" in capsys.readouterr().err
    assert exit_code(interrupt, [], monkeypatch) == 130


XLA = jax.errors.JaxRuntimeError("RESOURCE_EXHAUSTED: Out of memory\nallocating 9")


@pytest.mark.parametrize("error", [MemoryError(), MemoryError("of NumPy"), XLA])
def test_too_little_memory_is_one_line_that_says_what_to_lower(
    error, monkeypatch, capsys
):
    def run_out(argv):
        raise error

    code = exit_code(run_out, [], monkeypatch)
    assert_one_line(code, "lower Train.batch_size to train, Render.chunk", capsys)


def test_an_error_of_ours_is_not_called_memory(monkeypatch):
    def fail(argv):
        raise RuntimeError("INTERNAL: a bug")

    monkeypatch.setattr(sys, "argv", ["script"])
    with pytest.raises(RuntimeError, match="a bug"):
        script.run(fail)


def test_a_light_edit_out_of_range_is_refused(night_run, monkeypatch, capsys):
    argv = [f"--run={night_run}", *bindings("Render.temperature = 10.0")]
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
        (["MLP.width = 24"], "MLP.width was 16, is 24"),
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
    "program, extra", [(view_script, "viser"), (export_script, "trimesh")]
)
def test_a_missing_extra_says_what_to_install(program, extra, monkeypatch, capsys):
    def none_of_it(name, *_):
        return None if name == extra else importlib.machinery.ModuleSpec(name, None)

    monkeypatch.setattr(importlib.util, "find_spec", none_of_it)
    code = exit_code(program.main, [], monkeypatch)
    assert_one_line(code, "run pip install -e '.[", capsys)


USES_A_RUN = "eval render view export".split()
TAKES_A_SCENE = ["train", "sweep", *USES_A_RUN]
NAMES = [*TAKES_A_SCENE, *"compare figures demo study prepare make_scene".split()]


@pytest.mark.parametrize(
    ("argv", "names", "answer"),
    [
        (["--help"], NAMES, ""),
        (["--no-such-flag"], NAMES, "error: "),
        (["--gin_configs=no/file.gin"], TAKES_A_SCENE, "no/file.gin: no such gin file"),
        (["--scene=no/scene"], TAKES_A_SCENE, "no/scene: scene folder not found"),
        (["--run=no/run"], USES_A_RUN, "no/run: holds no checkpoint"),
    ],
)
def test_what_flags_alone_show_is_answered_before_anything_large_is_imported(
    argv, names, answer
):
    """Each script in turn in one process, as ``__main__``."""
    code = f"""
import contextlib, io, runpy, sys
for name in {names!r}:
    sys.argv = [name + ".py", *{argv!r}]
    with contextlib.redirect_stderr(io.StringIO()) as errors:
        try:
            runpy.run_path(name + ".py", run_name="__main__")
        except SystemExit as stop:
            assert stop.code == {2 if answer else 0}, (name, stop.code)
    assert {answer!r} in errors.getvalue(), (name, errors.getvalue())
    large = {{"jax", "flax", "pycolmap", "numpy", "gin"}} & sys.modules.keys()
    assert not large, (name, large)
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_a_study_needs_no_jax():
    code = """
import sys, study
assert not {"jax", "flax", "pycolmap"} & sys.modules.keys()
"""
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT).returncode == 0


@pytest.mark.parametrize(
    ("wanted", "message"),
    [(("", 2, 2), "process_id 2 of"), (("", 1, -1), "-1"), (("", 2, 1), "coordinator")],
)
def test_processes_that_cannot_be_are_refused(wanted, message):
    with pytest.raises(UserError, match=message):
        parallel.initialize(*wanted)


@pytest.mark.parametrize("error", [AssertionError(), RuntimeError("no\ncuda")])
def test_a_platform_that_is_not_there_is_one_line(error, monkeypatch):
    def none_of_it():
        raise error

    monkeypatch.setenv("JAX_PLATFORMS", "cuda")
    monkeypatch.setattr(parallel.jax, "devices", none_of_it)
    with pytest.raises(UserError, match="JAX_PLATFORMS=cuda") as raised:
        parallel.describe_devices()
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("points", ["0", "-3", "many"])
def test_an_export_of_no_points_is_refused(points):
    with pytest.raises(SystemExit) as stop:
        flags_of.export("").parse_args(["--run=x", "--points", points])
    assert stop.value.code == 2


def test_a_printed_command_survives_the_shell(tmp_path):
    folder = tmp_path / 'ann\'s $HOME; [x] "y" *'
    line = script.command_line("eval.py", "--run", folder)
    shown = subprocess.run(
        ["sh", "-c", line.replace("python eval.py", "printf %s\\\\n", 1)],
        capture_output=True, text=True,
    )  # fmt: skip
    assert shown.stdout.splitlines() == ["--run", str(folder)]


def test_short_forms_are_bindings_and_the_last_one_holds(tmp_path):
    folder = tmp_path / "it's [a] scene"
    argv = ["--gin_bindings=Config.data_dir = 'x'", f"--scene={folder}", "--run=r"]
    parsed = flags_of.train("").parse_args(argv)
    config = load_config(parsed.gin_configs, parsed.gin_bindings)
    assert (config.data_dir, config.checkpoint_dir) == (str(folder), "r")


@pytest.mark.parametrize("text", ['{"scenes": {"night"', ""])
def test_a_file_of_results_that_was_cut_short_is_one_line(text, tmp_path):
    path = tmp_path / "results.json"
    with pytest.raises(UserError, match=r"results\.json: not found; .*compare"):
        atomic.read_json(path, "compare.py")
    path.write_text(text)
    with pytest.raises(UserError, match=r"results\.json: is cut short"):
        atomic.read_json(path, "compare.py")


@pytest.mark.parametrize("flag", ["--scene", "--run"])
def test_folders_whose_names_are_no_text_are_refused(flag, tmp_path):
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9"))
    folder.mkdir()
    result = subprocess.run(
        [sys.executable, ROOT / "train.py", flag, folder],
        capture_output=True,
        text=True,
    )
    assert result.returncode == 2
    assert "caf\\udce9: its name or a folder's is not UTF-8; rename it" in result.stderr
    assert len(result.stderr.splitlines()) == 1
    shutil.rmtree(folder)


def test_who_stops_reading_the_output_gets_no_traceback():
    lines = "lambda _: [print('x' * 80) for _ in range(9999)] and 0"
    code = f"from internal import script; script.run({lines})"
    shell = f'"{sys.executable}" -c "{code}" | head -1; echo "${{PIPESTATUS[0]}}"'
    result = subprocess.run(
        ["bash", "-c", shell], cwd=ROOT, capture_output=True, text=True
    )
    assert result.stdout.splitlines() == ["x" * 80, "141"]
    assert result.stderr == ""


def test_an_interrupt_during_imports_has_no_traceback(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["prepare.py", "photos", "scene"])
    monkeypatch.setattr(sys, "excepthook", sys.__excepthook__)
    script.begin(flags_of.prepare("Doc."), computes=False)
    sys.excepthook(KeyboardInterrupt, KeyboardInterrupt(), None)
    assert capsys.readouterr().err == "interrupted\n"
    sys.excepthook(ZeroDivisionError, ZeroDivisionError("by 0"), None)
    assert "ZeroDivisionError: by 0" in capsys.readouterr().err


def test_a_closed_output_changes_no_exit_code(monkeypatch):
    monkeypatch.setattr(sys, "stdout", None)
    assert exit_code(lambda _: 0, [], monkeypatch) == 0
