"""Whatever an annotation file holds, reading it gives a layer or one typed error, and nothing is lost in silence."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.errors import FormatError, InputError, SchemaError
from ecat.model import AnnotatedObject, CodingScheme, Event, KeyFrame, Layer, Segment
from ecat.store.xml import layer_from_xml, layer_to_xml, scheme_from_xml, scheme_to_xml
from tests.model.layers import SCHEMES

HEAD, TAIL = '<annotation name="main" version="1">', "</annotation>"
EVENT = Event(id="e1", type="pour", text="a\tb", segments=(Segment(start_frame=0, end_frame=9),))
FULL = Layer(
    objects=(AnnotatedObject(id="o1", key_frames=(KeyFrame(frame=-1, coordinates=(1.5, 2)),)),),
    events=(EVENT,),
)


def problems(inside: str) -> tuple[str, ...]:
    """What is wrong with a layer of ``inside``."""
    with pytest.raises(SchemaError) as caught:
        layer_from_xml(f"{HEAD}{inside}{TAIL}".encode(), name="main")
    return caught.value.problems


@pytest.mark.parametrize(
    ("inside", "problem"),
    [
        ("loose", "/annotation/text(): unknown text (line 1)"),
        ('<event id="e"/>loose', "/annotation/text(): unknown text (line 1)"),
        ('<event id="e"><text>a<b/>c</text></event>', "/annotation/event[0]/text/b: unknown part (line 1)"),
        ('<event id="e"><text x="1"/></event>', "/annotation/event[0]/text/@x: unknown part (line 1)"),
        (
            '<event id="e"><text>a</text><text/></event>',
            "/annotation/event[0]/text: unknown element (line 1)",
        ),
        (
            '<object id="o"><key_frame frame="0">1<foreign key="a:b" value="c"/>2</key_frame></object>',
            "/annotation/object[0]/key_frame[0]/text(): unknown text (line 1)",
        ),
        ('<other:event xmlns:other="x" id="e"/>', "/annotation/{x}event: unknown element (line 1)"),
    ],
)
def test_what_the_model_has_no_place_for_is_refused_not_dropped(inside: str, problem: str) -> None:
    assert problems(inside) == (problem,)


def test_unknown_parts_and_wrong_values_are_reported_together_each_where_it_stands() -> None:
    found = problems(
        '<object id="a"/>\n<object kind="cube" colour="red"><key_frame>1 x</key_frame></object>\n<junk/>'
    )
    assert {problem.partition(": ")[0] for problem in found} == {
        "/annotation/object[1]/@colour",
        "/annotation/junk",
        "/annotation/object[1]/@id",
        "/annotation/object[1]/@kind",
        "/annotation/object[1]/key_frame[0]/@frame",
        "/annotation/object[1]/key_frame[0]/text()[1]",
    }
    assert "(line 3)" in found[1]


@pytest.mark.parametrize("tag", ["a", "event", "text"])
def test_a_million_levels_are_refused(tag: str) -> None:
    with pytest.raises(FormatError, match="line 1"):
        layer_from_xml(HEAD.encode() + f"<{tag}>".encode() * 10**6, name="main")


def test_a_number_of_very_many_digits_is_refused() -> None:
    found = problems(f'<object id="o"><key_frame frame="{"9" * 10_000}"/></object>')
    assert [problem.partition(": ")[0] for problem in found] == ["/annotation/object[0]/key_frame[0]/@frame"]
    assert len(found[0]) < 500


def test_a_document_type_is_found_in_any_encoding() -> None:
    document = f'<?xml version="1.0" encoding="utf-7"?>+ADw-!DOCTYPE a []>{HEAD}{TAIL}'
    with pytest.raises(FormatError, match="document type"):
        layer_from_xml(document.encode(), name="main")


@given(
    st.integers(0, 400), st.integers(0, 20), st.binary(max_size=6) | st.sampled_from([b"<", b"&#7;", b'"'])
)
@settings(max_examples=300)
def test_damaged_bytes_are_a_layer_or_one_typed_error(at: int, cut: int, noise: bytes) -> None:
    data = layer_to_xml(FULL)
    try:
        layer = layer_from_xml(data[:at] + noise + data[at + cut :], name="main")
    except InputError as error:
        message = str(error)
    else:
        message = ""
        assert layer_from_xml(layer_to_xml(layer), name="main") == layer
    assert len(message) < 2000


FORBIDDEN = [*map(chr, {*range(0x20)} - {9, 10, 13}), "\ud800", "\udfff", "\ufffe", "\uffff"]


@pytest.mark.parametrize("character", FORBIDDEN, ids=lambda character: f"U+{ord(character):04X}")
def test_what_xml_cannot_hold_is_refused_where_it_is_written(character: str) -> None:
    layer = Layer(objects=(AnnotatedObject(id="o1", name=f"a{character}"),), events=(Event(id=character),))
    with pytest.raises(SchemaError, match="cannot write the annotation 'main'") as caught:
        layer_to_xml(layer)
    assert [problem.partition(": ")[0] for problem in caught.value.problems] == [
        "/annotation/object[0]/@name",
        "/annotation/event[0]/@id",
    ]


@pytest.mark.slow
def test_the_longest_text_can_be_read_again_and_a_longer_one_is_not_written() -> None:
    longest = Layer(events=(Event(id="e1", text="é" * 4_999_999),))
    assert layer_from_xml(layer_to_xml(longest), name="main") == longest
    with pytest.raises(SchemaError, match="at most 10000000 can be read again"):
        layer_to_xml(Layer(events=(Event(id="e1", text="é" * 5_000_001),)))


def test_numbers_of_numpy_are_written_as_numbers() -> None:
    layer = Layer(
        objects=(AnnotatedObject(id="o", key_frames=(KeyFrame(frame=0, coordinates=(np.float64(0.1),)),)),)
    )
    assert layer_from_xml(layer_to_xml(layer), name="main") == layer


@given(SCHEMES)
@settings(max_examples=60)
def test_any_coding_scheme_is_read_as_it_was(scheme: CodingScheme) -> None:
    data = scheme_to_xml(scheme)
    assert scheme_from_xml(data, name="scheme") == scheme
    assert scheme_to_xml(scheme_from_xml(data, name="scheme")) == data
