"""``schemas/annotation.xsd``, generated from the dataclasses by the rule of :mod:`ecat.store.xml`."""

from __future__ import annotations

import types
from dataclasses import MISSING, fields
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints
from xml.sax.saxutils import quoteattr

from ecat.model import CodingScheme, Layer
from ecat.store.xml import child_types, field_role

_SIMPLE = {int: "xs:integer", bool: "xs:boolean", str: "xs:string", float: "xs:double"}


def annotation_xsd() -> str:
    """The XML Schema of annotation layers and coding schemes."""
    named: dict[str, list[str]] = {}
    for root in (Layer, CodingScheme):
        _complex_type(root, named)
    body = [line for lines in named.values() for line in lines]
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            '<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema">',
            '  <xs:element name="annotation" type="Layer"/>',
            '  <xs:element name="coding_scheme" type="CodingScheme"/>',
            '  <xs:simpleType name="numbers"><xs:list itemType="xs:double"/></xs:simpleType>',
            *body,
            "</xs:schema>",
            "",
        ]
    )


def _complex_type(kind: type, named: dict[str, list[str]]) -> None:
    if kind.__name__ in named:
        return
    named[kind.__name__] = []
    hints = get_type_hints(kind)
    particles: list[str] = []
    attributes: list[str] = []
    mixed = ""
    for item in fields(kind):
        role = field_role(item)
        if role == "attribute":
            required = (
                ' use="required"' if item.default is MISSING and item.default_factory is MISSING else ""
            )
            attributes += _attribute(item.name, hints[item.name], required)
        elif role == "element":
            particles.append(f'      <xs:element name="{item.name}" type="xs:string" minOccurs="0"/>')
        elif role == "text":
            mixed = ' mixed="true"'
    for tag, (_, child) in child_types(kind).items():
        particles.append(
            f'      <xs:element name="{tag}" type="{child.__name__}" minOccurs="0" maxOccurs="unbounded"/>'
        )
        _complex_type(child, named)
    doc = " ".join((kind.__doc__ or "").split())
    named[kind.__name__] = [
        f'  <xs:complexType name="{kind.__name__}"{mixed}>',
        f"    <xs:annotation><xs:documentation>{_escape(doc)}</xs:documentation></xs:annotation>",
        *(["    <xs:sequence>", *particles, "    </xs:sequence>"] if particles else []),
        *attributes,
        "  </xs:complexType>",
    ]


def _attribute(name: str, hint: Any, required: str) -> list[str]:
    if get_origin(hint) in (Union, types.UnionType):
        hint = next(arg for arg in get_args(hint) if arg is not type(None))
    if get_origin(hint) is Literal:
        values = "".join(f"<xs:enumeration value={quoteattr(str(v))}/>" for v in get_args(hint))
        restriction = (
            f'<xs:simpleType><xs:restriction base="xs:string">{values}</xs:restriction></xs:simpleType>'
        )
        return [f'    <xs:attribute name="{name}"{required}>{restriction}</xs:attribute>']
    return [f'    <xs:attribute name="{name}" type="{_SIMPLE[hint]}"{required}/>']


def _escape(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
