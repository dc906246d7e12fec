"""Of each movement one action is said, whatever windows of it could not be seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import CorruptError
from learn.features.windows import Floats
from learn.recognize.model import Recognized
from learn.recognize.predict import Action, recognize
from tests.learn.recognize import made
from tests.learn.recognize.told import Says, long, recording

PUSH = ("Performer", "Object_1", None, "push", None)
PUSH_TO = ("Performer", "Object_1", "Object_2", "push", "To")


def still(n: int) -> Floats:
    return np.repeat(made.scene(1)[:1], n, axis=0)


def test_an_action_is_from_middle_to_middle_of_the_windows_that_say_it() -> None:
    said = [0, 1, 1, 2, 2, 0]  # of frames 0:20, 5:25, ... 25:45
    (found,) = recognize(recording(still(45)), Says(said))
    assert (found.start, found.end) == (12, 32)


def test_an_action_is_called_what_it_is_with_its_locative_and_what_it_is_before_is_a_part() -> None:
    (found,) = recognize(recording(still(45)), Says([0, 1, 1, 2, 2, 0]))
    sure = pytest.approx(0.8)
    before = Action(12, 22, PUSH, sure)  # pyright: ignore[reportArgumentType]
    assert found == Action(12, 32, PUSH_TO, sure, before=before)  # pyright: ignore[reportArgumentType]
    (alone,) = recognize(recording(still(45)), Says([2, 2, 2, 2, 2, 2]))
    assert (alone.words, alone.before) == (PUSH_TO, None)
    (never,) = recognize(recording(still(45)), Says([0, 1, 1, 1, 1, 1]))
    assert (never.words, never.before) == (PUSH, None)
    assert recognize(recording(still(45)), Says([0])) == []


@given(st.lists(st.integers(0, 2), min_size=1, max_size=12), st.integers(20, 140))
def test_an_action_lies_in_the_session_and_its_part_in_it(labels: list[int], n: int) -> None:
    found = recognize(recording(still(n)), Says(labels))
    n_windows = (n - 20) // 5 + 1
    assert len(found) == any((labels * n_windows)[:n_windows])
    for one in found:
        assert 0 <= one.start < one.end <= n
        assert one.words == (PUSH_TO if 2 in (labels * n_windows)[:n_windows] else PUSH)
        if one.before is not None:
            assert one.start == one.before.start < one.before.end < one.end
            assert one.before.words == PUSH


@pytest.mark.parametrize(("unseen", "actions"), [(30, 1), (48, 1), (53, 2), (80, 2)])
def test_a_movement_in_which_a_box_is_unseen_for_a_while_is_one_action(unseen: int, actions: int) -> None:
    """What a window of it shows is said to have no locative, the others to have one."""
    points = long((100, 220), n=300)
    points[140 : 140 + unseen, 13:17] = np.nan
    whole = replace(recording(points), moves=((100, 220),))
    says = Says([1] * 3 + [2] * 60)
    found = recognize(whole, says)
    assert len(says.seen) == 2
    assert len(found) == actions
    assert found[0].words == PUSH_TO
    if actions == 1:
        assert (found[0].start, found[0].end) == (pytest.approx(97, abs=6), pytest.approx(220, abs=6))
        assert found[0].before is not None


def test_parts_of_a_movement_are_of_the_action_that_most_of_it_shows() -> None:
    """Two windows at the end, which are seen apart, show another box to be moved."""

    class Undecided(Says):
        def recognize(self, sessions: Sequence[Floats]) -> Recognized:
            found = super().recognize(sessions)
            rows = np.array([[0] * 5, [1, 2, 0, 1, 0], [1, 3, 0, 1, 0]], np.int8)
            sure = np.array([0.1, 0.1, 0.8] if len(self.seen) == 2 else [0.1, 0.8, 0.1])
            probable = np.broadcast_to(sure, (len(found.context), 3))
            return Recognized(rows, probable, probable)

    points = long((100, 200), n=300)
    points[150:185, 13:17] = np.nan
    says = Undecided([1])
    (found,) = recognize(replace(recording(points), moves=((100, 200),)), says)
    assert [len(seen) for seen in says.seen] == [pytest.approx(75, abs=5), pytest.approx(40, abs=5)]
    assert found.words == PUSH


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_a_model_that_gives_no_probabilities_is_refused_by_name(wrong: float) -> None:
    class Broken(Says):
        def recognize(self, sessions: Sequence[Floats]) -> Recognized:
            found = super().recognize(sessions)
            found.context[2, 1] = wrong
            return found

    for run, said in ((Path("runs/first"), "model runs/first"), (None, "the model")):
        with pytest.raises(CorruptError, match=said):
            recognize(recording(made.scene(1)), Broken([1]), run=run)


@pytest.mark.parametrize(("moving", "said"), [(0, 1), (1, None)])
def test_a_box_that_rests_by_its_poses_is_not_the_one_that_is_moved(moving: int, said: int | None) -> None:
    """Says pushes box 1, which only one of the two labels it knows besides nothing contradicts."""
    points = long((100, 130), n=200)
    tracks = np.zeros((2, 200, 3))
    tracks[moving, :, 0] = 0.3 * np.clip((np.arange(200) - 100) / 30, 0, 1)
    known = replace(recording(points), tracks=tracks, moves=((100, 130),))
    found = recognize(known, Says([1]))
    assert [action.words[1] for action in found] == ([] if said is None else ["Object_1"])


def test_a_box_that_rests_in_the_last_part_of_its_movement_is_still_the_one_that_moves() -> None:
    """There the other box drifts by more than a box that rests may."""
    points = long((100, 150), n=300)
    points[150:180, 13:17] = np.nan
    tracks = np.zeros((2, 300, 3))
    tracks[0, :, 0] = 0.3 * np.clip((np.arange(300) - 100) / 50, 0, 1)
    tracks[1, :, 0] = 0.05 * np.clip((np.arange(300) - 185) / 30, 0, 1)
    known = replace(recording(points), tracks=tracks, moves=((100, 215),))
    says = Says([1])
    (found,) = recognize(known, says)
    assert len(says.seen) == 2
    assert found.words == PUSH
    assert found.end > 190
    assert found.confidence > 0.7
