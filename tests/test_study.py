# SPDX-License-Identifier: Apache-2.0
"""The user study: pairs on the page, answers in the chart."""

import csv
import json
import re

import pytest

import study as study_script
from internal.errors import UserError
from internal.pages import charts
from internal.study.answers import COLUMNS, preferences, read_answers, wilson_interval
from tests.scene_writers import write_pictures

NAMES = [f"{i:02}.png" for i in range(6)]


def write_answers(path, participant, given):
    """``given``: (view, rival, answer)."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for view, rival, answer in given:
            writer.writerow(["s1", participant, view, "ours", rival, "a", answer])
    return path


@pytest.fixture
def methods(tmp_path):
    """Arguments that name a method under test, as eval.py leaves it, and two rivals."""
    write_pictures(tmp_path / "ours" / "enhanced", NAMES)
    write_pictures(tmp_path / "one", NAMES, 100.0)
    write_pictures(tmp_path / "two", NAMES, 150.0)
    return [f"{name}={tmp_path / name}" for name in ("ours", "one", "two")]


def embedded_study(folder):
    text = (folder / "index.html").read_text()
    found = re.search(r"const study = (\{.*\});", text)
    assert found is not None
    return json.loads(found[1])


def test_the_page_pairs_the_first_method_with_every_other(tmp_path, methods):
    out = tmp_path / "study"
    assert study_script.main(["make", str(out), *methods, "--views", "4"]) == 0
    study = embedded_study(out)
    assert [pair["b"] for pair in study["pairs"]] == ["one"] * 4 + ["two"] * 4
    views = [pair["view"] for pair in study["pairs"]]
    assert views[:4] == views[4:] and len(set(views)) == 4
    for pair in study["pairs"]:
        assert (out / pair["a_url"]).is_file() and (out / pair["b_url"]).is_file()
        assert "ours" not in pair["a_url"] and "one" not in pair["b_url"]


def test_the_same_seed_makes_the_same_study_and_another_one_does_not(tmp_path, methods):
    studies = []
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        study_script.main(
            ["make", str(tmp_path / name), *methods, "--views", "3", "--seed", seed]
        )
        studies.append(embedded_study(tmp_path / name))
    assert studies[0] == studies[1]
    assert studies[0]["id"] != studies[2]["id"]


@pytest.mark.parametrize(
    "methods, message",
    [
        (["ours"], "expected NAME=FOLDER"),
        (["ours=a"], "two or more"),
        (["ours=a", "ours=b"], "named apart"),
        (["ours=missing", "b=missing"], "folder of pictures not found"),
    ],
)
def test_a_study_that_cannot_be_made_leaves_nothing(tmp_path, methods, message):
    with pytest.raises(UserError, match=message):
        study_script.main(["make", str(tmp_path / "study"), *methods])
    assert not list(tmp_path.iterdir())


def test_each_participant_counts_once(tmp_path):
    # Ann: 2 of 2 for A; Bob: 1 A, 1 undecided, 2 B. A better: (1 + 1/4) / 2.
    ann = write_answers(
        tmp_path / "a.csv", "ann", [("0", "one", "A"), ("1", "one", "A")]
    )
    given = [("0", "A"), ("1", "undecided"), ("2", "B"), ("3", "B")]
    bob = write_answers(tmp_path / "b.csv", "bob", [(v, "one", x) for v, x in given])
    (result,) = preferences(read_answers([ann, bob]))
    assert result.a_better == pytest.approx(0.625)
    assert result.undecided == pytest.approx(0.125)
    assert result.b_better == pytest.approx(0.25)
    assert (result.participants, result.answers) == (2, 6)
    assert result.interval == wilson_interval(0.625, 2)


def test_intervals_hold_the_share_and_shrink_with_people():
    # Agresti and Coull 1998, 5 of 10: 0.237 to 0.763.
    assert wilson_interval(0.5, 10) == pytest.approx((0.237, 0.763), abs=1e-3)
    widths = []
    for people in (1, 8, 80):
        low, high = wilson_interval(1.0, people)
        assert 0.0 <= low < high == pytest.approx(1.0)
        widths.append(high - low)
    assert widths == sorted(widths, reverse=True)


def test_the_chart_is_drawn_and_its_numbers_are_written(tmp_path):
    answers = [("0", "one", "A"), ("0", "two", "B"), ("1", "two", "undecided")]
    path = write_answers(tmp_path / "ann.csv", "ann", answers)
    out = tmp_path / "chart"
    assert study_script.main(["chart", str(out), str(path)]) == 0
    text = (out / "preferences.csv").read_text()
    rows = list(csv.DictReader(text.splitlines()))
    assert [(row["rival"], row["a_better"]) for row in rows] == [
        ("one", "1.0"),
        ("two", "0.0"),
    ]
    assert "<svg" in (out / "index.html").read_text()


def test_the_same_answers_draw_the_same_chart(tmp_path):
    path = write_answers(tmp_path / "ann.csv", "ann", [("0", "one", "A")])
    results = preferences(read_answers([path]))
    assert charts.preference_chart("ours", results) == charts.preference_chart(
        "ours", results
    )


def test_files_that_are_no_answers_are_named(tmp_path):
    bad = tmp_path / "bad.csv"
    bad.write_text("view,score\n0,1\n")
    with pytest.raises(UserError, match=r"bad\.csv: line 2 is no answer"):
        read_answers([bad])
    with pytest.raises(UserError, match=r"none\.csv: cannot be read"):
        read_answers([tmp_path / "none.csv"])
    empty = write_answers(tmp_path / "empty.csv", "ann", [])
    with pytest.raises(UserError, match="no answers"):
        read_answers([empty])
    ann = write_answers(tmp_path / "ann.csv", "ann", [("0", "one", "A")])
    with pytest.raises(UserError, match=r"'ann' answers 0 twice"):
        read_answers([ann, ann])


def test_a_chart_is_not_drawn_over_the_page_that_asks(tmp_path, methods):
    out = tmp_path / "study"
    assert study_script.main(["make", str(out), *methods]) == 0
    page = (out / "index.html").read_bytes()
    answers = write_answers(tmp_path / "ann.csv", "ann", [("0", "one", "A")])
    with pytest.raises(UserError, match=r"index\.html: not a chart"):
        study_script.main(["chart", str(out), str(answers)])
    assert (out / "index.html").read_bytes() == page
    chart = tmp_path / "chart"
    for _ in range(2):  # over one's own
        assert study_script.main(["chart", str(chart), str(answers)]) == 0
