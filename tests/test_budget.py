# SPDX-License-Identifier: Apache-2.0
"""The wall-clock budget: the schedule stretches whole, and stays what it was."""

import pytest

from internal.configs import load_config
from internal.errors import UserError
from internal.training import budget
from internal.training.budget import StepTimes
from internal.training.run_folder import open_run
from tests.conftest import TINY_MODEL

TIMES = StepTimes(field=0.1, enhanced=0.3, compilation=5.0)


def test_the_schedule_is_stretched_in_its_proportions():
    config = load_config(["configs/llnerf.gin"], ["Config.max_minutes = 10.0"])
    fitted = budget.stretch(config, 600.0, TIMES)
    seconds = TIMES.compilation + sum(
        TIMES.field if step < fitted.train.enhance_start else TIMES.enhanced
        for step in range(fitted.train.max_steps)
    )
    assert 0.95 * 600.0 < seconds <= 600.0
    for name in ("enhance_start", "checkpoint_every"):
        before = getattr(config.train, name) / config.train.max_steps
        after = getattr(fitted.train, name) / fitted.train.max_steps
        assert after == pytest.approx(before, rel=0.02)
    assert fitted.train.batch_size == config.train.batch_size


def test_no_time_for_a_step_is_said():
    config = load_config([], ["Config.max_minutes = 0.05"])
    with pytest.raises(UserError, match=r"max_minutes = 0\.05: not a single step"):
        budget.stretch(config, 3.0, TIMES)


def test_a_run_that_goes_on_keeps_its_schedule(tmp_path):
    bindings = [
        *TINY_MODEL,
        "Config.max_minutes = 1.0",
        f"Config.checkpoint_dir = '{tmp_path / 'run'}'",
    ]
    config = load_config([], bindings)
    fitted = budget.stretch(config, 60.0, TIMES)
    assert fitted.train.max_steps != config.train.max_steps
    open_run(fitted)
    again = budget.fit(config, pytest.fail)
    assert again == fitted
    open_run(again)


def test_without_a_budget_nothing_changes():
    config = load_config([], TINY_MODEL)
    assert budget.fit(config, pytest.fail) is config
