"""``option.txt``: ECAT's options, above all its predicates and their constraints (§1.10).

.NET DataContract XML on one line, members in alphabetical order, UTF-8 without BOM or declaration.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias, TypeVar, get_args

from ecat.errors import FormatError
from ecat.formats.ecat2018.lexical import text
from ecat.formats.ecat2018.number_text import parse_int
from ecat.formats.ecat2018.xml_input import (
    Element,
    parse_safe,
    place,
    reading,
    required_attribute,
    required_child,
)

MAX_BYTES = 16 << 20
_ROOT = "http://schemas.datacontract.org/2004/07/Annotator"
_INSTANCE = "http://www.w3.org/2001/XMLSchema-instance"
_ARRAYS = "http://schemas.microsoft.com/2003/10/Serialization/Arrays"
_ENTRY = "KeyValueOfstringOptions.InterpolationModedNkV8PdP"

DetectionMode: TypeAlias = Literal["ADD_SEPARATE", "OVERWRITE", "NO_OVERWRITE", "REMOVE_EXISTING"]
Interpolation: TypeAlias = Literal["LEFT_COPY", "LINEAR"]
RigView: TypeAlias = Literal["SHOW_ALL", "SHOW_UPPER"]
_Choice = TypeVar("_Choice", bound=str)


@dataclass(frozen=True, slots=True)
class PredicateForm:
    """A predicate and the order in which its argument slots (1, 2) are printed: ``NAME(X,Y)`` is (1, 2)."""

    name: str
    slots: tuple[int, ...]

    def __str__(self) -> str:
        return f"{self.name}({','.join('XY'[slot - 1] for slot in self.slots)})"


@dataclass(frozen=True, slots=True)
class Unique:
    """UNIQUE: facts of ``predicate`` that differ only in the arguments of these slots exclude each other."""

    predicate: PredicateForm
    slots: tuple[int, ...]

    def __str__(self) -> str:
        marked = ",".join("#" * (slot in self.slots) + "XY"[slot - 1] for slot in self.predicate.slots)
        return f"UNIQUE={self.predicate.name}({marked})"


@dataclass(frozen=True, slots=True)
class Exclusive:
    """EXCLUSIVE: an object has at most one of these unary predicates at a time."""

    predicates: tuple[PredicateForm, ...]

    def __str__(self) -> str:
        return f"EXCLUSIVE={' # '.join(map(str, self.predicates))}"


@dataclass(frozen=True, slots=True)
class Options:
    """Everything in ``option.txt``; the defaults are those that ECAT takes for members that are missing."""

    detection_mode: DetectionMode = "ADD_SEPARATE"
    event_predicates: tuple[PredicateForm, ...] = ()
    glyph_prototype_path: str | None = None
    interpolation_modes: tuple[tuple[str, Interpolation], ...] = (
        ("Rig", "LEFT_COPY"),
        ("Rectangle", "LEFT_COPY"),
        ("Glyph", "LEFT_COPY"),
    )
    object_predicates: tuple[PredicateForm, ...] = ()
    constraints: tuple[Unique | Exclusive, ...] = ()
    show_markers: bool = False
    show_rig: RigView = "SHOW_ALL"


# ---------------------------------------------------------------------------------------------- reading


def read_options(source: Path | bytes) -> Options:
    """Read the options.

    Raises
    ------
    FormatError : not this kind of XML, an unknown value, or a predicate whose slots contradict its size.
    LimitError : above 16 MiB.
    """
    return _Reader(reading(source, "option.txt")).options(source)


class _Reader:
    """Reads members; ``what`` begins every error."""

    def __init__(self, what: str) -> None:
        self._what = what

    def options(self, source: Path | bytes) -> Options:
        root = parse_safe(source, what=self._what, max_bytes=MAX_BYTES)
        if root.tag != _name("Options"):
            raise FormatError(
                self._what, where=f"line {root.sourceline}: the root is <{root.tag}>, not <Options>"
            )
        default = Options()
        modes = self._member(root, "interpolationModes")
        return Options(
            self._choice(root, "detectionMode", get_args(DetectionMode), default.detection_mode),
            self._forms(root, "eventPredicates"),
            _text(self._member(root, "glyphPrototypePath")),
            default.interpolation_modes if modes is None else tuple(map(self._mode, modes)),
            self._forms(root, "objectPredicates"),
            tuple(map(self._constraint, _children(self._member(root, "predicateConstraints")))),
            show_markers=self._choice(root, "showMarkerMode", ("false", "true"), "false") == "true",
            show_rig=self._choice(root, "showRigOption", get_args(RigView), default.show_rig),
        )

    def _member(self, parent: Element, name: str) -> Element | None:
        """The member, None where it is absent or null."""
        member = parent.find(_name(name))
        return None if member is None or member.get(f"{{{_INSTANCE}}}nil") == "true" else member

    def _choice(self, parent: Element, name: str, choices: tuple[_Choice, ...], default: _Choice) -> _Choice:
        member = self._member(parent, name)
        return default if member is None else self._one_of(member, choices)

    def _one_of(self, element: Element, choices: tuple[_Choice, ...]) -> _Choice:
        for choice in choices:
            if choice == (element.text or "").strip():
                return choice
        raise FormatError(
            self._what,
            where=f"{place(element)}: {(element.text or '')[:40]!r} is none of {', '.join(choices)}",
        )

    def _mode(self, entry: Element) -> tuple[str, Interpolation]:
        key = required_child(entry, f"{{{_ARRAYS}}}Key", what=self._what)
        value = required_child(entry, f"{{{_ARRAYS}}}Value", what=self._what)
        return key.text or "", self._one_of(value, get_args(Interpolation))

    def _forms(self, parent: Element, name: str) -> tuple[PredicateForm, ...]:
        return tuple(map(self._form, _children(self._member(parent, name))))

    def _form(self, element: Element) -> PredicateForm:
        size, slots = self._combination(required_child(element, _name("combination"), what=self._what))
        if size not in (1, 2) or sorted(slots) != list(range(1, size + 1)):
            raise FormatError(
                self._what,
                where=f"{place(element)}: the argument slots {slots} are not those of {size} arguments",
            )
        return PredicateForm(required_child(element, _name("predicate"), what=self._what).text or "", slots)

    def _combination(self, element: Element) -> tuple[int, tuple[int, ...]]:
        size = required_child(element, _name("size"), what=self._what)
        values = required_child(element, _name("values"), what=self._what)
        return self._int(size), tuple(map(self._int, values))

    def _int(self, element: Element) -> int:
        return parse_int(element.text or "", what=self._what, where=place(element))

    def _constraint(self, element: Element) -> Unique | Exclusive:
        kind = required_attribute(element, f"{{{_INSTANCE}}}type", what=self._what).rpartition(":")[2]
        if kind == "ExclusiveConstraint":
            return Exclusive(self._forms(element, "predicates"))
        if kind != "UniqueConstraint":
            raise FormatError(self._what, where=f"{place(element)}: unknown constraint {kind[:40]!r}")
        form = self._form(required_child(element, _name("predicate"), what=self._what))
        indices = required_child(element, _name("constraintedArgumentIndices"), what=self._what)
        size, slots = self._combination(indices)
        if size != len(form.slots) or not set(slots) <= set(form.slots):
            raise FormatError(
                self._what, where=f"{place(indices)}: slots {slots} of {size} do not belong to {form}"
            )
        return Unique(form, slots)


def _name(local: str) -> str:
    return f"{{{_ROOT}}}{local}"


def _text(element: Element | None) -> str | None:
    return None if element is None else element.text or ""


def _children(element: Element | None) -> list[Element]:
    return [] if element is None else list(element)


# ---------------------------------------------------------------------------------------------- writing


def write_options(options: Options) -> bytes:
    """The file as ECAT writes it; a real file comes back byte for byte."""
    entries = "".join(
        _tag(f"a:{_ENTRY}", _tag("a:Key", text(key)) + _tag("a:Value", mode))
        for key, mode in options.interpolation_modes
    )
    path = options.glyph_prototype_path
    members = [
        _tag("detectionMode", options.detection_mode),
        _tag("eventPredicates", _forms_xml(options.event_predicates)),
        '<glyphPrototypePath i:nil="true"/>' if path is None else _tag("glyphPrototypePath", text(path)),
        _tag("interpolationModes", entries, f' xmlns:a="{_ARRAYS}"'),
        _tag("objectPredicates", _forms_xml(options.object_predicates)),
        _tag("predicateConstraints", "".join(map(_constraint_xml, options.constraints))),
        _tag("showMarkerMode", "true" if options.show_markers else "false"),
        _tag("showRigOption", options.show_rig),
    ]
    return _tag("Options", "".join(members), f' xmlns="{_ROOT}" xmlns:i="{_INSTANCE}"').encode()


def _tag(name: str, content: str, attributes: str = "") -> str:
    return f"<{name}{attributes}>{content}</{name}>" if content else f"<{name}{attributes}/>"


def _combination_xml(name: str, size: int, slots: tuple[int, ...]) -> str:
    values = "".join(_tag("a:int", str(slot)) for slot in slots)
    return _tag(name, _tag("size", str(size)) + _tag("values", values, f' xmlns:a="{_ARRAYS}"'))


def _form_xml(form: PredicateForm) -> str:
    return _combination_xml("combination", len(form.slots), form.slots) + _tag("predicate", text(form.name))


def _forms_xml(forms: tuple[PredicateForm, ...]) -> str:
    return "".join(_tag("Predicate", _form_xml(form)) for form in forms)


def _constraint_xml(constraint: Unique | Exclusive) -> str:
    if isinstance(constraint, Exclusive):
        content = _tag("predicates", _forms_xml(constraint.predicates))
        return _tag("PredicateConstraint", content, ' i:type="ExclusiveConstraint"')
    form = constraint.predicate
    content = _combination_xml("constraintedArgumentIndices", len(form.slots), constraint.slots)
    return _tag(
        "PredicateConstraint", content + _tag("predicate", _form_xml(form)), ' i:type="UniqueConstraint"'
    )
