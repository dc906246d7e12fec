"""Lanes: no two events of one overlap, and parts lie below and within their wholes."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import LimitError
from ecat.formats.interchange.lanes import MOST_DEPTH, lanes_of, tier_of
from ecat.model import Event, Segment
from ecat.store import Session
from tests.formats.interchange.layers import base_session, layers


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    return base_session(Path(tmp_path_factory.mktemp("lanes")), "uniform")


def spans(events: tuple[Event, ...]) -> dict[str, list[tuple[int, int]]]:
    return {e.id: sorted((s.start_frame, s.end_frame) for s in e.segments) for e in events}


@given(st.data())
def test_lanes_hold_every_event_once_and_none_over_another(session: Session, data: st.DataObject) -> None:
    events = data.draw(layers(session)).events
    known = spans(events)
    lanes, nested = lanes_of(sorted(events, key=lambda e: known[e.id]), known)
    assert sorted(event.id for lane in lanes for event in lane.events) == sorted(known)
    assert len({lane.name for lane in lanes}) == len(lanes)
    for lane in lanes:
        there = sorted(span for event in lane.events for span in known[event.id])
        assert all(first[1] <= second[0] for first, second in pairwise(there))
        assert tier_of(lane.name, lane.above.name if lane.above else None) == lane.tier
        for event in lane.events:
            assert event.tier == lane.tier
            assert (event.id in nested) == (lane.above is not None)
            if lane.above is not None:
                assert event.parent in {whole.id for whole in lane.above.events}
                wholes = known[event.parent or ""]
                assert all(any(a <= s and e <= b for a, b in wholes) for s, e in known[event.id])


def test_events_that_are_a_part_of_each_other_are_on_a_lane_all_the_same() -> None:
    one = Event(id="a1", parent="a2", segments=(Segment(start_frame=0, end_frame=2),))
    other = Event(id="a2", parent="a1", segments=(Segment(start_frame=0, end_frame=2),))
    lanes, _ = lanes_of([one, other], spans((one, other)))
    assert sorted(event.id for lane in lanes for event in lane.events) == ["a1", "a2"]


@pytest.mark.parametrize("tier", ["", "gesture", "left hand #2", "a@b"])
def test_the_name_of_a_lane_tells_its_tier(tier: str) -> None:
    events = [Event(id=f"a{n}", tier=tier, segments=(Segment(start_frame=0, end_frame=2),)) for n in range(3)]
    lanes, _ = lanes_of(events, spans(tuple(events)))
    assert [tier_of(lane.name, None) for lane in lanes] == [tier] * 3


def test_parts_of_parts_of_parts_are_below_each_other_down_to_a_limit() -> None:
    segments = (Segment(start_frame=0, end_frame=2),)
    events = [Event(id=f"a{n}", parent=f"a{n - 1}" if n else None, segments=segments) for n in range(5000)]
    lanes, nested = lanes_of(events, spans(tuple(events)))
    assert max(lane.depth for lane in lanes) == MOST_DEPTH
    assert len(nested) > 4000


def test_more_events_at_one_time_than_happen_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ecat.formats.interchange.lanes.MOST_LANES", 3)
    events = [Event(id=f"a{n}", segments=(Segment(start_frame=0, end_frame=2),)) for n in range(4)]
    with pytest.raises(LimitError, match="more than 3 others"):
        lanes_of(events, spans(tuple(events)))
