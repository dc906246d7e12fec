"""Any session is written so that it reads again as it was; what ECAT cannot express is told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import isnan, nan
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.formats.ecat2018.files_param_write import files_param
from ecat.model import (
    AnnotatedObject,
    Event,
    KeyFrame,
    Layer,
    Link,
    Manifest,
    Property,
    Relation,
    Role,
    Segment,
    Stream,
    TextPredicate,
    TextReference,
)
from ecat.model.annotation import Argument, ObjectKind
from tests.formats.ecat2018.documents import (
    BOM,
    Trip,
    box,
    box_marker,
    document,
    event,
    face,
    location,
    markers,
    obj,
    predicate,
    trip,
)

# ---------------------------------------------------------------------------------------------- from elsewhere


def exported(layer: Layer, **manifest: Any) -> tuple[str, list[str]]:
    """What a session that was not imported becomes, and what is told about it."""
    findings: list[str] = []
    made = Manifest(name="Session1", created="2026-01-01T00:00:00+00:00", **manifest)
    data = b"".join(files_param(made, layer, lambda _: None, findings))
    assert data.startswith(BOM)
    return data.removeprefix(BOM).decode(), findings


def test_a_session_that_was_not_imported_is_written_as_ecat_would() -> None:
    layer = Layer(
        object_counter=2,
        objects=(
            AnnotatedObject(
                id="o1",
                name="cup",
                kind="rectangle",
                stream="color",
                key_frames=(KeyFrame(frame=0, coordinates=(1, 2, 3, 4)),),
            ),
        ),
        events=(Event(id="a1", text="pour", segments=(Segment(start_frame=0, end_frame=9),)),),
        relations=(Relation(predicate="STAND", start_frame=4, arguments=(Argument(target="o1"),)),),
    )
    streams = (Stream(name="color", kind="color", file="media/a.avi", present=True),)
    text, findings = exported(layer, n_frames=100, streams=streams)
    expected = document(
        files="    <file>a.avi</file>\n",
        objects=obj(markers(location(1))),
        events=event(),
        predicates=predicate(5, "o1", "STAND(X)"),
    ).replace('no="5"', 'no="2"')
    expected = expected.replace("<annotations>", '<annotations no="1">')
    assert text == expected
    assert findings == []


def told(layer: Layer) -> str:
    _, findings = exported(layer)
    assert len(findings) == 1
    return findings[0]


class TestWhatEcatCannotExpressIsTold:
    def test_points(self) -> None:
        assert told(Layer(objects=(AnnotatedObject(id="o1", kind="point"),))) == (
            "object o1: ECAT has no objects of the kind 'point'; left out"
        )

    def test_proposals(self) -> None:
        assert told(Layer(events=(Event(id="a1", status="proposed"),))).startswith("event a1: a proposal")
        relation = Relation(
            predicate="ON", start_frame=0, status="proposed", arguments=(Argument(target="a"),)
        )
        assert told(Layer(relations=(relation,))).startswith("relation ON('a',): a proposal")

    def test_roles(self) -> None:
        assert told(Layer(events=(Event(id="a1", roles=(Role(name="agent", target="o1"),)),))) == (
            "event a1: ECAT has no roles; left out"
        )

    def test_several_segments_become_the_span_over_all(self) -> None:
        segments = (Segment(start_frame=20, end_frame=30), Segment(start_frame=3, end_frame=9))
        text, findings = exported(Layer(events=(Event(id="a1", segments=segments),)))
        assert findings == ["event a1: ECAT has one span per event; 2 segments became the span over all"]
        assert '<duration startFrame="4" endFrame="30" />' in text

    def test_relations_of_many_arguments(self) -> None:
        arguments = tuple(Argument(target=i) for i in "abc")
        assert "3 arguments; left out" in told(
            Layer(relations=(Relation(predicate="GIVE", start_frame=0, arguments=arguments),))
        )

    @pytest.mark.parametrize(
        ("said", "what"),
        [
            ({"unsure": True}, "doubts"),
            ({"properties": (Property("adjunct", "slowly"),)}, "properties of events"),
            ({"tier": "left hand"}, "tiers"),
        ],
    )
    def test_what_else_is_said_of_events(self, said: dict[str, Any], what: str) -> None:
        assert told(Layer(events=(Event(id="a1", **said),))) == f"event a1: ECAT has no {what}; left out"

    def test_an_action_without_a_type(self) -> None:
        event = Event(id="a1", text="push it", predicates=(TextPredicate(start=0, end=4, type="push"),))
        assert told(Layer(events=(event,))) == "event a1: ECAT has no types, but the action that a text names"

    def test_many_events_are_one_line(self) -> None:
        events = tuple(Event(id=f"a{i}", unsure=True) for i in range(1, 6))
        assert told(Layer(events=events)) == "events a1, a2, a3 and 2 more: ECAT has no doubts; left out"

    def test_shapes_that_hold(self) -> None:
        thing = AnnotatedObject(id="o1", kind="rectangle", interpolation="hold")
        assert "that its shape holds is left out" in told(Layer(objects=(thing,)))

    @pytest.mark.parametrize("name", ["my size", "1st", "xmlns", "", "id", "größe", "a:b", "a=b"])
    def test_properties_that_cannot_be_attributes(self, name: str) -> None:
        # ECAT wrote them, and could not read the file again (§4.1)
        properties = (Property(name, "7"), Property("size", "big"))
        text, findings = exported(
            Layer(objects=(AnnotatedObject(id="o1", kind="rectangle", properties=properties),))
        )
        assert ' size="big"' in text
        assert findings == [f"object o1: the property {name!r} cannot be an attribute of an object; left out"]


def test_ids_are_numbers_as_ecat_gives_them() -> None:
    layer = Layer(
        object_counter=2,
        objects=(AnnotatedObject(id="o2", kind="rectangle"), AnnotatedObject(id="cup", kind="rectangle")),
        events=(
            Event(id="pour", text="cup", references=(TextReference(start=0, end=3, target="cup"),)),
            Event(id="a7", parent="pour", links=(Link(type="CAUSE", target="pour"),)),
        ),
        relations=(
            Relation(
                predicate="ON", start_frame=0, arguments=(Argument(target="cup"), Argument(target="s/cup"))
            ),
        ),
    )
    text, findings = exported(layer)
    assert findings == []
    assert '<objects no="3">' in text
    assert '<annotations no="8">' in text
    assert '<object id="o3"' in text
    assert '<annotation id="a8">' in text
    assert 'refTo="o3"' in text
    assert '<linkTo id="a7" type="SUBEVENT(X,Y)" />' in text
    assert '<linkTo id="a8" type="CAUSE(X,Y)" />' in text
    assert 'ids="o3,s/cup"' in text


def test_an_end_of_a_relation_is_its_denial() -> None:
    relation = Relation(predicate="STAND", start_frame=0, end_frame=8, arguments=(Argument(target="o1"),))
    text, _ = exported(Layer(relations=(relation,)))
    assert predicate(1, "o1", "STAND(X)") + predicate(9, "o1", "STAND(X)", "False") in text


# ---------------------------------------------------------------------------------------------- any session

NAMES = st.text(st.characters(codec="utf-8", exclude_categories=["Cs", "Cc", "Cn"]), max_size=8)
TEXTS = st.text(
    st.one_of(
        st.sampled_from("\n\t<>&\"' "), st.characters(codec="utf-8", exclude_categories=["Cs", "Cc", "Cn"])
    ),
    max_size=12,
)
FRAMES = st.integers(-1, 500)
NUMBERS = st.floats(-1e4, 1e4, width=32).map(lambda x: float(f"{x:.7g}") + 0.0)


DRAWN: tuple[ObjectKind, ObjectKind] = ("rectangle", "polygon")
DEPTHS = st.integers(500, 4500).map(lambda z: z / 1000)  # nothing is at the sensor: 0, 0, 0 means missing
RECTANGLES = st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS)
POINTS_3D = st.tuples(NUMBERS, NUMBERS, DEPTHS, NUMBERS, NUMBERS, DEPTHS)


def key_frames(
    shapes: st.SearchStrategy[tuple[float, ...] | None],
) -> st.SearchStrategy[tuple[KeyFrame, ...]]:
    """In the order of their frames; without a shape, an absence."""
    return st.dictionaries(FRAMES, shapes, max_size=4).map(
        lambda found: tuple(
            KeyFrame(frame=frame, present=shape is not None, coordinates=shape or ())
            for frame, shape in sorted(found.items(), key=lambda item: item[0])
        )
    )


@st.composite
def layers(draw: st.DrawFn) -> Layer:
    n_objects, n_events = draw(st.integers(0, 3)), draw(st.integers(0, 3))
    objects = tuple(
        AnnotatedObject(
            id=f"o{i}",
            name=draw(NAMES),
            kind=DRAWN[draw(st.integers(0, 1))],
            origin=draw(st.sampled_from(["manual", "tracked", "provided"])),
            dimensions=draw(st.sampled_from([2, 3])),
            semantic_type=draw(NAMES),
            color=f"#{draw(st.integers(0, 2**32 - 1)):08x}",
            line_width=draw(st.integers(1, 10)),
            key_frames=draw(key_frames(st.none() | RECTANGLES)),
            key_frames_3d=draw(key_frames(POINTS_3D)),
        )
        for i in range(n_objects)
    )
    ids = st.sampled_from(["o0", "o1", "other/o7"])
    events = tuple(
        Event(
            id=f"a{i}",
            tier="event",
            text=draw(TEXTS),
            segments=tuple(
                Segment(start_frame=a, end_frame=a + draw(st.integers(0, 50))) for a in [draw(FRAMES)]
            ),
            references=tuple(
                TextReference(start=a, end=a + 2, target=draw(ids))
                for a in draw(st.lists(st.integers(0, 9), max_size=2))
            ),
            predicates=tuple(
                TextPredicate(start=1, end=4, type=t)
                for t in draw(st.lists(NAMES, min_size=2, max_size=2) | st.just([]))
            ),
            links=tuple(
                Link(type=t, target="a0")
                for t in draw(st.lists(st.sampled_from(["CAUSE", "ENABLE"]), max_size=2))
            ),
        )
        for i in range(n_events)
    )
    relations = tuple(
        Relation(
            predicate=draw(st.sampled_from(["ON", "STAND"])),
            start_frame=draw(FRAMES),
            polarity=draw(st.booleans()),
            arguments=tuple(Argument(target=t) for t in draw(st.lists(ids, min_size=1, max_size=2))),
        )
        for _ in range(draw(st.integers(0, 3)))
    )
    return Layer(
        objects=objects,
        events=events,
        relations=relations,
        object_counter=n_objects,
        scheme="ecat-2018",
        event_counter=draw(st.integers(0, 9)),
    )


def same_facts(first: Layer, second: Layer) -> bool:
    """Equal but for how the file said it."""
    strip: Callable[[Layer], Layer] = lambda layer: replace(layer, event_counter=0)  # noqa: E731
    return repr(strip(first)) == repr(strip(second))


@given(layers())
@settings(max_examples=60)
def test_any_session_is_read_again_as_it_was(layer: Layer) -> None:
    text, findings = exported(layer, n_frames=100)
    found: Trip = trip(text)
    assert same_facts(found.layer, layer)
    assert found.is_exact
    assert findings == found.findings == []


FACES = st.lists(
    st.tuples(
        st.lists(st.integers(-2000, 2000), min_size=8, max_size=8),
        st.lists(st.one_of(st.just(nan), NUMBERS.filter(bool)), min_size=4, max_size=4),
        st.text("01", min_size=25, max_size=25),
    ),
    min_size=1,
    max_size=3,
)


@given(st.dictionaries(st.integers(0, 500), FACES, max_size=4))
@settings(max_examples=60)
def test_any_marks_come_back(found: dict[int, list[tuple[list[int], list[float], str]]]) -> None:
    two = three = ""
    for frame, faces in sorted(found.items()):
        codes = [" ,".join(code) + " " for _, _, code in faces]
        two += box_marker(
            frame, *(face(",".join(map(str, c)), code) for (c, _, _), code in zip(faces, codes, strict=True))
        )
        texts = [
            ",".join("-∞,-∞,-∞" if isnan(x) else f"{x:.7g},{x:.7g},1".replace("e", "E") for x in xs)
            for _, xs, _ in faces
        ]
        three += box_marker(
            frame, *(face(t, code) for t, code in zip(texts, codes, strict=True)), dimensions=3
        )
    assert trip(document(objects=box(two, three) if found else "")).is_exact
