"""Errors are counted by how far they are from a change of the label, and by slot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from learn.recognize.dataset import LabelledSession
from learn.recognize.evaluation import Predicted
from learn.recognize.limits import by_distance, by_slot, change_distances, draw_limits, limits

BARE, FULL = [1, 2, 0, 1, 0], [1, 2, 3, 1, 3]
ONE = LabelledSession("pushto", "a", np.zeros((55, 21, 3)), np.array([BARE] * 3 + [FULL] * 5, np.int8))
OTHER = replace(ONE, name="b", labels=np.array([FULL] * 2, np.int8))


def said() -> Predicted:
    sessions = [ONE, OTHER]
    labels = np.concatenate([session.labels for session in sessions])
    labels[2] = FULL
    labels[7, 3] = 2
    way = {"windows": labels, "context": np.concatenate([session.labels for session in sessions])}
    return Predicted(sessions, way, {name: np.ones(len(labels)) for name in way})


def test_the_windows_beside_a_change_are_nearest_to_it() -> None:
    assert change_distances(ONE.labels).tolist() == [2, 1, 0, 0, 1, 2, 3, 4]
    assert change_distances(OTHER.labels).tolist() == [-1, -1]
    assert change_distances(np.zeros((0, 5), np.int8)).tolist() == []


def test_errors_are_counted_by_distance() -> None:
    rows = by_distance(said(), "windows")
    assert [row["windows"] for row in rows] == [2, 2, 2, 1, 1, 0, 2]
    assert [row["wrong"] for row in rows] == [1, 0, 0, 0, 1, 0, 0]


def test_errors_are_counted_by_slot() -> None:
    found = by_slot(said(), "windows")
    assert found["wrong"] == 2
    assert found["together"] == {"locative + preposition": 1, "verb": 1}
    assert found["slots"]["verb"] == {"wrong": 1, "alone": 1}
    assert found["slots"]["preposition"] == {"wrong": 1, "alone": 0}
    assert limits(said())["context"]["by_slot"]["wrong"] == 0


def test_they_are_drawn(tmp_path: Path, drawn: list[Any]) -> None:
    draw_limits(said(), tmp_path / "limits.png")
    assert (tmp_path / "limits.png").read_bytes().startswith(b"\x89PNG")
    assert drawn[0].get_suptitle() == "10 windows of 2 sessions"
    left, right = drawn[0].axes
    for axes in (left, right):
        assert [text.get_text() for text in axes.get_legend().get_texts()] == [
            "windows alone",
            "with the session",
        ]
    assert [label.get_text() for label in left.get_xticklabels()] == [
        *"01234",
        "5 or more",
        "no change\nin the session",
    ]
    assert left.texts[0].get_text() == "1\nof 2"
    assert [bar.get_height() for bar in left.patches[:5]] == [50, 0, 0, 0, 100]
    assert "%" in left.get_ylabel()
    assert right.texts[3].get_text() == "1"
