"""What is recognised becomes proposals in the machine's layer beside those of others; only its own are replaced."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from ecat.annotate.queries import proposals
from ecat.check import check
from ecat.errors import UsageError
from ecat.model import Event, Layer, Relation
from ecat.model.annotation import MACHINE, Argument, Decision
from ecat.process import process_session
from ecat.store import Session, open_session
from learn.features.recordings import Recording, read_session
from learn.recognize.predict import Action
from learn.recognize.proposals import AUTHOR, Replaced, events_of, replace_proposals
from tests.learn.features import sessions
from tests.learn.features.sessions import SHELL, STELLA

PUSH = Action(40, 60, ("Performer", "Object_1", None, "push", None), 0.7)
PAST = Action(60, 90, ("Performer", "Object_1", "Object_2", "push", "Past"), 0.912)
ARRIVES = replace(PAST, start=40, before=PUSH)
ROLL = Action(100, 164, ("Object_2", None, "Object_1", "roll", "From"), 0.5)


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return sessions.make(tmp_path / "slide", sessions.draft(), process=False)


def events(session: Session, *actions: Action) -> tuple[Event, ...]:
    return events_of(session, read_session(session), actions)


def mine(session: Session) -> list[Event]:
    return [event for event in session.layer(MACHINE).events if event.author == AUTHOR]


def counts(found: Replaced) -> tuple[int, int, int]:
    return found.added, found.removed, found.kept


def test_an_event_says_who_does_what_to_what_where_and_how_sure_that_is(session: Session) -> None:
    push, past, roll = events(session, PUSH, PAST, ROLL)
    assert (push.type, push.text) == ("push", "Performer 1 pushes Shell")
    assert (past.type, past.text) == ("push_past", "Performer 1 pushes Shell past Stella Artois")
    assert (roll.type, roll.text) == ("roll_from", "Stella Artois rolls away from Shell")
    assert {role.name: role.target for role in past.roles} == {
        "Subject": "o1",
        "Object": SHELL,
        "Locative": STELLA,
    }
    assert {role.name: role.target for role in roll.roles} == {"Subject": STELLA, "Locative": SHELL}
    assert {one.name: one.value for one in past.properties} == {"confidence": "0.91", "preposition": "Past"}
    assert [past.text[r.start : r.end] for r in past.references] == ["Performer 1", "Shell", "Stella Artois"]
    assert all(event.status == "proposed" and event.tier == "event" for event in (push, past, roll))
    (segment,) = roll.segments
    assert (segment.start_frame, segment.end_frame) == (100, 164)
    assert segment.start_ns is not None
    assert segment.end_ns is not None
    assert segment.end_ns - segment.start_ns == pytest.approx(64e9 / 30, rel=0.02)


def test_what_an_action_is_before_it_has_a_locative_is_a_part_of_its_proposal(session: Session) -> None:
    assert counts(replace_proposals(session, AUTHOR, events(session, ROLL, ARRIVES))) == (2, 0, 0)
    roll, past, push = mine(session)
    assert (roll.tier, past.tier, push.tier) == ("event", "event", "sub-event")
    assert (roll.parent, past.parent, push.parent) == (None, None, past.id)
    assert len({roll.id, past.id, push.id}) == 3
    assert (push.type, push.text) == ("push", "Performer 1 pushes Shell")
    spans = [(one.segments[0].start_frame, one.segments[0].end_frame) for one in (past, push)]
    assert spans == [(40, 90), (40, 60)]
    listed = [row["what"] for row in proposals(open_session(session.path), "main")]
    assert listed == [roll.text, past.text]
    assert [finding for finding in check(session.path) if finding.severity != "note"] == []


@pytest.mark.parametrize("decided", [0, 1])
def test_a_proposal_and_its_part_are_replaced_or_stay_together(session: Session, decided: int) -> None:
    replace_proposals(session, AUTHOR, events(session, ARRIVES))
    assert counts(replace_proposals(session, AUTHOR, events(session, ARRIVES, ROLL))) == (2, 1, 0)
    there = mine(session)
    rejected = Decision(proposal=f"{MACHINE}/{there[decided].id}", verdict="rejected", author="ann")
    with session.write() as commit:
        commit.put_layer(replace(session.layer("main"), decisions=(rejected,)))
    later = replace(ARRIVES, end=ARRIVES.end + 3, before=replace(PUSH, end=PUSH.end + 5))
    assert counts(replace_proposals(session, AUTHOR, events(session, later))) == (0, 1, 1)
    assert mine(session) == there[:2]


def test_proposals_are_listed_for_people_and_the_session_stays_whole(session: Session) -> None:
    assert counts(replace_proposals(session, AUTHOR, events(session, PUSH, PAST))) == (2, 0, 0)
    rows = proposals(open_session(session.path), "main")
    assert [(row["what"], row["frames"], row["confidence"]) for row in rows] == [
        ("Performer 1 pushes Shell", "40:60", "0.70"),
        ("Performer 1 pushes Shell past Stella Artois", "60:90", "0.91"),
    ]
    published = open_session(session.path).events.to_arrow().to_pylist()
    assert sum(row["layer"] == MACHINE for row in published) == 2
    assert [finding for finding in check(session.path) if finding.severity != "note"] == []


def test_a_second_call_replaces_the_first_with_new_names(session: Session) -> None:
    replace_proposals(session, AUTHOR, events(session, PUSH, PAST))
    before = {event.id for event in mine(session)}
    assert counts(replace_proposals(session, AUTHOR, events(session, ROLL))) == (1, 2, 0)
    (left,) = mine(session)
    assert left.type == "roll_from"
    assert left.id not in before
    assert counts(replace_proposals(session, AUTHOR)) == (0, 1, 0)
    assert mine(session) == []


def test_another_layer_may_be_named_but_not_a_persons(session: Session) -> None:
    assert replace_proposals(session, AUTHOR, events(session, PUSH), layer="second").added == 1
    assert [event.text for event in session.layer("second").events] == ["Performer 1 pushes Shell"]
    with pytest.raises(UsageError, match="main"):
        replace_proposals(session, AUTHOR, events(session, PUSH), layer="main")
    assert all(event.author != AUTHOR for event in session.layer("main").events)


@pytest.mark.parametrize("what", ["objects", "decisions", "events", "nothing, but by that name"])
def test_a_layer_is_a_persons_whatever_there_is_in_it(session: Session, what: str) -> None:
    main = session.layer("main")
    drawn = tuple(thing for thing in main.objects if thing.key_frames or thing.key_frames_3d)
    assert drawn
    decided = (Decision(proposal=f"{MACHINE}/a1", verdict="accepted", author="ann"),)
    unsigned = tuple(replace(event, id=f"a{i}") for i, event in enumerate(events(session, PUSH), 1))
    theirs = {
        "objects": Layer(name="ann", objects=drawn),
        "decisions": Layer(name="ann", decisions=decided),
        "events": Layer(name="ann", events=tuple(replace(event, author="") for event in unsigned)),
    }.get(what, Layer(name="main"))
    with session.write() as commit:
        commit.put_layer(theirs)
    with pytest.raises(UsageError, match="person"):
        replace_proposals(session, AUTHOR, events(session, PUSH), layer=theirs.name)
    session.refresh()
    assert session.layer(theirs.name) == theirs


def test_nothing_to_change_changes_nothing(session: Session) -> None:
    revision = session.manifest.revision
    assert counts(replace_proposals(session, AUTHOR)) == (0, 0, 0)
    assert open_session(session.path).manifest.revision == revision


def test_what_others_proposed_and_what_people_said_stays(session: Session) -> None:
    process_session(session.path)
    session.refresh()
    theirs, people = session.layer(MACHINE), session.layer("main")
    assert theirs.events
    replace_proposals(session, AUTHOR, events(session, PUSH, PAST))
    now = session.layer(MACHINE)
    assert [event for event in now.events if event.author != AUTHOR] == list(theirs.events)
    assert now.relations == theirs.relations
    assert session.layer("main") == people
    replace_proposals(session, AUTHOR)
    assert session.layer(MACHINE).events == theirs.events


@pytest.mark.parametrize(("shift", "added"), [(1, 0), (40, 1)])
def test_what_was_decided_is_not_proposed_again_some_frames_beside(
    session: Session, shift: int, added: int
) -> None:
    replace_proposals(session, AUTHOR, events(session, PUSH))
    rejected = Decision(proposal=f"{MACHINE}/{mine(session)[0].id}", verdict="rejected", author="ann")
    with session.write() as commit:
        commit.put_layer(replace(session.layer("main"), decisions=(rejected,)))
    moved = replace(PUSH, start=PUSH.start + shift, end=PUSH.end + shift)
    assert counts(replace_proposals(session, AUTHOR, events(session, moved))) == (added, 0, 1)


def test_what_people_decided_about_stays_and_is_not_proposed_again(session: Session) -> None:
    replace_proposals(session, AUTHOR, events(session, PUSH, PAST))
    first, second = mine(session)
    rejected = Decision(proposal=f"{MACHINE}/{first.id}", verdict="rejected", author="ann")
    with session.write() as commit:
        commit.put_layer(replace(session.layer("main"), decisions=(rejected,)))
    found = replace_proposals(session, AUTHOR, events(session, PUSH, ROLL))
    assert counts(found) == (1, 1, 1)
    assert mine(session)[0].id == first.id
    assert second.id not in {event.id for event in mine(session)}
    row = next(row for row in proposals(session, "main") if row["proposal"] == f"{MACHINE}/{first.id}")
    assert row["decision"] == "rejected"


def test_a_performer_whom_nobody_annotated_is_made(tmp_path: Path) -> None:
    draft = sessions.without_people(sessions.without(sessions.draft(), "joints"))
    session = sessions.make(tmp_path / "s", draft, process=False)
    replace_proposals(session, AUTHOR, events(session, PUSH))
    assert {thing.id: thing.kind for thing in session.layer(MACHINE).objects} == {
        SHELL: "marker_box",
        "performer": "rig",
    }


def test_relations_of_one_author_are_replaced_apart_from_those_of_another(session: Session) -> None:
    def relation(predicate: str) -> Relation:
        targets = (Argument(target=SHELL), Argument(target=STELLA))
        return Relation(
            predicate=predicate,
            start_frame=0,
            end_frame=9,
            source="computed",
            status="proposed",
            arguments=targets,
        )

    assert replace_proposals(session, "a", relations=[relation("cardir=n")]).added == 1
    assert replace_proposals(session, "b", relations=[relation("mos=m")]).added == 1
    assert counts(replace_proposals(session, "a", relations=[relation("cardir=s")])) == (1, 1, 0)
    layer = session.layer(MACHINE)
    assert {(one.author, one.predicate) for one in layer.relations} == {("b", "mos=m"), ("a", "cardir=s")}
    assert len({one.id for one in layer.relations}) == 2
    assert {thing.id for thing in layer.objects} == {SHELL, STELLA}


def test_recordings_say_which_objects_they_are_of(session: Session) -> None:
    found: Recording = read_session(session, (STELLA, SHELL))
    (push,) = events_of(session, found, [PUSH])
    assert push.text == "Performer 1 pushes Stella Artois"
