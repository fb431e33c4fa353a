# SPDX-License-Identifier: Apache-2.0
"""The wall-clock budget: the schedule stretches whole, and stays what it was."""

import dataclasses

import pytest

from internal.configs import load_config
from internal.errors import UserError
from internal.training import budget
from internal.training.budget import StepTimes
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


def test_a_run_that_goes_on_keeps_its_schedule():
    config = load_config([], [*TINY_MODEL, "Config.max_minutes = 1.0"])
    fitted = budget.stretch(config, 60.0, TIMES)
    assert fitted.train.max_steps != config.train.max_steps
    assert budget.fit_schedule(config, fitted, [], pytest.fail) == fitted


@pytest.fixture
def begun():
    """A run of 10 minutes, and what it logged: 0.1 s per step so far."""
    config = load_config(["configs/llnerf_best.gin"], ["Config.max_minutes = 10.0"])
    fitted = budget.stretch(config, 600.0, TIMES)
    log = [{"step": fitted.train.max_steps, "seconds": 0.1 * fitted.train.max_steps}]
    return config, fitted, log


def test_a_run_with_more_minutes_goes_on_for_as_long(begun):
    config, fitted, log = begun
    longer = dataclasses.replace(config, max_minutes=20.0)
    again = budget.fit_schedule(longer, fitted, log, pytest.fail)
    assert again.train.max_steps == pytest.approx(0.97 * 1200.0 / 0.1, rel=0.02)
    assert again.train.enhance_start == fitted.train.enhance_start


def test_a_run_without_its_minutes_goes_on_to_the_steps(begun, capsys):
    config, fitted, log = begun
    by_steps = dataclasses.replace(config, max_minutes=0.0)
    again = budget.fit_schedule(by_steps, fitted, log, pytest.fail)
    assert again.train.max_steps == config.train.max_steps == 10_000
    assert again.optimizer == fitted.optimizer
    assert "goes on to step 10000" in capsys.readouterr().out


def test_without_a_budget_nothing_changes():
    config = load_config([], TINY_MODEL)
    assert budget.fit_schedule(config, None, [], pytest.fail) is config
    assert budget.fit_schedule(config, config, [], pytest.fail) is config
