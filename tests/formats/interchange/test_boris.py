"""BORIS: states start and stop by behaviour, subject and modifiers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from ecat.formats.interchange.boris import FORMAT
from ecat.model import Event, Layer, Role, Segment
from ecat.progress import silent
from ecat.sample import sample_session
from ecat.store import create_session
from tests.formats.interchange.documents import BORIS
from tests.formats.interchange.layers import base_session, there_and_back


@pytest.fixture
def read(tmp_path: Path) -> tuple[Layer, tuple[str, ...]]:
    (tmp_path / "a.boris").write_text(json.dumps(BORIS))
    assert FORMAT.read_layer is not None
    session = base_session(tmp_path, "uniform", file="media/take.mp4")
    return FORMAT.read_layer(tmp_path / "a.boris", session)


def test_the_observation_of_the_sessions_video_is_read(read: Any) -> None:
    assert len(read[0].events) == 4


def test_a_state_stops_where_the_same_behaviour_subject_and_modifiers_come_again(read: Any) -> None:
    cube, ball, tap, open_ = read[0].events
    assert [(s.start_frame, s.end_frame) for e in (cube, ball) for s in e.segments] == [(15, 45), (21, 60)]
    assert [(s.start_frame, s.end_frame) for s in tap.segments] == [(27, 28)]
    assert open_.segments[0].end_frame in {89, 90}
    assert "1 state without a stop: to the end of the recording, if that is told" in read[1]


def test_subjects_and_modifiers_are_roles_and_comments_texts(read: Any) -> None:
    layer, _ = read
    cube, _, tap, open_ = layer.events
    names = {thing.id: thing.name for thing in layer.objects}
    assert [(role.name, names[role.target]) for role in cube.roles] == [("Agent", "Ann"), ("what", "cube")]
    assert (cube.type, cube.tier, cube.text) == ("slide", "action", "fast")
    assert tap.roles == open_.roles == ()


def test_rows_without_a_time_are_told_of(read: Any) -> None:
    assert "1 row without a time left out" in read[1]


def test_states_pair_up_as_boris_pairs_them(tmp_path: Path) -> None:
    draft, _ = sample_session(seed=1)
    session = create_session(tmp_path / "s", draft)
    assert FORMAT.part is not None
    FORMAT.part(session, "s", tmp_path / "a.boris", FORMAT.options(), silent)
    project = json.loads((tmp_path / "a.boris").read_text())
    (observation,) = project["observations"].values()
    kinds = {code["code"]: code["type"] for code in project["behaviors_conf"].values()}
    open_: dict[tuple[str, str, str], float] = {}
    found: list[tuple[str, int, int]] = []
    for time, subject, code, modifiers, _, _ in observation["events"]:
        assert kinds[code] == "State event"
        key = (subject, code, modifiers)
        if key in open_:
            found.append((code, round(open_.pop(key) * 1e9), round(time * 1e9)))
        else:
            open_[key] = time
    assert not open_
    events = draft.layers[0].events
    assert sorted(found) == sorted((e.type, s.start_ns, s.end_ns) for e in events for s in e.segments)
    assert observation["events"] == sorted(observation["events"], key=lambda row: row[0])


def test_of_events_that_boris_cannot_tell_apart_one_is_left_out(tmp_path: Path) -> None:
    events = tuple(
        Event(id=f"a{n}", type="slide", segments=(Segment(start_frame=n, end_frame=n + 10),)) for n in (1, 5)
    )
    session = base_session(tmp_path, "uniform", Layer(events=events))
    layer, findings = there_and_back(FORMAT, session, tmp_path)
    assert [s.start_frame for e in layer.events for s in e.segments] == [1]
    assert findings[0].startswith("1 stretch left out: BORIS cannot tell them")


def test_another_role_may_be_the_subject(tmp_path: Path) -> None:
    roles = (Role(name="Agent", target="a1", kind="event"), Role(name="Who", target="a1", kind="event"))
    event = Event(id="a1", type="slide", roles=roles, segments=(Segment(start_frame=1, end_frame=5),))
    session = base_session(tmp_path, "uniform", Layer(events=(event,)))
    there_and_back(FORMAT, session, tmp_path, subject="Who")
    (row, _) = json.loads((tmp_path / "file.boris").read_text())["observations"]["s"]["events"]
    assert row[1:4] == ["event:a1", "slide", "event:a1"]


def test_an_event_of_one_image_is_a_point(tmp_path: Path) -> None:
    event = Event(id="a1", type="tap", segments=(Segment(start_frame=7, end_frame=8),))
    session = base_session(tmp_path, "uniform", Layer(events=(event,)))
    layer, _ = there_and_back(FORMAT, session, tmp_path)
    project = json.loads((tmp_path / "file.boris").read_text())
    assert project["behaviors_conf"]["0"]["type"] == "Point event"
    assert len(project["observations"]["s"]["events"]) == 1
    assert [(s.start_frame, s.end_frame) for s in layer.events[0].segments] == [(7, 8)]
