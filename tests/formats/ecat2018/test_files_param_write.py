"""What was imported comes back byte for byte, and after an edit only what was edited differs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import isnan, nan
from typing import Any

import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.formats.ecat2018.files_param_write import files_param
from ecat.model import (
    AnnotatedObject,
    Clock,
    Event,
    KeyFrame,
    Layer,
    Link,
    Manifest,
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
    CODE,
    POINTS,
    RECTANGLE,
    STANDARD,
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
    write,
)

RIG = (
    '    <object id="o1" name="Performer 1" filename="C:\\Users\\X\\rgb.avi" objectType="3D" generate="PROVIDED" '
    'color="-16744448" borderSize="1" semanticType="bodyRig" shape="Annotator.RigObject" rigIndex="3" '
    'source="rig.xml" sourceScheme="bodyScheme.xml" />\n'
)
LINKS = (
    '      <links>\n        <link frame="38">\n          <linkTo id="o2" q="False" type="LOOK_AT" />\n'
    '          <linkTo otherSession="0009" id="o7" q="True" type="IDENTITY" />\n        </link>\n'
    '        <link frame="38">\n          <linkTo q="True" type="SIT(X)" />\n        </link>\n'
    '        <link frame="50" />\n      </links>\n'
)
SPATIAL = (
    '      <spatialLink frame="3">\n        <linkTo id="o2" q="True" type="ON" />\n      </spatialLink>\n'
    '      <spatialLink frame="9">\n        <linkTo id="o3" q="true" type="IN" />\n      </spatialLink>\n'
)
DELETE = '<marker type="DELETE" frame="{}" />'.format
FLAT = f"      {location(1)}\n      {location(2)}\n"
POLYGON_3D = markers(location(3, "1,2,3,4,5,6")) + markers(
    '<marker frame="3">1,2,3,-∞,-∞,-∞,0.5,0,2</marker>', tag="markers3d"
)
LISTS = (
    '      <refs>\n        <ref start="0" end="4" refTo="o2" />\n      </refs>\n'
    '      <events>\n        <event start="5" end="9" semanticType="pour" />\n      </events>\n'
    '      <link>\n        <linkTo id="a2" type="SUBEVENT(X,Y)" />\n'
    '        <linkTo id="a3" type="CAUSE" />\n      </link>\n'
)


def predicates(*lines: str) -> str:
    return document(predicates="".join(lines))


GENERATIONS = {
    "nothing but empty sections": document(),
    "an empty list of predicates": document(predicates=""),
    "a counter of events (2018-07)": document(annotations='annotations no="7"', events=event()),
    "no counter of objects": document().replace(' no="5"', ""),
    "a recording": document(
        head='name="Session1" length="9" duration="300" startWriteRGB="2017-10-04T22:35:30.583746Z"'
    ),
    "a duration of 0": document(head='name="Session1" length="9" duration="0"'),
    "a start that is none": document(head='name="Session1" length="9" startWriteRGB=""'),
    "no length": document(head='name="Session1"'),
    "no name": document(head='length="9"'),
    "another name than the folder's": document(head='name="Old name" length="9"'),
    "a length with zeros": document(head='name="Session1" length="009"'),
    "a length that is no number": document(head='name="Session1" length="?"'),
    "session attributes in another order, and unknown ones": document(
        head='length="9" x="1" name="Session1"'
    ),
    "unknown attributes of sections": document().replace("<annotations", '<annotations no="3" y="2"'),
    "files": document(files="    <file>a.avi</file>\n    <file>C:\\Users\\x\\b.avi</file>\n"),
    "a file listed twice": document(files="    <file>a.avi</file>\n    <file>a.avi</file>\n"),
    "sections in another order": document()
    .replace("  <files />\n", "")
    .replace("</session>", "  <files />\n</session>"),
    "a section that is not there": document().replace("  <annotations />\n", ""),
    "a rig": document(objects=RIG),
    "shapes without namespace (2016-03)": document(
        objects=obj(shape="Rectangle") + obj(shape="Polygon", id="o2")
    ),
    "the shape on each marker (before 2016-03)": document(
        objects=f'    <object id="o1" name="cup" {STANDARD} scale="1">\n'
        '      <marker type="LOCATION" frame="1" shape="Rectangle">1,2,3,4</marker>\n    </object>\n'
    ),
    "an unknown shape": document(objects=obj(shape="Annotator.CubeObject")),
    "generate in another case": document(objects=obj().replace("MANUAL", "manual")),
    "values that are none": document(
        objects=obj().replace("-65536", "red").replace('borderSize="1"', 'borderSize="x"')
    ),
    "properties of an object": document(objects=obj(extra=' weight="12 &amp; more" Color="x"')),
    "attributes in another order": document(
        objects=f'    <object name="cup" id="o1" x="1" {STANDARD} shape="{RECTANGLE}" />\n'
    ),
    "missing attributes": document(objects=f'    <object id="o1" shape="{RECTANGLE}" />\n'),
    "no id": document(objects=f'    <object name="x" {STANDARD} shape="{RECTANGLE}" />\n'),
    "outer blanks in a name": document(objects=obj(name=" cup ") + obj(name="", id="o2")),
    "doubled object ids": document(objects=obj(name="a") + obj(name="b") + obj(name="c")),
    "flat markers without a wrapper (2016-03)": document(objects=obj(FLAT)),
    "markers that start with an absence": document(objects=obj(markers(DELETE(0), location(5)))),
    "two absences in a row": document(objects=obj(markers(location(0), DELETE(4), DELETE(5), location(9)))),
    "fractional rectangles": document(objects=obj(markers(location(1, "-3.652977E-05,0.9950001,1.565,859")))),
    "unusual numbers": document(
        objects=obj(markers(location(1, "1.0,+2,3e0,NaN"), location(2, " 1,2,3,4 ")))
    ),
    "a marker without numbers": document(objects=obj(markers('<marker type="LOCATION" frame="1" />'))),
    "unknown attributes of a marker": document(
        objects=obj(markers('<marker frame="1" type="LOCATION" x="&quot;">1,2,3,4</marker>'))
    ),
    "a polygon in 3-D": document(objects=obj(POLYGON_3D, shape="Annotator.PolygonObject")),
    "a rectangle in 3-D": document(
        objects=obj(
            markers(location(1))
            + markers('<marker frame="1">1,2,3,4,5,6,7,8,9,0,0,0</marker>', tag="markers3d")
        )
    ),
    "numbers that are no whole points": document(
        objects=obj(markers('<marker frame="1">1,2,3,4</marker>', tag="markers3d"))
    ),
    "a type on a 3-D marker": document(
        objects=obj(markers('<marker type="DELETE" frame="1" />', tag="markers3d"))
    ),
    "a box": document(
        objects=box(box_marker(0, face(), face()), box_marker(0, face(POINTS), face(POINTS), dimensions=3))
    ),
    "a box in 2-D without 3-D": document(
        objects=box(box_marker(0, face()) + box_marker(3, face()), box_marker(0, face(POINTS), dimensions=3))
    ),
    "two boxes": document(objects=box(box_marker(0, face()), id="o1") + box(box_marker(0, face()), id="o2")),
    "an absence of a box": document(
        objects=box(box_marker(0, face()) + '        <marker type="DELETE" frame="4" glyphSize="5" />\n')
    ),
    "an empty marker of a box": document(objects=box(box_marker(0) + box_marker(4, face()))),
    "a box without markers": document(objects=obj(shape="Annotator.GlyphBoxObject")),
    "flat markers of a box": document(
        objects=obj(
            box_marker(0, face()).replace("\n  ", "\n").removeprefix("  "), shape="Annotator.GlyphBoxObject"
        )
    ),
    "codes of another size": document(objects=box(box_marker(0, face(code="1 ,0 ,0 ,1 "), size=2))),
    "a box marker without a size": document(objects=box(box_marker(0, face()).replace(' glyphSize="5"', ""))),
    "a box marker with other attributes": document(
        objects=box(box_marker(0, face()).replace('frame="0"', 'x="|=1" frame="0"'))
    ),
    "codes without blanks": document(objects=box(box_marker(0, face(code=CODE.replace(" ", ""))))),
    "corners outside of the image": document(objects=box(box_marker(0, face("-1.5,0,1,2,3,4,5,6")))),
    "every way to say missing": document(
        objects=box(box_marker(0, face()), box_marker(0, face("-∞,-∞,-∞,-1,-1,-1,0,0,0,∞,1,2"), dimensions=3))
    ),
    "links of 2016-07": document(objects=obj(LINKS)),
    "links of 2016-03": document(objects=obj(SPATIAL)),
    "an empty list of links": document(objects=obj("      <links />\n")),
    "unary and binary predicates": predicates(
        predicate(1, "o1", "STAND(X)"), predicate(1, "o1,o2", "ON(X,Y)", "False")
    ),
    "NAME(Y,X)": predicates(predicate(1, "o1,o2", "ON(Y,X)")),
    "ids of other sessions": predicates(predicate(1, "o1,0009_Forrest_Gump/o1", "IDENTITY(X,Y)")),
    "predicates that are none": predicates(
        predicate(1, "", "x").replace('"1"', '"0"', 1), predicate(2, "a,b,c", "N(X,Y)", "maybe")
    ),
    "unknown attributes of a predicate": predicates(
        predicate(1, "o1", "STAND(X)").replace("frame=", 'x="1" frame=')
    ),
    "references, actions, links": document(events=event(rest=LISTS)),
    "doubled event ids": document(events=event("one") + event("two")),
    "unknown attributes of an event": document(events=event().replace('id="a1"', 'x="1" id="a1"')),
    "an event without children": document(events='    <annotation id="a1" />\n'),
    "an event without lists": document(
        events=event(rest=" ").replace("\n     </annotation>", "\n    </annotation>")
    ),
    "an end before the start": document(events=event(start=9, end=2)),
    "a text with line ends, tabs, blanks and escapes": document(
        events=event('  a\n\tb &amp; &lt;c&gt; "d"&#xD; \n')
    ),
    "an empty text": document(events=event("")),
    "letters of all kinds": document(objects=obj(name="Tasse ☕ 杯 🂡")),
}


@pytest.mark.parametrize("line_end", ["\n", "\r\n"], ids=["LF", "CRLF"])
@pytest.mark.parametrize("text", GENERATIONS.values(), ids=GENERATIONS)
def test_every_generation_comes_back_byte_for_byte(text: str, line_end: str) -> None:
    source = BOM + text.replace("\n", line_end).encode()
    assert trip(source).back == source


PROFILES = {
    "no byte order mark and a final line end": document().encode() + b"\n",
    "blank lines at the end": BOM + document().encode() + b"\n \n",
    "no declaration": document().partition("\n")[2].encode(),
    "another declaration": document().replace("utf-8", "UTF-8").encode(),
    "a declaration in single quotes": document().replace('"1.0" encoding="utf-8"', "'1.0'").encode(),
}


@pytest.mark.parametrize("source", PROFILES.values(), ids=PROFILES)
def test_the_document_s_frame_comes_back(source: bytes) -> None:
    found = trip(source)
    assert found.back == source
    assert found.findings == []


FOREIGN_HANDS = {
    "a comment": ("<files />", "<files /><!-- mine -->"),
    "a comment in a text": ("<text>pour</text>", "<text>po<!-- x -->ur</text>"),
    "a CDATA section": ("<text>pour</text>", "<text><![CDATA[pour]]></text>"),
    "single quotes": ('name="cup"', "name='cup'"),
    "other indentation": ("    <object", "\t<object"),
    "two elements on a line": ("      <text>", "<text>"),
    "a character written as a number": ("pour", "&#112;our"),
    "no blank before the end": ("<refs />", "<refs/>"),
    "a declaration without a line end": ("?>\n", "?>"),
    "a line end in an attribute": ('name="cup"', 'name="c\nup"'),
    "another XML namespace": ("<session ", '<session xmlns:y="u:y" y:z="1" '),
    "an unknown element": ("<refs />", "<refs /><mine />"),
    "mixed line ends": ("<refs />\n", "<refs />\r\n"),
}


@pytest.mark.parametrize(("old", "new"), FOREIGN_HANDS.values(), ids=FOREIGN_HANDS)
def test_what_ecat_would_not_write_is_told(old: str, new: str) -> None:
    """The facts are kept, the layout is not, and nobody has to find that out alone."""
    plain = document(objects=obj(markers(location(1))), events=event())
    found = trip(plain.replace(old, new, 1))
    assert not found.is_exact
    assert any("export will differ" in finding for finding in found.findings)
    if "line end in an attribute" not in old and "c\nup" not in new:
        assert replace(found.layer, foreign=()) == replace(trip(plain).layer, foreign=())


def test_what_ecat_would_write_is_not_told() -> None:
    assert trip(document(objects=obj(markers(location(1))), events=event())).findings == []


def test_cross_session_references_survive_even_where_they_dangle() -> None:
    found = trip(predicates(predicate(0, "o1,gone/o99", "IDENTITY(X,Y)")))
    assert found.layer.relations[0].targets == ("o1", "gone/o99")
    assert b'ids="o1,gone/o99"' in found.back


# ---------------------------------------------------------------------------------------------- edits

EDITED = trip(
    document(
        files="    <file>a.avi</file>\n",
        objects=obj(LINKS + "", id="o1")
        + obj(markers(location(1, "1.0,2,3,4"), location(5)), id="o2", extra=' weight="3"').replace(
            "MANUAL", "manual"
        )
        + obj(POLYGON_3D, id="o3", shape="Polygon").replace("-65536", "red"),
        events=event("one", id="a1", rest=LISTS)
        + event("two", id="a2")
        + event("three", id="a2", start=20, end=30),
        predicates=predicate(3, "o1,o2", "ON(Y,X)", "true") + predicate(8, "o1", "STAND(X)", "False"),
    )
)


def lines_changed(layer: Layer, manifest: Manifest | None = None) -> list[tuple[str, str]]:
    """Lines of the export that differ; their number must not."""
    old = EDITED.back.decode().split("\n")
    new = write(manifest or EDITED.manifest, layer, {}).decode().split("\n")
    assert len(old) == len(new)
    return [(a.strip(), b.strip()) for a, b in zip(old, new, strict=True) if a != b]


def test_no_edit_changes_nothing() -> None:
    assert EDITED.is_exact
    assert lines_changed(EDITED.layer) == []


OBJECT_EDITS: list[Callable[[AnnotatedObject], AnnotatedObject]] = [
    lambda o: replace(o, name=o.name + "!"),
    lambda o: replace(o, color="#01020304"),
    lambda o: replace(o, line_width=7),
    lambda o: replace(o, semantic_type="table"),
    lambda o: replace(o, origin="tracked"),
    lambda o: replace(o, kind="rig"),
    lambda o: replace(o, dimensions=3),
    lambda o: replace(o, stream="b.avi"),
]


@given(st.integers(0, 2), st.sampled_from(OBJECT_EDITS))
def test_an_edited_object_changes_its_line_only(
    which: int, edit: Callable[[AnnotatedObject], AnnotatedObject]
) -> None:
    objects = list(EDITED.layer.objects)
    objects[which] = edit(objects[which])
    ((old, new),) = lines_changed(replace(EDITED.layer, objects=tuple(objects)))
    assert old.startswith(f'<object id="o{which + 1}"')
    assert new.startswith(f'<object id="o{which + 1}"')
    differing = [(a, b) for a, b in zip(old.split('" '), new.split('" '), strict=True) if a != b]
    assert len(differing) == 1, "one attribute"


@given(
    st.sampled_from([(1, 0), (1, 1), (2, 0)]),
    st.integers(-1, 200),
    st.tuples(*[st.floats(-1e3, 1e3, width=32)] * 4),
)
def test_an_edited_key_frame_changes_its_line_only(
    place: tuple[int, int], frame: int, numbers: tuple[float, ...]
) -> None:
    which, index = place
    thing = EDITED.layer.objects[which]
    keys = list(thing.key_frames)
    keys[index] = replace(keys[index], frame=frame, coordinates=numbers)
    objects = list(EDITED.layer.objects)
    objects[which] = replace(thing, key_frames=tuple(keys))
    for old, new in lines_changed(replace(EDITED.layer, objects=tuple(objects))):
        assert old.startswith('<marker type="LOCATION"')
        assert new.startswith(f'<marker type="LOCATION" frame="{frame + 1}">')


EVENT_EDITS: list[tuple[str, Callable[[Event], Event]]] = [
    ("<text>", lambda e: replace(e, text=e.text + " & more")),
    ("<duration", lambda e: replace(e, segments=(Segment(start_frame=40, end_frame=50),))),
]


@given(st.integers(0, 2), st.sampled_from(EVENT_EDITS))
def test_an_edited_event_changes_its_line_only(
    which: int, edit: tuple[str, Callable[[Event], Event]]
) -> None:
    events = list(EDITED.layer.events)
    events[which] = edit[1](events[which])
    ((old, _),) = lines_changed(replace(EDITED.layer, events=tuple(events)))
    assert old.startswith(edit[0])


RELATION_EDITS: list[Callable[[Relation], Relation]] = [
    lambda r: replace(r, polarity=not r.polarity),
    lambda r: replace(r, predicate="NEAR"),
    lambda r: replace(r, arguments=(*r.arguments[:-1], Argument(target="o9"))),
]


@given(st.integers(0, 4), st.sampled_from(RELATION_EDITS))
def test_an_edited_relation_changes_its_line_only(which: int, edit: Callable[[Relation], Relation]) -> None:
    relations = list(EDITED.layer.relations)
    if len(relations[which].arguments) < 2 and edit is RELATION_EDITS[2]:
        return  # a link's first argument is the object that it stands in
    relations[which] = edit(relations[which])
    ((old, new),) = lines_changed(replace(EDITED.layer, relations=tuple(relations)))
    assert old.partition(" ")[0] == new.partition(" ")[0]
    assert old.startswith(("<linkTo", "<predicate"))


def test_an_edited_clock_and_length_change_the_first_line() -> None:
    clock = Clock(rule="uniform", start="2020-01-01T00:00:00", duration_ns=5_000_000_000)
    ((_, new),) = lines_changed(EDITED.layer, replace(EDITED.manifest, n_frames=7, clock=clock))
    assert new == '<session name="Session1" length="7" duration="5000" startWriteRGB="2020-01-01T00:00:00Z">'


def edited_face(column: str, value: Any) -> list[tuple[str, str]]:
    source = trip(
        document(
            objects=box(
                box_marker(0, face(), face("1.0,2,3,4,5,6,7,8")), box_marker(0, face(POINTS), dimensions=3)
            )
        )
    )
    tables = dict(source.tables)
    name = "markers_3d" if column[0] in "xyz" else "markers_2d"
    values = tables[name][column].to_pylist()
    values[-1] = value
    index = tables[name].schema.get_field_index(column)
    field = tables[name].schema.field(index)
    array = pa.array(values, field.type if not pa.types.is_dictionary(field.type) else pa.string())
    tables[name] = tables[name].set_column(index, field.name, array)
    old, new = (b.decode().split("\n") for b in (source.back, write(source.manifest, source.layer, tables)))
    return [(a.strip(), b.strip()) for a, b in zip(old, new, strict=True) if a != b]


@pytest.mark.parametrize(
    ("column", "value", "line"),
    [
        ("u0_px", 9.5, "<bounding>9.5,2,3,4,5,6,7,8</bounding>"),
        ("x0", 9.0, f"<bounding>-9,{POINTS.partition(',')[2]}</bounding>"),
        ("x0", None, f"<bounding>-∞,{POINTS.partition(',')[2]}</bounding>"),
        ("code", "1" * 25, f"<code>{'1 ,' * 24}1 </code>"),
    ],
)
def test_an_edited_face_changes_its_line_only(column: str, value: Any, line: str) -> None:
    assert [new for _, new in edited_face(column, value)] == [line]


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
            "event a1: ECAT has no roles; 1 left out"
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


def test_an_end_of_a_relation_is_its_denial() -> None:
    relation = Relation(predicate="STAND", start_frame=0, end_frame=8, arguments=(Argument(target="o1"),))
    text, _ = exported(Layer(relations=(relation,)))
    assert predicate(1, "o1", "STAND(X)") + predicate(9, "o1", "STAND(X)", "False") in text


def test_a_part_of_an_event_is_a_link_from_the_whole() -> None:
    text, _ = exported(Layer(events=(Event(id="a1"), Event(id="a2", parent="a1"))))
    assert '<linkTo id="a2" type="SUBEVENT(X,Y)" />' in text


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


KINDS: st.SearchStrategy[ObjectKind] = st.sampled_from(("rectangle", "polygon"))
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
            kind=kind,
            origin=draw(st.sampled_from(["manual", "tracked", "provided"])),
            dimensions=draw(st.sampled_from([2, 3])),
            semantic_type=draw(NAMES),
            color=f"#{draw(st.integers(0, 2**32 - 1)):08x}",
            line_width=draw(st.integers(1, 10)),
            key_frames=draw(key_frames(st.none() | RECTANGLES)),
            key_frames_3d=draw(key_frames(POINTS_3D)),
        )
        for i in range(n_objects)
        for kind in [draw(KINDS)]
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
                TextPredicate(start=1, end=4, type=t) for t in draw(st.lists(NAMES, max_size=2))
            ),
            links=tuple(
                Link(type=t, target="a0")
                for t in draw(st.lists(st.sampled_from(["CAUSE", "SUBEVENT"]), max_size=2))
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
