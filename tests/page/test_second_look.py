"""Proposals of the machine, two annotators compared, surveys."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ecat.model import AnnotatedObject, Argument, Event, KeyFrame, Layer, Property, Relation, Role, Segment
from ecat.store import open_session


def _event(id_: str, kind: str, start: int, end: int, **more: Any) -> Event:
    tier = "sub-event" if more.get("parent") else "event"
    return Event(id=id_, type=kind, tier=tier, segments=(Segment(start_frame=start, end_frame=end),), **more)


def _add(served: Any, *layers: Layer) -> None:
    """Put layers beside the one that is there, with its objects."""
    session = open_session(served.path)
    objects = session.layer("main").objects
    with session.write() as commit:
        for layer in layers:
            commit.put_layer(replace(layer, objects=objects, object_counter=len(objects), scheme="blocks"))


@pytest.fixture
def proposing(served: Any, window: Callable[..., Any]) -> Any:
    """A session for which the machine proposes two slides, one with parts, and a relation."""
    whole = _event("a1", "slide_next", 20, 60, status="proposed", roles=(Role(name="Theme", target="o2"),))
    part = _event("a2", "move", 30, 50, status="proposed", parent="a1")
    other = _event("a3", "slide_past", 80, 120, status="proposed")
    near = Relation(
        id="r1", predicate="NEAR", start_frame=50, end_frame=90, source="computed", status="proposed",
        arguments=(Argument(target="o2"), Argument(target="o3")),
    )  # fmt: skip
    _add(served, Layer(name="machine", events=(whole, part, other), relations=(near,)))
    return window(served)


def test_proposals_are_gone_through_with_one_key_each(served: Any, proposing: Any) -> None:
    proposing.find("tab-machine").click()
    proposing.find("row-a1").click()
    assert proposing.says("app.cursor.frame") == 20
    proposing.press("Enter")
    assert proposing.says("app.primary.id") == "a3"
    proposing.press("x")
    layer = served.layer()
    assert [(e.type, e.status, e.parent is None) for e in layer.events] == [
        ("slide_next", "confirmed", True),
        ("move", "confirmed", False),
    ]
    assert {d.proposal: d.verdict for d in layer.decisions} == {
        "machine/a1": "accepted",
        "machine/a2": "accepted",
        "machine/a3": "rejected",
    }
    machine = served.session().layer("machine")
    assert {e.status for e in machine.events} == {"proposed"}


def test_a_proposed_part_is_accepted_with_its_whole_or_not_at_all(served: Any, proposing: Any) -> None:
    proposing.find("proposal-a2").focus()
    proposing.find("timeline-reject").wait_for()
    assert not proposing.find("timeline-accept").is_visible()
    assert proposing.find("accept").count() == 0
    assert proposing.find("proposal-end").is_disabled()
    proposing.press("Enter")
    proposing.find("toasts").get_by_text("part of slide_next (a1)").wait_for()
    assert served.layer().decisions == ()
    proposing.find("select-whole").click()
    assert proposing.says("app.primary.id") == "a1"
    proposing.find("accept").wait_for()


def test_a_proposal_is_adjusted_before_it_is_accepted(served: Any, proposing: Any) -> None:
    proposing.find("tab-machine").click()
    proposing.find("row-a3").click()
    proposing.find("tab-selected").click()
    proposing.find("proposal-end").fill("110")
    proposing.find("selected-panel").get_by_test_id("accept").click()
    proposing.settle()
    proposing.press("Control+z")
    assert len(served.layer().events) == 0
    proposing.press("Control+Shift+z")
    assert [(e.segments[0].start_frame, e.segments[0].end_frame) for e in served.layer().events] == [
        (80, 110)
    ]


def _recognised(number: int, start: int, sure: str) -> Event:
    told = (Property(name="confidence", value=sure),)
    return _event(
        f"a{number}", "push", start, start + 1, status="proposed", author="ecat learn recognize",
        text=f"Ann pushes box {number}", properties=told,
    )  # fmt: skip


@pytest.fixture
def recognised(served: Any, window: Callable[..., Any]) -> Any:
    """A session for which two programs propose 103 events, one of them with a part, and a relation."""
    sure = (_recognised(number, number, f"0.{number}") for number in range(10, 99))
    unsure = (_recognised(number, number, "0.05") for number in range(99, 112))
    slide = _event("a1", "slide_next", 20, 60, status="proposed", author="ecat propose 4")
    part = _event("a2", "move", 30, 50, status="proposed", parent="a1", author="ecat propose 4")
    near = Relation(
        id="r1", predicate="NEAR", start_frame=50, end_frame=90, source="computed", status="proposed",
        arguments=(Argument(target="o2"), Argument(target="o3")),
    )  # fmt: skip
    _add(served, Layer(name="machine", events=(*sure, *unsure, slide, part), relations=(near,)))
    return window(served)


def test_a_proposal_says_what_it_is_how_sure_it_is_and_who_made_it(recognised: Any) -> None:
    recognised.find("tab-machine").click()
    row = recognised.find("row-a12")
    what, note, frames = row.inner_text().split("\n")
    assert (what[:4], what[-17:]) == ("push", "Ann pushes box 12")
    assert note == "confidence 0.12 · ecat learn recognize"
    assert (frames[:2], frames[-2:]) == ("12", "13")
    row.click()
    recognised.find("tab-selected").click()
    assert recognised.find("proposal-text").inner_text() == "Ann pushes box 12"
    assert recognised.find("proposal-origin").inner_text() == "confidence 0.12 · ecat learn recognize"


def test_proposals_are_found_by_who_made_them(recognised: Any) -> None:
    recognised.find("tab-machine").click()
    recognised.find("find-proposals").fill("ecat propose")
    assert recognised.page.locator(".list-row").count() == 1
    recognised.find("row-a1").wait_for()


def test_the_surest_proposals_are_gone_through_first_if_somebody_wants_that(
    served: Any, recognised: Any
) -> None:
    recognised.find("tab-machine").click()
    recognised.find("proposal-order").select_option("surest")
    recognised.find("row-a98").click()
    recognised.press("x")
    assert recognised.says("app.primary.id") == "a97"
    recognised.press("Enter")
    assert [e.text for e in served.layer().events] == ["Ann pushes box 97"]


def test_after_a_part_was_rejected_its_whole_is_decided_about(served: Any, recognised: Any) -> None:
    recognised.page.evaluate("window.ecat.select([{ kind: 'event', id: 'a2', layer: 'machine' }])")
    recognised.press("x")
    assert recognised.says("app.primary.id") == "a1"
    recognised.press("Enter")
    assert [e.type for e in served.layer().events] == ["slide_next"]


def test_no_tab_is_cut_by_the_number_of_proposals_and_all_numbers_are_one(recognised: Any) -> None:
    for_each = "[...document.querySelectorAll('.tabs, .tab, .tab .name, .tab .count')]"
    assert recognised.says(f"{for_each}.filter(e => e.scrollWidth > e.clientWidth).length") == 0
    assert recognised.find("n-proposals").inner_text() == "99+"
    assert (
        recognised.find("tab-machine").get_attribute("title") == "103 events and 1 relation to decide about"
    )
    assert "103 events and 1 relation," in recognised.find("proposed").inner_text()
    assert recognised.find("group-machine/events").locator(".tl-count").inner_text() == "103"


def test_whoever_proposes_has_lanes_of_their_own_and_none_is_cut(recognised: Any) -> None:
    names = recognised.page.locator(".tl-gutter .tl-text").all_inner_texts()
    assert [name for name in names if name.startswith("ecat")] == ["ecat learn recognize", "ecat propose 4"]
    seen = recognised.says("document.querySelector('.tl-scroll').clientHeight")
    assert seen > 0
    assert seen % 22 == 0


@pytest.fixture
def compared(served: Any, window: Callable[..., Any]) -> Any:
    """Ann and Ben agree on one slide, and on little of another; only Ben saw a third."""
    ann = _event("a1", "slide_next", 10, 50, author="ann"), _event("a2", "slide_past", 60, 90, author="ann")
    ben = (
        _event("a1", "slide_next", 10, 50, author="ben"),
        _event("a2", "slide_past", 70, 95, author="ben"),
        _event("a3", "slide_away", 110, 130, author="ben"),
    )
    _add(served, Layer(name="ann", events=ann), Layer(name="ben", events=ben))
    made = window(served)
    made.page.evaluate("(sid) => { location.hash = `#/adjudicate/${sid}`; }", served.path.name)
    made.page.wait_for_selector('[data-testid="adjudicate-first"]')
    return made


def test_the_gold_layer_is_built_from_what_two_people_said(served: Any, compared: Any) -> None:
    compared.find("adjudicate-first").select_option("ann")
    compared.find("adjudicate-second").select_option("ben")
    compared.find("disagreement-1").wait_for()
    compared.until("app.activeLayer === 'gold'")
    compared.find("take-agreed").click()
    compared.settle()
    compared.find("disagreement-0").click()
    assert compared.says("app.cursor.frame") == 60
    compared.find("take-second").click()
    compared.settle()
    compared.find("take-second").click()
    compared.settle()
    gold = served.layer("gold")
    spans = sorted((e.type, e.segments[0].start_frame, e.segments[0].end_frame) for e in gold.events)
    assert spans == [("slide_away", 110, 130), ("slide_next", 10, 50), ("slide_past", 70, 95)]
    assert [e.id for e in served.session().layer("ann").events] == ["a1", "a2"]
    assert compared.complaints == []


def _cup(name: str, label: str, u: float) -> AnnotatedObject:
    keys = (KeyFrame(frame=5, coordinates=(u, 50, 100, 100)),)
    return AnnotatedObject(id=name, name=label, kind="rectangle", stream="color", key_frames=keys)


@pytest.fixture
def two_views(served: Any, window: Callable[..., Any]) -> Any:
    """Ann and Ben drew the same cup, called it differently and drew it not quite alike; only Ben saw a spoon."""
    holds = _event("a1", "slide_next", 10, 50, roles=(Role(name="Theme", target="o7"),))
    with open_session(served.path).write() as commit:
        commit.put_layer(Layer(name="ann", scheme="blocks", objects=(_cup("o1", "cup", 50),)))
        objects = (_cup("o7", "mug", 65), _cup("o8", "spoon", 400))
        commit.put_layer(Layer(name="ben", scheme="blocks", objects=objects, events=(holds,)))
    made = window(served)
    made.page.evaluate(
        "(sid) => { location.hash = `#/adjudicate/${sid}?first=ann&second=ben`; }", served.path.name
    )
    made.find("disagreement-2").wait_for()
    return made


def _decide(window: Any, words: str, verdict: str) -> None:
    window.page.locator('[data-testid^="disagreement-"]', has_text=words).first.click()
    window.find(f"take-{verdict}").click()
    window.settle()


def _gold(served: Any) -> dict[str, tuple[str, float]]:
    layer = served.layer("gold")
    return {thing.id: (thing.name, thing.key_frames[0].coordinates[0]) for thing in layer.objects}


def test_objects_that_differ_are_decided_about(served: Any, two_views: Any) -> None:
    assert (
        "differs in name, shape"
        in two_views.page.locator('[data-testid^="disagreement-"]', has_text="cup").inner_text()
    )
    _decide(two_views, "cup", "first")
    assert _gold(served) == {"o1": ("cup", 50)}
    _decide(two_views, "cup", "second")
    assert _gold(served) == {"o1": ("mug", 65)}
    _decide(two_views, "spoon", "second")
    _decide(two_views, "slide_next", "second")
    gold = served.layer("gold")
    assert {name: label for name, (label, _) in _gold(served).items()} == {"o1": "mug", "o8": "spoon"}
    assert [r.target for r in gold.events[0].roles] == ["o1"], "what Ben called o7 is the one that both mean"
    assert two_views.complaints == []


def test_both_views_of_an_object_or_none_can_be_taken(served: Any, two_views: Any) -> None:
    _decide(two_views, "cup", "both")
    assert sorted(_gold(served).values()) == [("cup", 50), ("mug", 65)]
    _decide(two_views, "cup", "first")
    assert list(_gold(served).values()) == [("cup", 50)]
    _decide(two_views, "cup", "neither")
    assert _gold(served) == {}


def test_objects_that_both_agree_on_are_taken_with_the_rest(served: Any, window: Callable[..., Any]) -> None:
    said = _event("a1", "slide_next", 10, 50, roles=(Role(name="Theme", target="o7"),))
    with open_session(served.path).write() as commit:
        commit.put_layer(Layer(name="ann", scheme="blocks", objects=(_cup("o1", "cup", 50),)))
        commit.put_layer(Layer(name="ben", scheme="blocks", objects=(_cup("o7", "cup", 51),), events=(said,)))
    page = window(served)
    page.page.evaluate(
        "(sid) => { location.hash = `#/adjudicate/${sid}?first=ann&second=ben`; }", served.path.name
    )
    page.find("disagreement-0").wait_for()
    page.find("take-agreed").click()
    page.settle()
    _decide(page, "slide_next", "second")
    assert _gold(served) == {"o1": ("cup", 50)}
    assert [r.target for r in served.layer("gold").events[0].roles] == ["o1"]


def _ecat(*arguments: str) -> None:
    subprocess.run([sys.executable, "-m", "ecat", *arguments], check=True, capture_output=True)


@pytest.fixture
def surveyed(served: Any) -> Callable[..., str]:
    """Make a survey of windows of the session."""

    def make(name: str, *options: str) -> str:
        n = served.session().manifest.n_frames
        folder: Path = served.server.folder
        _ecat(
            "survey",
            "new",
            str(folder),
            name,
            "--question",
            "What happens?",
            "--window",
            f"0,{n},{n}",
            *options,
        )
        return name

    return make


def test_a_survey_is_answered_with_keys_and_its_answers_are_on_the_disk(
    served: Any, surveyed: Callable[..., str], window: Callable[..., Any]
) -> None:
    name = surveyed(f"choice-{served.path.name[:2].strip('-')}", "--choice", "push", "--choice", "pull")
    page = window(served, author="dan")
    page.page.evaluate("(name) => { location.hash = `#/survey/${name}`; }", name)
    page.find("survey").wait_for()
    page.find("answer-push").wait_for()
    page.page.keyboard.press("2")
    page.page.wait_for_function(
        "() => document.querySelector('[data-testid=survey-progress]').textContent.includes('1 answered')"
    )
    page.find("survey-comment").fill("a bit late")
    answers = served.server.ask(f"/api/surveys/{name}?rater=dan")["answers"]
    assert [a["answer"] for a in answers.values()] == ["pull"]
    assert page.complaints == []


def test_a_score_is_given_with_a_comment(
    served: Any, surveyed: Callable[..., str], window: Callable[..., Any]
) -> None:
    name = surveyed(f"score-{served.path.name[:2].strip('-')}", "--score", "0-10")
    page = window(served, author="dan")
    page.page.evaluate("(name) => { location.hash = `#/survey/${name}`; }", name)
    page.find("answer-10").wait_for()
    page.find("survey-comment").fill("a bit late")
    page.find("answer-7").click()
    page.page.wait_for_function(
        "() => document.querySelector('[data-testid=survey-progress]').textContent.includes('1 answered')"
    )
    answers = served.server.ask(f"/api/surveys/{name}?rater=dan")["answers"]
    assert [(a["answer"], a["comment"]) for a in answers.values()] == [(7, "a bit late")]


def test_what_the_machine_tracked_takes_part_under_its_own_id(
    served: Any, window: Callable[..., Any]
) -> None:
    _add(served, Layer(name="machine"))
    page = window(served)
    page.page.evaluate("() => window.ecat.setActiveLayer('ben')")
    page.until("app.activeLayer === 'ben'")
    page.find("tab-objects").click()
    page.find("row-o2").click()
    for frame, key in ((20, "1"), (40, "2"), (60, "5")):
        page.at(frame)
        page.press(key)
    page.until("app.document.events.list.length === 3 && app.document.events.list[0].type !== ''")
    layer = served.layer("ben")
    assert [(o.id, o.name, o.kind) for o in layer.objects] == [("o2", "Shell", "marker_box")]
    whole = next(e for e in layer.events if e.parent is None)
    assert ("Theme", "o2") in {(role.name, role.target) for role in whole.roles}


def test_a_recording_that_nobody_filmed_is_shown_in_space(
    served: Any, surveyed: Callable[..., str], window: Callable[..., Any]
) -> None:
    name = surveyed(f"space-{served.path.name[:2].strip('-')}", "--choice", "push", "--choice", "pull")
    page = window(served, author="dan")
    page.page.evaluate("(name) => { location.hash = `#/survey/${name}`; }", name)
    page.find("survey-space").wait_for()
    canvas = page.find("survey-space").get_by_test_id("space-canvas")
    shots = {canvas.screenshot()}
    for _ in range(20):
        page.page.wait_for_timeout(300)
        shots.add(canvas.screenshot())
        if len(shots) > 2:  # the first one may be of before anything was there
            break
    assert len(shots) > 2, "it plays"
    page.page.keyboard.press("1")
    page.page.wait_for_function(
        "() => document.querySelector('[data-testid=survey-progress]').textContent.includes('1 answered')"
    )
    assert page.complaints == []
