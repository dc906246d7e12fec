"""What was said for what is a picture that says of which data it is, and how much is right."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecat.errors import InputError
from learn.recognize.dataset import LabelledSession
from learn.recognize.evaluation import Predicted, confusion, draw_confusions, splits_of

TRUE = np.array([[1, 2, 0, 1, 0]] * 4 + [[1, 2, 3, 1, 3]] * 4, np.int8)


def said(*wrong: int) -> Predicted:
    """A session of eight windows; in those that are ``wrong`` a roll is seen instead of a push."""
    labels = TRUE.copy()
    labels[list(wrong), 3] = 3
    session = LabelledSession("pushto", "a", np.zeros((55, 21, 3)), TRUE)
    return Predicted(
        [session], {"windows": labels, "context": TRUE}, dict.fromkeys(("windows", "context"), np.ones(8))
    )


def words_of(labels: Any) -> list[str]:
    return [label.get_text() for label in labels]


def test_counts_are_of_what_is_true_in_rows_and_of_what_was_said_in_columns() -> None:
    assert confusion(np.array([0, 0, 1], np.int8), np.array([0, 1, 1], np.int8), 2).tolist() == [
        [1, 1],
        [0, 1],
    ]


def test_only_what_occurs_is_drawn_and_axes_say_what_they_are(tmp_path: Path, drawn: list[Any]) -> None:
    draw_confusions(said(7), "windows", tmp_path / "c.png")
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")
    *panels, bar = drawn[0].axes
    assert [words_of(axes.get_xticklabels()) for axes in panels] == [
        ["Performer"],
        ["Object_1"],
        ["none", "Object_2"],
        ["push", "roll"],
        ["none", "To"],
    ]
    verb = panels[3]
    assert (verb.get_xlabel(), verb.get_ylabel()) == ("said", "true")
    assert words_of(verb.get_yticklabels()) == ["push", "roll"]
    assert words_of(verb.texts) == ["7", "1", "0", "0"]
    np.testing.assert_allclose(verb.images[0].get_array(), [[87.5, 12.5], [0, 0]])
    assert "%" in bar.get_ylabel()


@pytest.mark.parametrize(
    ("way", "title", "verb"),
    [
        ("windows", "windows alone: 8 windows of 1 session, 75.0 % right", "verb: 75.0 %"),
        ("context", "with the session: 8 windows of 1 session, 100.0 % right", "verb: 100.0 %"),
    ],
)
def test_the_title_says_of_which_data_it_is_and_how_much_is_right(
    way: str, title: str, verb: str, tmp_path: Path, drawn: list[Any]
) -> None:
    draw_confusions(said(1, 7), way, tmp_path / "c.png")
    assert drawn[0].get_suptitle() == title
    assert drawn[0].axes[3].get_title() == verb


def test_one_session_cannot_be_cross_validated() -> None:
    with pytest.raises(InputError) as caught:
        splits_of(said().sessions, "random")
    assert caught.value.where == "1 session in 1 of 5 folds"
