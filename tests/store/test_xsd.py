"""The XML Schema that others check annotation files with says what ecat itself demands."""

from __future__ import annotations

from functools import cache

import pytest
from hypothesis import given, settings
from lxml import etree

from ecat.errors import SchemaError
from ecat.model import AnnotatedObject, Event, KeyFrame, Layer, Segment
from ecat.model.scheme import ECAT_2018_SCHEME
from ecat.store.xml import layer_from_xml, layer_to_xml, scheme_to_xml
from ecat.store.xsd import annotation_xsd
from tests.model.layers import LAYERS

SMALL = Layer(
    objects=(AnnotatedObject(id="o1", kind="polygon", key_frames=(KeyFrame(frame=0, coordinates=(1, 2)),)),),
    events=(Event(id="a1", text="pour", segments=(Segment(start_frame=0, end_frame=9),)),),
)


@cache
def schema() -> etree.XMLSchema:
    return etree.XMLSchema(etree.fromstring(annotation_xsd().encode()))


def is_valid(data: bytes) -> bool:
    return schema().validate(etree.fromstring(data))


@given(LAYERS)
@settings(max_examples=100)
def test_any_layer_is_valid(layer: Layer) -> None:
    assert is_valid(layer_to_xml(layer)), schema().error_log


def test_a_coding_scheme_is_valid() -> None:
    assert is_valid(scheme_to_xml(ECAT_2018_SCHEME))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('id="a1"', ""),
        ('kind="polygon"', 'kind="cube"'),
        ('kind="polygon"', 'kindly="polygon"'),
        ('frame="0"', 'frame="x"'),
        ("<segment", "<segmnt"),
        ('version="1"', 'version="2"'),
    ],
)
def test_what_ecat_refuses_is_invalid(old: str, new: str) -> None:
    data = layer_to_xml(SMALL).decode().replace(old, new).encode()
    assert not is_valid(data)
    with pytest.raises(SchemaError):
        layer_from_xml(data, name="main.xml")


def test_every_type_says_what_it_is() -> None:
    root = etree.fromstring(annotation_xsd().encode())
    space = {"xs": "http://www.w3.org/2001/XMLSchema"}
    types = root.findall("xs:complexType", space)
    assert {"Layer", "AnnotatedObject", "Event", "Relation", "CodingScheme"} <= {t.get("name") for t in types}
    assert all((t.findtext("xs:annotation/xs:documentation", "", space)) for t in types)
