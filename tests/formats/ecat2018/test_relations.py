"""Older links keep their grouping, and edits find their place."""

from __future__ import annotations

from dataclasses import replace

from lxml import etree

from ecat.formats.ecat2018.relations import link_attributes, link_spans, object_links, relation_of
from ecat.model import Relation
from ecat.model.annotation import Argument

LINKS = etree.fromstring(
    '<object><links><link frame="5"><linkTo id="o2" q="True" type="ON"/></link>'
    '<link frame="5"><linkTo id="o3" q="no" type="IN"/><linkTo id="o4" type="AT"/></link><link frame="7"/>'
    "</links></object>"
)


def links() -> tuple[list[Relation], str]:
    relations, ((layout),) = object_links(LINKS, "o1", "")
    assert layout.key == "ecat-2018:links"
    return relations, layout.value


def names(spans: list[tuple[int, list[Relation]]]) -> list[tuple[int, list[str]]]:
    return [(frame, [relation.predicate for relation in relations]) for frame, relations in spans]


def test_links_are_grouped_as_in_the_file() -> None:
    relations, layout = links()
    assert names(link_spans(layout, relations)) == [(5, ["ON"]), (5, ["IN", "AT"]), (7, [])]


def test_a_link_that_was_moved_is_written_at_its_new_frame() -> None:
    relations, layout = links()
    relations[0] = replace(relations[0], start_frame=19)
    spans = names(link_spans(layout, relations))
    assert (20, ["ON"]) in spans
    assert sum(len(found) for _, found in spans) == 3


def test_a_link_whose_relations_were_removed_is_gone_and_one_that_was_empty_stays() -> None:
    relations, layout = links()
    assert names(link_spans(layout, relations[:1])) == [(5, ["ON"]), (7, [])]
    assert names(link_spans(layout, [])) == [(7, [])]


def test_a_link_that_is_new_is_written_too() -> None:
    relations, layout = links()
    new = Relation(
        predicate="NEAR", start_frame=6, arguments=(Argument(target="o1"), Argument(target="s/o9"))
    )
    assert names(link_spans(layout, [*relations, new]))[-1] == (7, ["NEAR"])
    assert link_attributes(new) == [("otherSession", "s"), ("id", "o9"), ("q", "True"), ("type", "NEAR")]


def test_links_say_what_they_said() -> None:
    relations, _ = links()
    assert [link_attributes(relation) for relation in relations] == [
        [("id", "o2"), ("q", "True"), ("type", "ON")],
        [("id", "o3"), ("q", "no"), ("type", "IN")],
        [("id", "o4"), ("type", "AT")],
    ]


def test_an_object_without_links_says_nothing_of_them() -> None:
    assert object_links(etree.fromstring("<object />"), "o1", "") == ([], [])


def test_a_predicate_s_turned_slots_are_read_in_order() -> None:
    said = etree.fromstring('<predicate frame="3" arguments="2" ids="a,b" q="True" type="ON(Y,X)" />')
    assert relation_of(said, "").targets == ("b", "a")
