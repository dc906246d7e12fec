"""``<predicate>`` and the older links of ``files.param`` as relations (ECAT 2018 file format §1.2.7-1.2.8)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from ecat.formats.ecat2018.elements import (
    attribute_facts,
    attributes_of,
    fact,
    frame_number,
    kept,
    kept_attributes,
    predicate_of,
    tag_of,
)
from ecat.formats.ecat2018.xml_input import Element
from ecat.model import Foreign, Relation
from ecat.model.annotation import Argument

_ATTRIBUTES = ("frame", "arguments", "ids", "q", "type")


def relation_of(element: Element, what: str) -> Relation:
    """A ``<predicate>``: it holds from its frame until contradicted.

    Raises
    ------
    FormatError : it has no frame.
    """
    said = attributes_of(element, what)
    number = frame_number(said.get("frame"), what, element.sourceline or 0)
    predicate, turned = predicate_of(said.get("type", ""))
    ids = said["ids"].split(",") if said.get("ids") else []
    relation = Relation(
        predicate=predicate,
        start_frame=number - 1,
        polarity=_is_positive(said.get("q")),
        arguments=_arguments(reversed(ids) if turned else ids),
    )
    usual = dict(predicate_attributes(relation))
    foreign = [
        fact(name, said[name])
        for name in ("arguments", "q", "type")
        if usual[name] != said.get(name, usual[name])
    ]
    foreign += attribute_facts(said, _ATTRIBUTES, _ATTRIBUTES)
    return replace(relation, foreign=tuple(foreign))


def _arguments(ids: Iterable[str]) -> tuple[Argument, ...]:
    return tuple(Argument(target=i) for i in ids)


def _is_positive(text: str | None) -> bool:
    return (text or "").lower() != "false"


def relation_type(relation: Relation) -> tuple[str, bool]:
    """The predicate with its form, and whether the second slot is read first."""
    raw = kept(relation.foreign, "type")
    if raw is not None:
        name, turned = predicate_of(raw)
        if name == relation.predicate:
            return raw, turned
    return f"{relation.predicate}({'X,Y' if len(relation.arguments) == 2 else 'X'})", False


def qualifier(relation: Relation) -> str:
    """``True`` or ``False``, or as the file said while it still means the same."""
    raw = kept(relation.foreign, "q")
    usual = "True" if relation.polarity else "False"
    return raw if raw is not None and _is_positive(raw) == relation.polarity else usual


def predicate_attributes(relation: Relation) -> list[tuple[str, str]]:
    """The attributes of a ``<predicate>``."""
    kind, turned = relation_type(relation)
    ids = list(relation.targets)
    values = {
        "frame": str(relation.start_frame + 1),
        "arguments": kept(relation.foreign, "arguments") or str(len(ids)),
        "ids": ",".join(reversed(ids) if turned else ids),
        "q": qualifier(relation),
        "type": kind,
    }
    return kept_attributes(values, relation.foreign)


# ---------------------------------------------------------------------------------------------- older links


def object_links(element: Element, object_id: str, what: str) -> tuple[list[Relation], list[Foreign]]:
    """The older links inside an object (``<links>`` of 2016-07, ``<spatialLink>`` of 2016-03), and how they lie.

    A link holds from its frame on, between the object that contains it and the one it names.

    Raises
    ------
    FormatError : one has no frame.
    """
    wrapper = element.find("links")
    links = element.findall("spatialLink") if wrapper is None else wrapper.findall("link")
    relations: list[Relation] = []
    spans: list[str] = []
    for link in links:
        number = frame_number(link.get("frame"), what, link.sourceline or 0)
        targets = link.findall("linkTo")
        relations += [_linked(to, tag_of(link), object_id, number - 1, what) for to in targets]
        spans.append(f"{number}:{len(targets)}")
    if wrapper is None and not links:
        return [], []
    return relations, [fact("spatialLinks" if wrapper is None else "links", ",".join(spans))]


def _linked(to: Element, tag: str, object_id: str, start_frame: int, what: str) -> Relation:
    said = attributes_of(to, what)
    target = said.get("id")
    if "otherSession" in said:
        target = f"{said['otherSession']}/{target or ''}"
    kind, q = said.get("type", ""), said.get("q")
    predicate, _ = predicate_of(kind)
    foreign = [fact("link", tag)]
    foreign += [fact("type", kind)] if kind != predicate else []
    foreign += [fact("q", "absent" if q is None else q)] if q not in {"True", "False"} else []
    return Relation(
        predicate=predicate,
        start_frame=start_frame,
        polarity=_is_positive(q),
        arguments=_arguments(i for i in (object_id, target) if i is not None),
        foreign=tuple(foreign),
    )


def link_attributes(relation: Relation) -> list[tuple[str, str]]:
    """The attributes of a ``<linkTo>`` inside the object that is the relation's first argument."""
    values: list[tuple[str, str]] = []
    for target in relation.targets[1:2]:
        session, slash, other = target.rpartition("/")
        values += [("otherSession", session)] if slash else []
        values.append(("id", other))
    if kept(relation.foreign, "q") != "absent":
        values.append(("q", qualifier(relation)))
    written = relation_type(relation)[0] if kept(relation.foreign, "type") is not None else relation.predicate
    return [*values, ("type", written)]


def link_spans(layout: str, relations: list[Relation]) -> list[tuple[int, list[Relation]]]:
    """The relations of an object's links, grouped as ``layout`` says (`object_links`); what was edited is by frame.

    Returns ``(frame in the file's numbering, relations)`` for each link.
    """
    waiting = list(relations)
    spans: list[tuple[int, list[Relation]]] = []
    for span in filter(None, layout.split(",")):
        frame, _, count = span.partition(":")
        mine = [relation for relation in waiting if relation.start_frame + 1 == int(frame)][: int(count or 0)]
        waiting = [relation for relation in waiting if not any(relation is taken for taken in mine)]
        if mine or not int(count or 0):  # one that was empty stays; one that was emptied goes
            spans.append((int(frame), mine))
    for relation in waiting:
        frame = relation.start_frame + 1
        if not spans or spans[-1][0] != frame:
            spans.append((frame, []))
        spans[-1][1].append(relation)
    return spans
