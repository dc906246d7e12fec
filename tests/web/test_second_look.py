"""Agreement and surveys over HTTP."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ecat.annotate.surveys import Source, make_survey
from ecat.model.survey import Survey
from ecat.store import open_session
from ecat.store.surveys import read_answers

if TYPE_CHECKING:
    from tests.web.conftest import Browser

ACTIONS = Survey(name="actions", question="What happens?")


@pytest.fixture
def asked(project: Path) -> Survey:
    """A survey of the project's events, made before anybody asks for it."""
    return make_survey(project, ACTIONS, Source())


def test_two_layers_are_compared(project: Path, browser: Browser) -> None:
    session = open_session(project / "slide")
    main = session.layer("main")
    event = next(e for e in main.events if e.parent is None)
    segment = replace(event.segments[0], end_frame=event.segments[0].end_frame + 9, end_ns=None)
    other = replace(event, segments=(segment,))
    with session.write() as commit:
        commit.put_layer(
            replace(main, name="ben", events=tuple(other if e is event else e for e in main.events))
        )
    found = browser.json("agreement?layers=main,ben")
    assert [(d["first"], d["second"], d["differs"]) for d in found["disagreements"]] == [
        (event.id, event.id, ["end"])
    ]
    assert found["figures"]["raters"] == ["main", "ben"]


@pytest.mark.parametrize(
    ("layers", "status"), [("main", 400), ("", 400), ("main,main,main", 400), ("main,nobody", 404)]
)
def test_what_cannot_be_compared_is_refused(reader: Browser, layers: str, status: int) -> None:
    answer = reader.get("agreement", params={"layers": layers})
    assert answer.status_code == status
    assert answer.json()["error"]["fix"]


def test_a_survey_does_not_tell_what_is_right(asked: Survey, browser: Browser) -> None:
    listed = browser.json("/api/surveys")
    assert listed == [
        {"name": "actions", "question": "What happens?", "items": len(asked.items), "raters": {}}
    ]
    shown = browser.json("/api/surveys/actions")
    assert shown["choices"] == list(asked.choices)
    assert set(shown["items"][0]) == {"id", "session", "start_frame", "end_frame"}
    sessions = {session["id"] for session in browser.json("/api/project")["sessions"]}
    assert {item["session"] for item in shown["items"]} <= sessions


def test_an_answer_is_on_the_disk_when_it_is_acknowledged(
    project: Path, asked: Survey, browser: Browser
) -> None:
    said = {"rater": "ann", "item": "0", "answer": asked.choices[0], "comment": "clear"}
    assert browser.post("/api/surveys/actions", said).status_code == 200
    assert [(a.rater, a.answer) for a in read_answers(project, "actions")] == [("ann", asked.choices[0])]
    again = browser.json("/api/surveys/actions?rater=ann")["answers"]
    assert again == {"0": {"answer": asked.choices[0], "comment": "clear"}}
    assert browser.json("/api/surveys/actions?rater=ben")["answers"] == {}
    assert browser.json("/api/surveys/actions/results")["answers"] == 1


@pytest.mark.parametrize(
    ("body", "status"),
    [
        ({"rater": "ann", "item": "0", "answer": "no such choice"}, 400),
        ({"rater": "ann", "item": "99", "answer": "x"}, 400),
        ({"rater": "", "item": "0", "answer": "x"}, 422),
        ({"rater": "ann", "item": "0"}, 422),
        ({"rater": "ann", "item": "0", "answer": "x", "more": 1}, 422),
        ([], 422),
    ],
)
def test_what_is_no_answer_is_refused(
    project: Path, asked: Survey, browser: Browser, body: object, status: int
) -> None:
    assert asked.items
    answer = browser.post("/api/surveys/actions", body)
    assert answer.status_code == status
    assert answer.json()["error"]["what"]
    assert read_answers(project, "actions") == []


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(min_size=1, max_size=80))
def test_no_name_leads_out_of_the_project(reader: Browser, name: str) -> None:
    typed = "".join(f"%{byte:02x}" for byte in name.encode("utf-8", "replace"))
    answer = reader.client.get(f"/api/surveys/{typed}")
    # 200 is the list of surveys, which is empty
    assert answer.status_code in {400, 404, 307} or answer.json() == []


def test_what_was_edited_a_moment_ago_is_compared_too(browser: Browser) -> None:
    assert browser.post("layers/ben", {"author": "ben"}).status_code == 200
    before = len(browser.json("agreement?layers=main,ben")["disagreements"])
    edit = {"author": "ben", "operations": [{"op": "add_event", "type": "wave", "segments": [[1, 9]]}]}
    assert browser.post("layers/ben/operations", edit).status_code == 200
    found = browser.json("agreement?layers=main,ben")["disagreements"]
    assert len(found) == before + 1
    assert "wave" in {each["label"] for each in found}
