"""Sub-events and types go out as links and actions, and come back from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.annotate.rules import MOST_DEPTH
from ecat.formats.ecat2018 import nesting
from ecat.formats.ecat2018.files_param_write import files_param
from ecat.model import Event, Layer, Link, Manifest, Segment, TextPredicate
from ecat.store.xml import layer_from_xml, layer_to_xml
from tests.formats.ecat2018.documents import BOM, document, event, read, trip, write

TYPES = ["grasp", "slide_next", "Slide", "go to", "", "(", "größe"]
TEXTS = ["", "Slide it next to the slide", "slide_next", "He grasps (", "grasp", "two\nlines of text\n"]


def exported(layer: Layer) -> tuple[bytes, list[str]]:
    """What a session of ecat's own becomes, and what is told about it."""
    findings: list[str] = []
    made = Manifest(name="Session1", created="2026-01-01T00:00:00+00:00", n_frames=500)
    layer = layer_from_xml(layer_to_xml(layer), name="main")
    return b"".join(files_param(made, layer, lambda _: None, findings)), findings


def actions(text: str) -> st.SearchStrategy[tuple[TextPredicate, ...]]:
    """Any actions of a text; not of all of it, which says a type."""
    spans = st.tuples(st.integers(0, len(text) - 1), st.integers(1, len(text))).filter(
        lambda span: span[0] < span[1] and span != (0, len(text))
    )
    made = st.builds(
        lambda span, kind: TextPredicate(start=span[0], end=span[1], type=kind), spans, st.sampled_from(TYPES)
    )
    return st.lists(made, max_size=3).map(tuple)


@st.composite
def trees(draw: st.DrawFn) -> tuple[Event, ...]:
    """Events in any order, each within the one that it is a part of; confirmed ones only."""
    events: list[Event] = []
    depths: list[int] = []
    for number in range(draw(st.integers(1, 8))):
        at = draw(st.integers(-1, number - 1))
        whole = events[at] if at >= 0 else None
        low, high = (
            (0, 400) if whole is None else (whole.segments[0].start_frame, whole.segments[0].end_frame)
        )
        start = draw(st.integers(low, high - 1))
        depths.append(0 if whole is None else depths[at] + 1)
        kind = draw(st.sampled_from(TYPES))
        events.append(
            Event(
                id=draw(st.sampled_from([f"a{number + 1}", f"part-{number}"])),
                type=kind,
                tier=["event", "sub-event", ""][min(depths[-1], 2)],
                parent=None if whole is None else whole.id,
                text=(text := draw(st.sampled_from(TEXTS))),
                predicates=draw(actions(text)) if kind and text else (),
                segments=(Segment(start_frame=start, end_frame=draw(st.integers(start + 1, high))),),
                links=tuple(
                    Link(type="CAUSE", target=events[i].id)
                    for i in draw(
                        st.sets(st.integers(0, number - 1), max_size=2) if number else st.just(set())
                    )
                ),
            )
        )
    return tuple(draw(st.permutations(events)))


def by_start(events: tuple[Event, ...]) -> list[tuple[object, ...]]:
    """What does not depend on ids; events in the order of the layer."""
    place = {event.id: i for i, event in enumerate(events)}
    return [
        (
            e.type,
            e.tier,
            "" if e.text == e.type else e.text,
            e.segments,
            None if e.parent is None else place[e.parent],
            [p for p in e.predicates if len(e.predicates) != 1 or p.type != e.type],
            [(link.type, place[link.target]) for link in e.links],
        )
        for e in events
    ]


@given(trees())
@settings(max_examples=200)
def test_any_tree_of_events_comes_back(events: tuple[Event, ...]) -> None:
    data, findings = exported(Layer(events=events))
    found = trip(data)
    assert findings == found.findings == []
    assert by_start(found.layer.events) == by_start(events)
    assert found.is_exact, "and goes out again as it was"


LINK = '        <linkTo id="{}" type="{}" />\n'.format


def linking(
    *targets: str, kind: str = "SUBEVENT(X,Y)", own: str = "a1", start: int = 1, end: int = 90
) -> str:
    """An event that links to others."""
    links = "".join(LINK(target, kind) for target in targets)
    return event(
        id=own,
        start=start,
        end=end,
        rest=f"      <refs />\n      <events />\n      <link>\n{links}      </link>\n",
    )


