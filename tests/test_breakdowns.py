# SPDX-License-Identifier: Apache-2.0
"""Small cases of ``benchmarks/kills.py`` and ``benchmarks/shortages.py``."""

import multiprocessing
import os
import signal

import pytest

from benchmarks import trials
from internal.errors import UserError
from internal.files import made_folder
from internal.files.atomic import PARTIAL


def fill(folder):
    (folder / "whole").write_text("content")
    return {"files": 1.0}


def fill_and_die(folder):
    (folder / "half").write_text("con")
    os.kill(os.getpid(), signal.SIGKILL)


def made(folder, filled):
    made_folder.make_folder(folder, {"a": 1}, filled, overwrite=False)


def test_a_folder_whose_maker_was_killed_is_made_whole_and_leaves_no_part(tmp_path):
    context = multiprocessing.get_context("fork")
    killed = context.Process(target=made, args=(tmp_path / "export", fill_and_die))
    killed.start()
    killed.join()
    assert killed.exitcode == -signal.SIGKILL
    assert [path.name for path in tmp_path.iterdir()] == [f"{PARTIAL}export"]
    made(tmp_path / "export", fill)
    assert [path.name for path in tmp_path.iterdir()] == ["export"]
    files = {path.name for path in (tmp_path / "export").iterdir()}
    assert files == {"whole", made_folder.RECORD}


def test_the_second_of_two_that_fill_a_folder_is_refused_and_harms_nothing(tmp_path):
    def fill_while_another_starts(folder):
        with pytest.raises(UserError, match="the same command is running there"):
            made(tmp_path / "export", fill)
        return fill(folder)

    made(tmp_path / "export", fill_while_another_starts)
    made(tmp_path / "export", fill)  # done already, with these settings
    assert (tmp_path / "export" / "whole").read_text() == "content"


@pytest.mark.parametrize(
    ("error", "is_clear"),
    [
        ("error: x: cannot write (No space left on device); free space\n", True),
        ("rendering:  33%|###| 1/3\nerror: one line\n", True),
        ("error: one\nand another\n", False),
        ("Traceback (most recent call last):\n  File x\nKeyError: 1\n", False),
        ("", False),
    ],
)
def test_what_counts_as_one_clear_line(error, is_clear):
    assert (trials.fault(error) == "") == is_clear
