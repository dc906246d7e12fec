"""Annotation layers and coding schemes as XML."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings

from ecat.errors import EcatError, FormatError, LimitError, SchemaError
from ecat.model import AnnotatedObject, Event, KeyFrame, Layer, Relation, Segment
from ecat.model.annotation import Argument, with_relation_ids
from ecat.model.scheme import ECAT_2018_SCHEME
from ecat.store import xml
from ecat.store.xml import layer_from_xml, layer_to_xml, scheme_from_xml, scheme_to_xml
from tests.model.layers import LAYERS

SMALL = Layer(
    objects=(
        AnnotatedObject(
            id="o1", name="cup", kind="rectangle", key_frames=(KeyFrame(frame=0, coordinates=(1, 2, 3.5, 4)),)
        ),
    ),
    events=(Event(id="a1", text=" pour\n", segments=(Segment(start_frame=0, end_frame=9),)),),
    relations=(
        Relation(predicate="STAND", start_frame=2, polarity=False, arguments=(Argument(target="o1"),)),
    ),
)


def read(text: str | bytes) -> Layer:
    return layer_from_xml(text.encode() if isinstance(text, str) else text, name="main.xml")


def refusal(text: str | bytes) -> EcatError:
    with pytest.raises(EcatError) as caught:
        read(text)
    assert caught.value.what == "cannot read main.xml"
    return caught.value


def test_a_layer_is_read_line_by_line_by_a_person_too() -> None:
    assert layer_to_xml(SMALL).decode() == (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<annotation name="main" version="1">\n'
        '  <object id="o1" name="cup" kind="rectangle">\n'
        '    <key_frame frame="0">1 2 3.5 4</key_frame>\n'
        "  </object>\n"
        '  <event id="a1">\n'
        "    <text> pour\n</text>\n"
        '    <segment start_frame="0" end_frame="9"/>\n'
        "  </event>\n"
        '  <relation predicate="STAND" start_frame="2" polarity="false">\n'
        '    <argument target="o1"/>\n'
        "  </relation>\n"
        "</annotation>\n"
    )


@given(LAYERS)
@settings(max_examples=150)
def test_any_layer_is_read_as_it_was(layer: Layer) -> None:
    data = layer_to_xml(layer)
    # repr: what is missing is NaN, which equals nothing
    assert repr(read(data)) == repr(with_relation_ids(layer))
    assert layer_to_xml(read(data)) == layer_to_xml(with_relation_ids(layer))


def test_relations_without_an_id_get_the_same_one_at_every_reading() -> None:
    named = Relation(id="r1", predicate="SIT", start_frame=0, arguments=(Argument(target="o1"),))
    nameless = SMALL.relations[0]
    data = layer_to_xml(replace(SMALL, relations=(nameless, named, nameless, nameless)))
    assert [relation.id for relation in read(data).relations] == ["r2", "r1", "r3", "r4"]
    assert read(data) == read(data)


def test_a_coding_scheme_is_read_as_it_was() -> None:
    assert scheme_from_xml(scheme_to_xml(ECAT_2018_SCHEME), name="s") == ECAT_2018_SCHEME


def test_an_edit_changes_the_lines_of_what_was_edited() -> None:
    old = layer_to_xml(SMALL).split(b"\n")
    edited = replace(SMALL, objects=(replace(SMALL.objects[0], name="mug"),))
    new = layer_to_xml(edited).split(b"\n")
    assert [(a, b) for a, b in zip(old, new, strict=True) if a != b] == [
        (b'  <object id="o1" name="cup" kind="rectangle">', b'  <object id="o1" name="mug" kind="rectangle">')
    ]


def test_comments_and_indentation_of_a_person_do_not_matter() -> None:
    text = layer_to_xml(SMALL).decode().replace("  <event", "<!-- the pour -->\n\n\t<event")
    assert read(text) == with_relation_ids(SMALL)


class TestSchemaErrors:
    def test_every_problem_is_named_with_its_place(self) -> None:
        text = layer_to_xml(SMALL).decode()
        text = (
            text.replace('frame="0"', 'frame="x" typo="1"')
            .replace("<segment", "<segmnt")
            .replace('"false"', '"maybe"')
        )
        error = refusal(text)
        assert isinstance(error, SchemaError)
        assert sorted(problem.partition(": ")[0] for problem in error.problems) == [
            "/annotation/event[0]/segmnt",
            "/annotation/object[0]/key_frame[0]/@frame",
            "/annotation/object[0]/key_frame[0]/@typo",
            "/annotation/relation[0]/@polarity",
        ]

    @pytest.mark.parametrize(
        ("old", "new"),
        [
            ('id="a1"', ""),
            ("1 2 3.5 4", "1 2 drei"),
            ('version="1"', 'version="2"'),
            ('kind="rectangle"', 'kind="cube"'),
            ("</object>", "loose text</object>"),
            ('start_frame="0"', 'start_frame="0.5"'),
        ],
    )
    def test_what_is_against_the_schema_is_refused(self, old: str, new: str) -> None:
        assert isinstance(refusal(layer_to_xml(SMALL).decode().replace(old, new)), SchemaError)

    def test_a_thousand_problems_are_the_first_hundred(self) -> None:
        error = refusal('<annotation name="main" version="1">' + "<x/>" * 1000 + "</annotation>")
        assert isinstance(error, SchemaError)
        assert len(error.problems) == 100


class TestFormatErrors:
    @pytest.mark.parametrize(
        "text",
        [
            "",
            "x",
            "<annotation",
            "<session />",
            '<!DOCTYPE a [<!ENTITY b "c">]><annotation/>',
            "<annotation>\0</annotation>",
        ],
    )
    def test_what_is_no_layer_is_refused(self, text: str) -> None:
        assert isinstance(refusal(text), FormatError)

    @pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le"])
    def test_entities_do_not_hide_in_another_encoding(self, encoding: str) -> None:
        laughs = '<!DOCTYPE a [<!ENTITY b "ha"><!ENTITY c "&b;&b;">]><annotation scheme="&c;"/>'
        assert isinstance(refusal(laughs.encode(encoding)), FormatError)

    def test_a_document_that_is_too_large_is_refused_unread(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(xml, "MAX_BYTES", 10)
        assert isinstance(refusal("<annotation />"), LimitError)

    @pytest.mark.parametrize("cut", range(1, len(layer_to_xml(SMALL)) - 1, 23))
    def test_a_truncated_layer_is_refused(self, cut: int) -> None:
        assert isinstance(refusal(layer_to_xml(SMALL)[:cut]), FormatError)


class TestUnwritable:
    def test_control_characters_are_named_with_their_place(self) -> None:
        with pytest.raises(SchemaError) as caught:
            layer_to_xml(Layer(events=(Event(id="a1", text="a\x01b"),)))
        assert caught.value.problems == (
            "/annotation/event[0]/text: U+0001 at position 1 cannot be written as XML",
        )

    def test_a_layer_that_could_not_be_read_again_is_not_written(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(xml, "MAX_BYTES", 10)
        with pytest.raises(LimitError, match="cannot write the annotation 'main'"):
            layer_to_xml(SMALL)