def parents(text: str) -> Mapping[str, str | None]:
    """What each event is a part of; the document comes back byte for byte."""
    found = trip(document(events=text))
    assert found.is_exact
    return {e.id: e.parent for e in found.layer.events}


class TestWhatStaysALink:
    """A link that can mean something else is left as it is."""

    def test_to_an_event_that_is_not_there(self) -> None:
        assert parents(linking("a9")) == {"a1": None}

    def test_of_another_type_or_form(self) -> None:
        for kind in ("CAUSE(X,Y)", "SUBEVENT", "SUBEVENT(Y,X)", "SUBEVENT(X)", "subevent(X,Y)"):
            assert parents(linking("a2", kind=kind) + event(id="a2", start=5, end=8))["a2"] is None, kind

    def test_to_an_event_that_goes_on_longer(self) -> None:
        assert parents(linking("a2", end=50) + event(id="a2", start=5, end=51))["a2"] is None
        assert parents(linking("a2", start=6) + event(id="a2", start=5, end=9))["a2"] is None

    def test_to_an_event_that_ends_before_it_starts(self) -> None:
        assert parents(linking("a2") + event(id="a2", start=9, end=5))["a2"] is None

    def test_to_a_part_of_two_events(self) -> None:
        found = parents(linking("a3") + linking("a3", own="a2") + event(id="a3", start=5, end=8))
        assert found == dict.fromkeys(("a1", "a2", "a3"))

    def test_to_one_of_two_events_of_the_same_id(self) -> None:
        found = parents(linking("a2") + event(id="a2") + event(id="a2", start=20, end=30))
        assert set(found.values()) == {None}

    def test_in_a_circle(self) -> None:
        circle = linking("a2") + linking("a3", own="a2") + linking("a1", own="a3")
        assert set(parents(circle).values()) == {None}
        assert parents(linking("a1")) == {"a1": None}

    def test_that_is_there_twice(self) -> None:
        assert parents(linking("a2", "a2") + event(id="a2"))["a2"] is None

    def test_deeper_than_may_be_edited(self) -> None:
        assert nesting.MOST_DEPTH == MOST_DEPTH
        n = MOST_DEPTH + 4
        chain = "".join(linking(f"a{i + 1}", own=f"a{i}") for i in range(1, n)) + event(id=f"a{n}", end=90)
        found = parents(chain)
        assert [name for name, parent in found.items() if parent is None] == [
            "a1",
            "a17",
            "a18",
            "a19",
            "a20",
        ]


def test_the_order_of_links_comes_back() -> None:
    links = "".join([LINK("a3", "SUBEVENT(X,Y)"), LINK("a9", "CAUSE"), LINK("a2", "SUBEVENT(X,Y)")])
    whole = event(end=90, rest=f"      <refs />\n      <events />\n      <link>\n{links}      </link>\n")
    found = trip(document(events=whole + event(id="a2") + event(id="a3")))
    assert found.is_exact
    assert [e.parent for e in found.layer.events] == [None, "a1", "a1"]
    assert [e.tier for e in found.layer.events] == ["event", "sub-event", "sub-event"]
    assert [link.target for link in found.layer.events[0].links] == ["a9"]


EDITS: list[tuple[Callable[[Event], Event], list[str], list[str]]] = [
    (lambda e: replace(e, parent=None), ['id="a2" type="SUBEVENT(X,Y)"'], []),
    (lambda e: replace(e, parent="a3"), ['id="a2" type="SUBEVENT(X,Y)"'], ['id="a2" type="SUBEVENT(X,Y)"']),
]


@pytest.mark.parametrize(("edit", "gone", "new"), EDITS)
def test_an_event_that_is_moved_elsewhere_is_linked_there_only(
    edit: Callable[[Event], Event], gone: list[str], new: list[str]
) -> None:
    source = trip(document(events=linking("a2", "a3") + event(id="a2") + event(id="a3")))
    first, second, third = source.layer.events
    back = write(source.manifest, replace(source.layer, events=(first, edit(second), third)), {}).decode()
    whole, _, rest = back.partition("</annotation>")
    assert all(line not in whole for line in gone)
    assert all(line in rest for line in new)
    assert rest.count("SUBEVENT") == len(new)
    assert 'id="a3" type="SUBEVENT(X,Y)"' in whole


