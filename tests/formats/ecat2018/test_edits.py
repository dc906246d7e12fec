"""After an edit only what was edited differs in the exported file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.model import (
    AnnotatedObject,
    Clock,
    Event,
    Layer,
    Manifest,
    Relation,
    Segment,
)
from ecat.model.annotation import Argument
from tests.formats.ecat2018.documents import (
    POINTS,
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

LINKS = (
    '      <links>\n        <link frame="38">\n          <linkTo id="o2" q="False" type="LOOK_AT" />\n'
    '          <linkTo otherSession="0009" id="o7" q="True" type="IDENTITY" />\n        </link>\n'
    '        <link frame="38">\n          <linkTo q="True" type="SIT(X)" />\n        </link>\n'
    '        <link frame="50" />\n      </links>\n'
)
POLYGON_3D = markers(location(3, "1,2,3,4,5,6")) + markers(
    '<marker frame="3">1,2,3,-∞,-∞,-∞,0.5,0,2</marker>', tag="markers3d"
)
LISTS = (
    '      <refs>\n        <ref start="0" end="4" refTo="o2" />\n      </refs>\n'
    '      <events>\n        <event start="5" end="9" semanticType="pour" />\n      </events>\n'
    '      <link>\n        <linkTo id="a2" type="SUBEVENT(X,Y)" />\n'
    '        <linkTo id="a3" type="CAUSE" />\n      </link>\n'
)


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
