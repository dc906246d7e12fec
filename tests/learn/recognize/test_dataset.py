"""Learning exports become sessions with labelled windows, or one error that says what is wrong with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ecat.errors import FormatError, InputError, NotFoundError
from learn.recognize.dataset import exchanged, read_exports, words
from tests.learn.recognize import made


def test_sessions_come_with_their_points_and_a_label_for_each_window(tmp_path: Path) -> None:
    first, *_ = read_exports(made.exports(tmp_path, 1))
    assert first.key == ("pullpast", "pullpast1")
    np.testing.assert_allclose(first.points, made.scene(1, past=True), atol=1e-4)
    assert words(first.labels[0].tolist()) == ["Performer", "Object_1", None, "pull", None]
    assert words(first.labels[-1].tolist()) == ["Performer", "Object_1", "Object_2", "pull", "Past"]


def test_exports_are_found_however_deep_they_lie_and_empty_sessions_are_left_out(tmp_path: Path) -> None:
    made.exports(tmp_path, 2)
    made.write(
        tmp_path / "more.txt", '<session name="nothing" />', made.session("a", made.scene(1), made.labels(1))
    )
    assert [session.file for session in read_exports(tmp_path)] == ["pullpast"] * 2 + ["more"] + [
        "pushto"
    ] * 2


def test_exchanging_the_boxes_twice_changes_nothing(tmp_path: Path) -> None:
    labels = read_exports(made.exports(tmp_path, 1))[0].labels
    assert (exchanged(labels)[:, 1] == 3).all()
    np.testing.assert_array_equal(exchanged(exchanged(labels)), labels)


def test_unknown_labels_are_all_listed_with_their_counts(tmp_path: Path) -> None:
    events = ["Subject,Object,None,throws,None"] * 5 + ["Boss,Object,None,pushes,Over"]
    made.write(tmp_path / "a.txt", made.session("a", made.scene(1), events))
    with pytest.raises(InputError) as caught:
        read_exports(tmp_path)
    assert sorted(caught.value.where.split("\n")) == [
        "preposition Over: 1 times",
        "role Boss: 1 times",
        "verb throws: 5 times",
    ]


@pytest.mark.parametrize(
    ("points", "events", "said"),
    [
        (made.scene(1)[:12], [], "12 frames"),
        (made.scene(1), made.labels(1)[:-1], "5 labels for the 6 windows"),
        (np.where(np.arange(21)[:, None] < 17, made.scene(1), 0.0), made.labels(1), "box 2 was never seen"),
        (np.where(np.arange(21)[:, None] < 17, made.scene(1), -1.0), made.labels(1), "box 2 was never seen"),
    ],
)
def test_a_session_that_cannot_be_used_is_named(
    points: made.Floats, events: list[str], said: str, tmp_path: Path
) -> None:
    made.write(tmp_path / "a.txt", made.session("odd", points, events))
    with pytest.raises(InputError, match="session odd of") as caught:
        read_exports(tmp_path)
    assert said in caught.value.where


def test_two_actors_in_one_role_are_refused(tmp_path: Path) -> None:
    made.write(tmp_path / "a.txt", made.session("a", made.scene(1), ["Subject,Subject,None,rolls,None"] * 6))
    with pytest.raises(FormatError) as caught:
        read_exports(tmp_path)
    assert "two are Subject" in caught.value.where


def test_the_same_session_twice_is_refused(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        made.write(tmp_path / folder / "x.txt", made.session("s", made.scene(1), made.labels(1)))
    with pytest.raises(InputError) as caught:
        read_exports(tmp_path)
    assert "x s" in caught.value.where


@pytest.mark.parametrize("name", ["missing", ""])
def test_no_exports_are_an_error(name: str, tmp_path: Path) -> None:
    with pytest.raises(NotFoundError):
        read_exports(tmp_path / name)