def test_parts_that_are_not_confirmed_are_not_linked() -> None:
    data, findings = exported(Layer(events=(Event(id="a1"), Event(id="a2", parent="a1", status="proposed"))))
    assert b"SUBEVENT" not in data
    assert findings == ["event a2: a proposal; left out until it is confirmed"]


def test_a_part_without_an_id_of_its_own_in_the_file_is_told() -> None:
    source = trip(document(events=event() + event(id="a2") + event(id="a2")))
    first, second, third = source.layer.events
    layer = replace(source.layer, events=(first, second, replace(third, parent="a1")))
    findings: list[str] = []
    data = b"".join(files_param(source.manifest, layer, lambda _: None, findings))
    assert b"SUBEVENT" not in data
    assert findings == [
        "event a2~2: not the only one of its id in the file; that it is a part of a1 was left out",
        "event a2~2: ECAT has no tiers; left out",
    ]


# ---------------------------------------------------------------------------------------------- types


def action(start: int, end: int, kind: str) -> str:
    """The lists of an event with one action."""
    line = f'<event start="{start}" end="{end}" semanticType="{kind}" />'
    return f"      <refs />\n      <events>\n        {line}\n      </events>\n      <link />\n"


class TestTypes:
    def test_the_word_of_the_text_that_is_the_type_is_the_action(self) -> None:
        data, _ = exported(Layer(events=(Event(id="a1", type="slide", text="unslide it, Slide it"),)))
        assert b'<event start="12" end="17" semanticType="slide" />' in data

    def test_a_type_without_a_text_is_its_text(self) -> None:
        data, _ = exported(Layer(events=(Event(id="a1", type="grasp"),)))
        assert b"<text>grasp</text>" in data
        assert b'<event start="0" end="5" semanticType="grasp" />' in data
        (back,) = trip(data).layer.events
        assert (back.type, back.text, back.predicates) == ("grasp", "", ())

    @pytest.mark.parametrize("actions", [(), (TextPredicate(start=0, end=5, type="Slide"),)])
    def test_a_type_that_the_text_does_not_name_is_the_last_action_and_all_of_it(
        self, actions: tuple[TextPredicate, ...]
    ) -> None:
        one = Event(id="a1", type="slide_next", text="Slide it", predicates=actions)
        data, findings = exported(Layer(events=(one,)))
        assert b'<event start="0" end="8" semanticType="slide_next" />\n      </events>' in data
        (back,) = trip(data).layer.events
        assert (back.type, back.text, back.predicates) == (one.type, one.text, one.predicates)
        assert findings == []

    def test_the_only_action_of_a_file_is_the_type(self) -> None:
        found = trip(document(events=event("pour it in", rest=action(0, 4, "pour"))))
        (back,) = found.layer.events
        assert (back.type, back.text) == ("pour", "pour it in")
        assert found.is_exact

    def test_of_two_actions_none_is_the_type(self) -> None:
        one = '<event start="0" end="4" semanticType="pour" />'
        rest = action(0, 4, "pour").replace(one, f"{one}\n        {one}")
        found = trip(document(events=event("pour it in", rest=rest)))
        assert found.layer.events[0].type == ""
        assert found.is_exact

    @pytest.mark.parametrize(
        ("text", "start", "end", "kind"),
        [
            ("pour", 0, 4, "pour"),
            ("pour", 1, 4, "our"),
            ("pour it", 0, 7, "pour"),
            ("", 0, 0, "x"),
            ("p", 5, 9, ""),
        ],
    )
    def test_any_action_comes_back_byte_for_byte(self, text: str, start: int, end: int, kind: str) -> None:
        assert trip(document(events=event(text, rest=action(start, end, kind)))).is_exact


def test_real_kinds_of_files_have_no_types_and_no_tree() -> None:
    found = read(BOM + document(events=event() + event(id="a2", start=3, end=5)).encode())
    assert [(e.type, e.parent, e.tier) for e in found.layer.events] == [("", None, "event")] * 2
