"""What is found to name something that does not exist."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from ecat.check import examine
from ecat.model import AnnotatedObject, Link, Role, TextPredicate, TextReference
from ecat.model.annotation import Argument, Decision

if TYPE_CHECKING:
    from conftest import Case


def codes(case: Case) -> list[str]:
    return [finding.code for finding in examine(case.patient)]


THEME = Role(name="theme", target="o1")


@pytest.mark.parametrize(
    ("fields", "what"),
    [
        ({"parent": "a9"}, "its parent a9 does not exist"),
        ({"links": (Link(type="CAUSE", target="a9"),)}, "event a9 of its CAUSE link does not exist"),
        ({"roles": (Role(name="theme", target="o9"),)}, "object o9 in its role theme does not exist"),
        (
            {"roles": (THEME, Role(name="hand", target="o9/HandLeft", kind="joint"))},
            "joint o9/HandLeft in its role hand does not exist",
        ),
        (
            {"roles": (THEME, Role(name="hand", target="o1", kind="event"))},
            "event o1 in its role hand does not exist",
        ),
        (
            {"references": (TextReference(start=0, end=5, target="o9"),)},
            "object o9, referred to by its text, does not exist",
        ),
    ],
)
def test_events_that_name_what_does_not_exist(case: Case, fields: dict[str, Any], what: str) -> None:
    case.change_event(0, **fields)
    (finding,) = examine(case.patient)
    assert (finding.code, finding.severity) == ("dangling-reference", "error")
    assert (finding.place, finding.message) == ("layer main, event a1", what)


@pytest.mark.parametrize(("start", "end"), [(-1, 3), (3, 3), (5, 2), (0, 23)])
@pytest.mark.parametrize("kind", ["references", "predicates"])
def test_spans_outside_of_the_text(case: Case, kind: str, start: int, end: int) -> None:
    span = TextReference(start=start, end=end, target="o1")
    if kind == "predicates":
        span = TextPredicate(start=start, end=end, type="slide")
    case.change_event(0, **{kind: (span,)})
    (finding,) = examine(case.patient)
    assert finding.code == "bad-span"
    assert finding.message == f"characters {start} to {end} are marked in a text of 22"


def test_an_argument_that_does_not_exist(case: Case) -> None:
    case.change_relation(2, arguments=(Argument(target="o9"),))
    (finding,) = examine(case.patient)
    assert (finding.place, finding.message) == (
        "layer main, relation 2 (STAND)",
        "its argument o9 does not exist",
    )


@pytest.mark.parametrize(
    ("target", "what"),
    [
        ("Other/o8", "its argument Other/o8: session Other has no object o8"),
        ("Gone/o7", "its argument Gone/o7: the project has no session Gone"),
    ],
)
def test_an_argument_in_another_session_that_does_not_exist(case: Case, target: str, what: str) -> None:
    case.change_relation(1, arguments=(Argument(target="o4"), Argument(target=target)))
    (finding,) = examine(case.patient)
    assert (finding.severity, finding.code, finding.message) == (
        "warning",
        "dangling-session-reference",
        what,
    )


def test_an_id_that_occurs_twice(case: Case) -> None:
    case.layer = replace(case.layer, objects=(*case.layer.objects, AnnotatedObject(id="o1", name="again")))
    (finding,) = examine(case.patient)
    assert (finding.code, finding.message) == ("duplicate-id", "object ids that occur more than once: o1")


def test_a_decision_whose_result_is_not_there(case: Case) -> None:
    accepted = Decision(proposal="machine/a1", verdict="accepted", result="a9")
    case.layer = replace(
        case.layer, decisions=(accepted, Decision(proposal="machine/a2", verdict="rejected"))
    )
    (finding,) = examine(case.patient)
    assert finding.place == "layer main, decision about machine/a1"
    assert finding.message == "a9, which was made of it, does not exist"


def test_events_that_are_parts_of_each_other(case: Case) -> None:
    case.change_event(0, parent="a2", segments=())
    (finding,) = examine(case.patient)
    assert finding.code == "parent-cycle"


def test_marks_of_an_object_that_nobody_annotated(case: Case) -> None:
    def rename(columns: dict[str, Any]) -> None:
        columns["object_id"] = ["o9" if name == "o2" else name for name in columns["object_id"]]

    case.change("poses", rename)
    (finding,) = examine(case.patient)
    assert (finding.place, finding.message) == ("table poses", "object o9 does not exist")


def test_cameras_that_do_not_exist(case: Case) -> None:
    case.manifest = replace(case.manifest, cameras=case.manifest.cameras[:1])
    assert sorted(f.place for f in examine(case.patient)) == ["camera color", "stream depth"]


def test_an_object_on_a_video_that_the_session_does_not_have(case: Case) -> None:
    objects = (replace(case.layer.objects[0], stream="movie.avi"), *case.layer.objects[1:])
    case.layer = replace(case.layer, objects=objects)
    assert codes(case) == ["dangling-stream"]
