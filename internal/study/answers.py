# SPDX-License-Identifier: Apache-2.0
"""Answers of a study's participants, and what they say about the methods.

A CSV holds one participant's answers, a row per pair of pictures.
"""

import csv
import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

from internal.errors import UserError

COLUMNS = ("study", "participant", "view", "a", "b", "left", "answer")
ANSWERS = ("A", "undecided", "B")
NORMAL_95 = 1.959964  # two-sided 95 % quantile


@dataclasses.dataclass(frozen=True)
class Answer:
    """Which of two methods' pictures of a view a participant found better."""

    study: str
    participant: str
    view: str
    a: str  # the method under test
    b: str  # its rival
    left: str  # which of them, "a" or "b", was seen on the left
    answer: str  # one of ANSWERS


@dataclasses.dataclass(frozen=True)
class Preference:
    """Shares of answers in a comparison with one rival; they sum to 1."""

    rival: str
    a_better: float
    undecided: float
    b_better: float
    interval: tuple[float, float]  # of a_better, 95 %
    participants: int
    answers: int


def read_answers(paths: Sequence[Path]) -> list[Answer]:
    """Reads the CSVs of one study.

    Raises:
        UserError: a file is no such CSV, is of another study, or a participant
            answered the same question twice.
    """
    answers = [answer for path in paths for answer in _read_one(path)]
    if not answers:
        raise UserError(
            f"{paths[0]}: no answers; download the CSV from the study's page"
        )
    for name in ("study", "a"):
        found = sorted({getattr(answer, name) for answer in answers})
        if len(found) > 1:
            raise UserError(
                f"{paths[0]} and others: answers of different studies ({name}: "
                f"{', '.join(found)}); give the CSVs of one"
            )
    questions = [(answer.participant, answer.view, answer.b) for answer in answers]
    for question in questions:
        if questions.count(question) > 1:
            raise UserError(
                f"participant {question[0]!r} answers {question[1]} twice; give each "
                "CSV once, and rename participants of equal name"
            )
    return answers


def preferences(answers: Sequence[Answer]) -> list[Preference]:
    """The result against each rival, in the order of names."""
    rivals = sorted({answer.b for answer in answers})
    return [
        _preference(rival, [a for a in answers if a.b == rival]) for rival in rivals
    ]


def wilson_interval(share: float, trials: int) -> tuple[float, float]:
    """95 % interval of a share observed in independent trials (Wilson 1927)."""
    z = NORMAL_95**2 / trials
    middle = (share + z / 2.0) / (1.0 + z)
    half = math.sqrt(z * share * (1.0 - share) + z**2 / 4.0) / (1.0 + z)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def _preference(rival: str, answers: Sequence[Answer]) -> Preference:
    """Each participant counts once: answers of one person are not independent, and a
    mean of shares varies at most as much as a mean of yes and no."""
    by_person: dict[str, list[str]] = {}
    for answer in answers:
        by_person.setdefault(answer.participant, []).append(answer.answer)
    people = len(by_person)
    a_better, undecided, b_better = (
        sum(given.count(kind) / len(given) for given in by_person.values()) / people
        for kind in ANSWERS
    )
    interval = wilson_interval(a_better, people)
    return Preference(
        rival, a_better, undecided, b_better, interval, people, len(answers)
    )


def _read_one(path: Path) -> list[Answer]:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UserError(f"{path}: cannot be read ({error}); give a CSV") from error
    for number, row in enumerate(rows, start=2):
        if set(row) != set(COLUMNS) or row["answer"] not in ANSWERS:
            raise UserError(
                f"{path}: line {number} is no answer; expected the columns "
                f"{', '.join(COLUMNS)} and an answer of {', '.join(ANSWERS)}: "
                "download the CSV from the study's page"
            )
    return [Answer(**row) for row in rows]
