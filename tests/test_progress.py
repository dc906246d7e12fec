"""How far work is, as told by works that go on side by side."""

from __future__ import annotations

from ecat.progress import together


def test_what_is_done_side_by_side_is_told_as_one() -> None:
    told: list[tuple[str, int, int]] = []
    tell = together("writing color, depth", 30, lambda *state: told.append(state))
    tell("writing color", 5, 10)
    tell("writing depth", 2, 20)
    tell("writing color", 10, 10)
    assert told == [(("writing color, depth"), done, 30) for done in (5, 7, 12)]
