"""VoxML entries of objects (§1.9): what a thing is shaped like, how it stands, what it affords.

ECAT itself reads only ``Pred``, ``Type`` and ``Concavity``, and skips an entry that lacks one of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from lxml import etree

from ecat.errors import FormatError
from ecat.formats.ecat2018.lexical import attribute, text
from ecat.formats.ecat2018.xml_input import Element, parse_safe, place, reading, required_attribute

MAX_BYTES = 16 << 20

Binding: TypeAlias = tuple[str, str]
"""Name and value of a habitat condition: ``("UP", "align(Y,E_y)")``."""


@dataclass(frozen=True, slots=True)
class Lex:
    """The word: ``pred`` and its types (``physobj*artifact`` are two)."""

    pred: str | None = None
    types: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ObjectType:
    """The shape: head with its index, components, concavity (``Flat``, ``Concave``, ...), symmetries."""

    head: str | None = None
    components: tuple[str, ...] = ()
    concavity: str | None = None
    rotational_symmetry: tuple[str, ...] = ()
    reflectional_symmetry: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Habitat:
    """How the object is placed by itself (``intrinsic``) and among others (``extrinsic``)."""

    intrinsic: tuple[Binding, ...] = ()
    extrinsic: tuple[Binding, ...] = ()


@dataclass(frozen=True, slots=True)
class Embodiment:
    """Size relative to an agent, and whether the object can be moved."""

    scale: str | None = None
    movable: bool | None = None


@dataclass(frozen=True, slots=True)
class VoxmlEntry:
    """One entry; ``unknown`` keeps each element not listed above: path of its parent, and its XML."""

    lex: Lex = Lex()
    type: ObjectType = ObjectType()
    habitat: Habitat = Habitat()
    affordances: tuple[str, ...] = ()
    embodiment: Embodiment = Embodiment()
    unknown: tuple[tuple[str, str], ...] = ()

    @property
    def used_by_ecat(self) -> bool:
        """Whether ECAT reads the entry: it skips one without predicate, type or concavity."""
        return None not in (self.lex.pred, self.type.concavity) and bool(self.lex.types)


_KNOWN = {
    "": ("Lex", "Type", "Habitat", "Afford_Str", "Embodiment"),
    "Lex": ("Pred", "Type"),
    "Type": ("Head", "Components", "Concavity", "RotatSym", "ReflSym"),
    "Type/Components": ("Component",),
    "Habitat": ("Intrinsic", "Extrinsic"),
    "Habitat/Intrinsic": ("Intr",),
    "Habitat/Extrinsic": ("Extr",),
    "Afford_Str": ("Affordances",),
    "Afford_Str/Affordances": ("Affordance",),
    "Embodiment": ("Scale", "Movable"),
}


def read_voxml(source: Path | bytes) -> VoxmlEntry:
    """Read an entry.

    Raises
    ------
    FormatError : not VoxML, an attribute is missing, or ``Movable`` is neither true nor false.
    LimitError : above 16 MiB.
    """
    what = reading(source, "the VoxML entry")
    root = parse_safe(source, what=what, max_bytes=MAX_BYTES)
    if root.tag != "VoxML":
        raise FormatError(what, where=f"line {root.sourceline}: the root is <{root.tag}>, expected <VoxML>")

    def values(path: str, name: str) -> tuple[str, ...]:
        return tuple(required_attribute(element, name, what=what) for element in root.iterfind(path))

    def bindings(path: str) -> tuple[Binding, ...]:
        return tuple(zip(values(path, "Name"), values(path, "Value"), strict=True))

    return VoxmlEntry(
        Lex(root.findtext("Lex/Pred"), _parts(root.findtext("Lex/Type"), "*")),
        ObjectType(
            root.findtext("Type/Head"),
            values("Type/Components/Component", "Value"),
            root.findtext("Type/Concavity"),
            _parts(root.findtext("Type/RotatSym"), ","),
            _parts(root.findtext("Type/ReflSym"), ","),
        ),
        Habitat(bindings("Habitat/Intrinsic/Intr"), bindings("Habitat/Extrinsic/Extr")),
        values("Afford_Str/Affordances/Affordance", "Formula"),
        Embodiment(root.findtext("Embodiment/Scale"), _movable(root, what)),
        tuple(_unknown(root)),
    )


def _parts(value: str | None, separator: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in value.split(separator)) if value and value.strip() else ()


def _movable(root: Element, what: str) -> bool | None:
    element = root.find("Embodiment/Movable")
    if element is None:
        return None
    value = (element.text or "").strip().lower()
    if value not in ("true", "false"):
        raise FormatError(what, where=f"{place(element)}: {value[:40]!r} is neither true nor false")
    return value == "true"


def _unknown(root: Element) -> list[tuple[str, str]]:
    return [
        (path, etree.tostring(child, encoding="unicode", with_tail=False))
        for path, known in _KNOWN.items()
        for parent in (root.iterfind(path) if path else (root,))
        for child in parent
        if child.tag not in known
    ]


def write_voxml(entry: VoxmlEntry) -> bytes:
    """The entry as UTF-8 XML that `read_voxml` reads back equal, in VoxML's layout."""
    lines = ['<?xml version="1.0" encoding="utf-8"?>', "<VoxML>"]
    kind, habitat, body = entry.type, entry.habitat, entry.embodiment
    leaves = {
        "Lex": [_leaf("Pred", entry.lex.pred), _leaf("Type", "*".join(entry.lex.types) or None)],
        "Type": [_leaf("Head", kind.head)],
        "Type/Components": [f"<Component{attribute('Value', part)} />" for part in kind.components],
        "Habitat/Intrinsic": [_binding("Intr", binding) for binding in habitat.intrinsic],
        "Habitat/Extrinsic": [_binding("Extr", binding) for binding in habitat.extrinsic],
        "Afford_Str/Affordances": [f"<Affordance{attribute('Formula', f)} />" for f in entry.affordances],
        "Embodiment": [
            _leaf("Scale", body.scale),
            _leaf("Movable", None if body.movable is None else str(body.movable).lower()),
        ],
    }
    after = {
        "Type": [
            _leaf("Concavity", kind.concavity),
            _leaf("RotatSym", ",".join(kind.rotational_symmetry) or None),
            _leaf("ReflSym", ",".join(kind.reflectional_symmetry) or None),
        ]
    }
    for path, xml in entry.unknown:
        after.setdefault(path, []).append(xml)

    def put(path: str, indent: str) -> None:
        lines.extend(indent + leaf for leaf in leaves.get(path, ()) if leaf)
        for child in (p for p in _KNOWN if p and p.rpartition("/")[0] == path):
            name = child.rpartition("/")[2]
            lines.append(f"{indent}<{name}>")
            put(child, indent + "  ")
            lines.append(f"{indent}</{name}>")
        lines.extend(indent + leaf for leaf in after.get(path, ()) if leaf)

    put("", "  ")
    return "\n".join([*lines, "</VoxML>", ""]).encode()


def _leaf(name: str, value: str | None) -> str:
    return "" if value is None else f"<{name}>{text(value)}</{name}>"


def _binding(name: str, binding: Binding) -> str:
    return f"<{name}{attribute('Name', binding[0])}{attribute('Value', binding[1])} />"
