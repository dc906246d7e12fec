"""Sub-events in the language columns: what is said from which row on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import LimitError
from ecat.formats.episodes import Episode, Subtask
from ecat.formats.lerobot import language
from ecat.formats.lerobot.language import Gaps, entries


def episode(*parts: tuple[str, int, int, int], n: int = 10, event: str = "a1") -> Episode:
    """Ten moments, a nanosecond apart; parts are (text, start, end, level)."""
    nothing = np.empty((n, 0), np.float32)
    return Episode(
        session="s",
        index=0,
        event=event,
        task="do it",
        start_ns=0,
        end_ns=n,
        times_ns=np.arange(n),
        state=nothing,
        state_names=(),
        action=nothing,
        action_names=(),
        subtasks=tuple(Subtask(a, b, text, "t", "", level) for text, a, b, level in parts),
    )


def said(found: Episode, gaps: Gaps) -> list[tuple[int, str, str | None]]:
    return [(e.row, e.style, e.content) for e in entries(found, gaps)]


@pytest.mark.parametrize(
    ("gaps", "expected"),
    [
        ("hold", [(0, "grasp"), (5, "move")]),
        ("task", [(0, "do it"), (1, "grasp"), (4, "do it"), (5, "move"), (8, "do it")]),
        ("none", [(0, None), (1, "grasp"), (4, None), (5, "move"), (8, None)]),
    ],
)
def test_gaps_are_filled_as_asked(gaps: Gaps, expected: list[tuple[int, str | None]]) -> None:
    found = said(episode(("grasp", 1, 4, 1), ("move", 5, 8, 1)), gaps)
    assert found == [(row, "subtask", content) for row, content in expected]


def test_a_part_within_another_interrupts_it() -> None:
    found = said(episode(("hold", 0, 10, 1), ("move", 3, 6, 1)), "hold")
    assert [(row, text) for row, _, text in found] == [(0, "hold"), (3, "move"), (6, "hold")]


def test_what_lies_deeper_is_a_motion_and_its_end_is_said() -> None:
    found = said(episode(("hold", 0, 10, 1), ("lift", 2, 5, 2)), "hold")
    assert found == [(0, "subtask", "hold"), (2, "motion", "lift"), (5, "motion", None)]


def test_of_a_whole_session_the_topmost_events_are_subtasks() -> None:
    found = said(episode(("slide", 0, 10, 0), ("lift", 2, 5, 1), event=""), "hold")
    assert found == [(0, "subtask", "slide"), (2, "motion", "lift"), (5, "motion", None)]


def test_an_episode_without_parts_says_nothing() -> None:
    for gaps in ("hold", "task", "none"):
        assert said(episode(), gaps) == []
    assert language.subtasks((), 3) == ["", "", ""]


def test_parts_between_two_moments_are_counted() -> None:
    short = episode(("blink", 3, 3, 1), ("long", 0, 9, 1))
    assert language.unheard(short) == 1


spans = st.tuples(st.integers(-2, 10), st.integers(1, 6)).map(lambda s: ("p", s[0], s[0] + s[1], 1))


@given(st.lists(spans, max_size=6), st.sampled_from(["hold", "task", "none"]))
def test_exactly_one_subtask_is_active_at_each_moment(
    parts: list[tuple[str, int, int, int]], gaps: Gaps
) -> None:
    """As lerobot's own annotator makes sure of."""
    named = [(f"p{i}", a, b, level) for i, (_, a, b, level) in enumerate(parts)]
    found = episode(*named)
    rows = entries(found, gaps)
    starts = [entry.row for entry in rows]
    assert starts == sorted(set(starts))
    if not rows:
        assert all(b <= 0 or a >= 10 for _, a, b, _ in named)
        return
    assert starts[0] == 0
    each = language.subtasks(rows, 10)
    for moment, text in enumerate(each):
        active = [name for name, a, b, _ in named if a <= moment < b]
        if active:
            assert text in active
        elif gaps != "hold":
            assert text == ("do it" if gaps == "task" else "")


def test_the_column_repeats_what_is_said_on_every_row() -> None:
    rows = entries(episode(("grasp", 0, 4, 1), ("move", 4, 8, 1)), "hold")
    times = (np.arange(10) / 30).astype(np.float32)
    column = language.persistent_column(rows, times, "s")
    assert column.type == language.PERSISTENT_TYPE
    assert len(column) == 10
    assert column[0] == column[9]
    second = column[7].as_py()[1]
    assert (second["content"], second["style"], second["role"]) == ("move", "subtask", "assistant")
    # exactly the timestamp of a row, to the last bit
    assert np.float32(second["timestamp"]) == times[4]
    assert language.events_column(10).to_pylist() == [[]] * 10


def test_a_column_that_would_not_fit_into_memory_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(language, "MAX_ENTRIES", 19)
    rows = entries(episode(("grasp", 0, 4, 1), ("move", 4, 8, 1)), "hold")
    with pytest.raises(LimitError, match="cannot write the sub-events of s") as raised:
        language.persistent_column(rows, np.zeros(10, np.float32), "s")
    assert "episodes=event" in raised.value.fix
