# SPDX-License-Identifier: Apache-2.0
"""A slice of ``benchmarks/faults.py``: broken scenes load right or say why."""

import itertools
import os

from benchmarks import faults


def test_no_broken_scene_ends_in_a_fault_of_ours():
    found = list(faults.broken_scenes(200, seed=0))
    assert [one for one in found if one[1] in faults.FAULTS] == []
    assert {outcome for _, outcome, _ in found} == {"loaded", "refused"}


def test_the_campaign_sees_each_fault(tmp_path):
    case = faults.Case(0, "blender", "low/01.png", "flip")
    whole = faults.Loaded("", True, "", {"00.png": 1.0, "01.png": 2.0})

    def outcome(broken):
        return faults.judged(case, whole, broken, tmp_path)[0]

    named = f"{tmp_path}/low/01.png: cut short"
    swapped = {"00.png": 2.0, "01.png": 2.0}
    expected = {
        "hang": None,
        "traceback": faults.Loaded("KeyError: 1", False, "", {}),
        "unclear": faults.Loaded("something is wrong", True, "", {}),
        "refused": faults.Loaded(named, True, "", {}),
        "wrong": faults.Loaded("", True, "", swapped),
        "lost": faults.Loaded("", True, "", {"00.png": 1.0}),
        "loaded": faults.Loaded("", True, "01.png left out", {"00.png": 1.0}),
    }
    assert {name: outcome(broken) for name, broken in expected.items()} == {
        name: name for name in expected
    }
    several = faults.Loaded(f"{named}\nand more", True, "", {})
    assert outcome(several) == "unclear"


def test_a_loader_outlives_a_death_and_a_hang(tmp_path, monkeypatch):
    monkeypatch.setattr(faults, "SECONDS", 5.0)
    with faults.Loader(die_or_hang) as loader:
        died = loader.load(tmp_path / "die")
        assert died is not None and died.error == "the process died"
        whole = loader.load(tmp_path / "whole")
        assert whole is not None and whole.values == {"whole": 1.0}
        assert loader.load(tmp_path / "hang") is None


def die_or_hang(folder):
    if folder.name == "die":
        os._exit(1)
    for _ in itertools.count() if folder.name == "hang" else ():
        pass
    return {folder.name: 1.0}
