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
    assert [name for name in kept if name.isdigit()] == ["2", "3"]


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


def test_a_checkpoint_with_a_torn_description_is_one_line(state, tmp_path):
    with Checkpoints(tmp_path, kept=1) as checkpoints:
        checkpoints.save(at_step(state, 1))
    (described,) = (tmp_path / "checkpoints" / "1" / "default").glob("_METADATA")
    described.write_bytes(described.read_bytes()[:100])
    with (
        Checkpoints(tmp_path, kept=1) as checkpoints,
        pytest.raises(UserError, match="step 1 is damaged") as error,
    ):
        checkpoints.restore(jax.eval_shape(lambda: state), parallel.data_mesh(4))
    assert "\n" not in str(error.value)
