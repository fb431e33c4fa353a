# SPDX-License-Identifier: Apache-2.0
"""Checkpoints: round trip, the last few, failures in one line."""

import chex
import jax
import pytest

from internal import parallel
from internal.errors import UserError
from internal.models import Model
from internal.training.checkpoints import Checkpoints
from internal.training.step import initial_state


@pytest.fixture(scope="module")
def state(tiny_config):
    return initial_state(tiny_config, Model(tiny_config.model))


def at_step(state, step):
    return state.replace(step=state.step + step)


def test_what_is_restored_is_what_was_saved_and_old_ones_go(state, tmp_path):
    mesh = parallel.data_mesh(4)
    with Checkpoints(tmp_path, kept=2) as checkpoints:
        assert checkpoints.latest_step() is None
        for step in (1, 2, 3):
            checkpoints.save(at_step(state, step))
        checkpoints.save(at_step(state, 3))
        restored = checkpoints.restore(jax.eval_shape(lambda: state), mesh)
    chex.assert_trees_all_equal(restored, at_step(state, 3))
    kept = sorted(p.name for p in (tmp_path / "checkpoints").iterdir())
    assert kept == ["2", "2.json", "3", "3.json"]


def test_a_full_disk_names_the_step_and_keeps_what_was_saved(
    state, tmp_path, monkeypatch
):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    with Checkpoints(tmp_path, kept=2) as checkpoints:
        checkpoints.save(at_step(state, 1))
        with monkeypatch.context() as patch:
            patch.setattr(checkpoints._manager, "save", full)
            with pytest.raises(UserError, match=r"step 2 could not be saved .*space"):
                checkpoints.save(at_step(state, 2))
        assert checkpoints.latest_step() == 1


def test_an_unwritable_folder_is_one_line(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(UserError, match="cannot be written"):
        Checkpoints(tmp_path / "file", kept=1)


NAMES = ["a b", "[2024] runs", 'it\'s "x"', "é日本", "*?", "{a,b}", "$HOME", "n" * 200]


def test_every_name_that_the_file_system_takes_works(state, tmp_path):
    folder = tmp_path.joinpath(*NAMES)
    mesh = parallel.data_mesh(4)
    with Checkpoints(folder, kept=1) as checkpoints:
        checkpoints.save(at_step(state, 1))
    with Checkpoints(folder, kept=1) as checkpoints:
        restored = checkpoints.restore(jax.eval_shape(lambda: state), mesh)
    chex.assert_trees_all_equal(restored, at_step(state, 1))


def test_what_is_not_read_back_as_it_was_is_not_called_saved(
    state, tmp_path, monkeypatch
):
    with Checkpoints(tmp_path, kept=1) as checkpoints:
        checkpoints.save(at_step(state, 1))
        with monkeypatch.context() as patch:
            patch.setattr(checkpoints, "_read", lambda *_: at_step(state, 7))
            with pytest.raises(UserError, match="step 2 is not read back"):
                checkpoints.save(at_step(state, 2))
        assert checkpoints.latest_step() == 1


def cut(path):
    path.write_bytes(path.read_bytes()[:100])


def flip_a_bit(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize(
    "pattern, change",
    [
        ("default/_METADATA", cut),
        ("default/params*kernel/0*", flip_a_bit),
        ("default/params*kernel/0*", lambda path: path.unlink()),
        ("../1.json", cut),
    ],
)
def test_a_damaged_checkpoint_is_one_line(pattern, change, state, tmp_path, capfd):
    with Checkpoints(tmp_path, kept=1) as checkpoints:
        checkpoints.save(at_step(state, 1))
    change(sorted((tmp_path / "checkpoints" / "1").glob(pattern))[0])
    with (
        Checkpoints(tmp_path, kept=1) as checkpoints,
        pytest.raises(UserError, match=r"step 1 is damaged|1\.json: is cut") as error,
    ):
        checkpoints.restore(jax.eval_shape(lambda: state), parallel.data_mesh(4))
    assert "\n" not in str(error.value)
    assert "Traceback" not in capfd.readouterr().err
