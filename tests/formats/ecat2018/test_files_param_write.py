"""What was imported comes back byte for byte, and after an edit only what was edited differs."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.formats.ecat2018.documents import (
    BOM,
    CODE,
    POINTS,
    RECTANGLE,
    STANDARD,
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
