"""Layers and coding schemes as XML, driven by the dataclasses of :mod:`ecat.model`.

One rule serves reading, writing and the XSD (:mod:`ecat.store.xsd`): a field whose metadata has ``tag`` holds child
elements of that name, ``text`` is the element's text, ``element`` a child element with text only, every other field an
attribute that is left out when it has its default (unless ``always``).  Output is stable, indented by two
spaces, one element per line, so that a diff shows what a person changed.  Text keeps its white space.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from itertools import islice
from typing import Any, Literal, get_args, get_origin, get_type_hints
from xml.sax.saxutils import escape, quoteattr

from lxml import etree
from pydantic import TypeAdapter, ValidationError

from ecat.errors import FormatError, LimitError, SchemaError
from ecat.model import CodingScheme, Layer
from ecat.model.annotation import with_relation_ids, without_usual_ids

MAX_BYTES = 64 << 20
"""Every byte of XML can take more than sixty bytes of memory."""
_MAX_TEXT = 10_000_000  # bytes of UTF-8 of one text or attribute; libxml2 reads no more
_MAX_PROBLEMS = 100
_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_HEADER = '<?xml version="1.0" encoding="UTF-8"?>\n'


def layer_to_xml(layer: Layer) -> bytes:
    """The layer as UTF-8 XML with a final line feed; relations say their id where it does not follow from their place.

    Raises
    ------
    SchemaError : a text cannot be in XML (control characters), or is too long; ``problems`` names each.
    LimitError : the document would be too large to be read again.
    """
    return _document("annotation", without_usual_ids(layer))


def layer_from_xml(data: bytes, *, name: str) -> Layer:
    """Read a layer; relations that were written without an id get one.

    Raises
    ------
    FormatError : not well-formed, or with a DOCTYPE; the message names the line.
    SchemaError : against the schema; ``problems`` lists every finding (the first hundred) with its path in the
        document, where ``object[0]`` is the first object.
    LimitError : larger than ``MAX_BYTES``.
    """
    return with_relation_ids(_read(Layer, "annotation", data, name))


def scheme_to_xml(scheme: CodingScheme) -> bytes:
    """The coding scheme as UTF-8 XML with a final line feed; errors as in :func:`layer_to_xml`."""
    return _document("coding_scheme", scheme)


def scheme_from_xml(data: bytes, *, name: str) -> CodingScheme:
    """Read a coding scheme; errors as in :func:`layer_from_xml`."""
    return _read(CodingScheme, "coding_scheme", data, name)


# ---------------------------------------------------------------------------------------------------- the rule


def field_role(item: Field[Any]) -> str:
    """``children``, ``text``, ``element`` or ``attribute``."""
    if "tag" in item.metadata:
        return "children"
    return next((role for role in ("text", "element") if item.metadata.get(role)), "attribute")


@cache
def child_types(kind: type) -> dict[str, tuple[str, type]]:
    """Element name -> (field name, dataclass) of the children of ``kind``."""
    hints = get_type_hints(kind)
    found: dict[str, tuple[str, type]] = {}
    for item in fields(kind):
        if field_role(item) == "children":
            found[item.metadata["tag"]] = (item.name, get_args(hints[item.name])[0])
    return found


@cache
def _roles(kind: type) -> tuple[tuple[str, str, Any], ...]:
    return tuple(
        (f.name, field_role(f), MISSING if f.metadata.get("always") else f.default) for f in fields(kind)
    )


@cache
def _choices(kind: type) -> dict[str, dict[str, Any]]:
    """Attributes that must be one of a few values which are not texts: their spelling -> the value."""
    hints = get_type_hints(kind)
    return {
        name: {_scalar(value): value for value in get_args(hint)}
        for name, hint in hints.items()
        if get_origin(hint) is Literal and not all(isinstance(value, str) for value in get_args(hint))
    }


# ---------------------------------------------------------------------------------------------------- writing


def _document(tag: str, value: Any) -> bytes:
    out = [_HEADER]
    _write(out, tag, value, "")
    text = "".join(out)
    # a line holds at most one text; the fields are looked through only if something may be wrong
    suspicious = _NOT_XML.search(text) or max(map(len, out)) > _MAX_TEXT // 4
    problems = tuple(islice(_unwritable(value, f"/{tag}"), _MAX_PROBLEMS)) if suspicious else ()
    if problems:
        raise SchemaError(
            f"cannot write the {tag.replace('_', ' ')} {value.name!r}",
            problems=problems,
            consequence="nothing was written",
            fix="remove the control characters, or shorten the text",
        )
    data = text.encode()
    if len(data) > MAX_BYTES:
        raise LimitError(
            f"cannot write the {tag.replace('_', ' ')} {value.name!r}",
            where=f"{len(data)} bytes, at most {MAX_BYTES} can be read again",
            consequence="nothing was written",
            fix="what has a row per frame belongs in a table",
        )
    return data


def _unwritable(value: Any, path: str) -> Iterator[str]:
    """What XML cannot hold, each with its path."""
    tags = {name: tag for tag, (name, _) in child_types(type(value)).items()}
    for name, role, _ in _roles(type(value)):
        item = getattr(value, name)
        if role == "children":
            for i, child in enumerate(item):
                yield from _unwritable(child, f"{path}/{tags[name]}[{i}]")
            continue
        text = " ".join(map(_number, item)) if role == "text" else _scalar(item)
        where = {"attribute": f"{path}/@{name}", "element": f"{path}/{name}", "text": path}[role]
        if found := _NOT_XML.search(text):
            yield f"{where}: U+{ord(found[0]):04X} at position {found.start()} cannot be written as XML"
        elif len(text.encode()) > _MAX_TEXT:
            yield f"{where}: {len(text.encode())} bytes, at most {_MAX_TEXT} can be read again"


_ESCAPES = {"\r": "&#13;"}
_ATTRIBUTE_ESCAPES = {"\r": "&#13;", "\n": "&#10;", "\t": "&#9;"}


def _scalar(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(value)


def _number(value: float) -> str:
    if math.isnan(value):
        return "NaN"
    if math.isinf(value):
        return "INF" if value > 0 else "-INF"
    # float: the repr of numpy's numbers names their type
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def _write(out: list[str], tag: str, value: Any, indent: str) -> None:
    attributes: list[str] = []
    children: list[tuple[str, Any]] = []
    text = ""
    kinds = child_types(type(value))
    by_field = {name: child_tag for child_tag, (name, _) in kinds.items()}
    for name, role, default in _roles(type(value)):
        item = getattr(value, name)
        if role == "children":
            children += [(by_field[name], child) for child in item]
        elif role == "text":
            text = " ".join(map(_number, item))
        elif role == "element":
            if item != default:
                children.append((name, item))
        elif item is not None and item != default:
            attributes.append(f" {name}={quoteattr(_scalar(item), _ATTRIBUTE_ESCAPES)}")
    head = f"{indent}<{tag}{''.join(attributes)}"
    if not children:
        out.append(f"{head}>{text}</{tag}>\n" if text else f"{head}/>\n")
        return
    out.append(f"{head}>{text}\n")
    for child_tag, child in children:
        if is_dataclass(child):
            _write(out, child_tag, child, indent + "  ")
        else:
            out.append(f"{indent}  <{child_tag}>{escape(str(child), _ESCAPES)}</{child_tag}>\n")
    out.append(f"{indent}</{tag}>\n")


# ---------------------------------------------------------------------------------------------------- reading


@cache
def _adapter(kind: type) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def _read(kind: type, tag: str, data: bytes, name: str) -> Any:
    root = _parse(data, name)
    problems: list[str] = []
    if root.tag != tag:
        raise FormatError(
            f"cannot read {name}",
            where=f"line {root.sourceline}: the root element is <{root.tag}>, expected <{tag}>",
            fix="name an annotation file written by ecat",
        )
    values = _collect(root, kind, f"/{tag}", problems)
    try:
        made = _adapter(kind).validate_python(values)
    except ValidationError as error:
        made = None
        problems += [
            f"{_place(kind, tag, e['loc'])}: {e['msg']}"
            for e in islice(error.errors(include_url=False), _MAX_PROBLEMS)
        ]
    if not problems:
        return made
    raise SchemaError(
        f"cannot read {name}",
        problems=tuple(problems[:_MAX_PROBLEMS]),
        consequence="the layer was not read; nothing was changed",
        fix="ecat check shows every finding; an earlier version of the file may be in version control",
    )


def _place(kind: type, tag: str, loc: tuple[int | str, ...]) -> str:
    """Where in the document a field is, given its place in the dataclasses."""
    path = f"/{tag}"
    for part in loc:
        tags = {name: (child_tag, child) for child_tag, (name, child) in child_types(kind).items()}
        role = {name: role for name, role, _ in _roles(kind)}.get(str(part))
        if isinstance(part, int):
            path += f"[{part}]"
        elif part in tags:
            child_tag, kind = tags[part]
            path += f"/{child_tag}"
        else:
            path += {"attribute": f"/@{part}", "text": "/text()"}.get(role or "", f"/{part}")
    return path


def _parse(data: bytes, name: str) -> Any:
    if len(data) > MAX_BYTES:
        raise LimitError(f"cannot read {name}", where=f"{len(data)} bytes, at most {MAX_BYTES} are read")
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data or b"\0" in data[:4096]:
        raise _not_plain(name)
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True, remove_pis=True
    )
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        where = f"line {error.lineno}: {' '.join((error.msg or 'not XML').split())}"
        raise FormatError(f"cannot read {name}", where=where) from None
    # in another encoding the bytes of a document type look different
    if root.getroottree().docinfo.internalDTD is not None:
        raise _not_plain(name)
    return root


def _not_plain(name: str) -> FormatError:
    return FormatError(
        f"cannot read {name}",
        where="it has a document type, entities or NUL bytes",
        fix="remove them: annotation files have none",
    )


def _collect(element: Any, kind: type, path: str, problems: list[str]) -> dict[str, Any]:
    """The element as nested dictionaries for validation; what would be lost is added to ``problems``."""
    values: dict[str, Any] = {}
    roles = {name: role for name, role, _ in _roles(kind)}
    choices = _choices(kind)
    for key, text in element.attrib.items():
        if roles.get(key) == "attribute":
            values[key] = choices[key].get(text, text) if key in choices else text
        else:
            _unknown(f"{path}/@{key}", "attribute", element, problems)
    texts = [name for name, role in roles.items() if role == "text"]
    for name in texts:
        values[name] = (element.text or "").split()
    if not texts and (element.text or "").strip():
        _unknown(f"{path}/text()", "text", element, problems)
    kinds = child_types(kind)
    lists: dict[str, list[Any]] = {}
    for child in element:
        if child.tag in kinds:
            name, child_kind = kinds[child.tag]
            found = lists.setdefault(name, [])
            found.append(_collect(child, child_kind, f"{path}/{child.tag}[{len(found)}]", problems))
        elif roles.get(child.tag) == "element" and child.tag not in values:
            values[child.tag] = child.text or ""
            for key in (*(f"@{name}" for name in child.attrib), *(inner.tag for inner in child)):
                _unknown(f"{path}/{child.tag}/{key}", "part", child, problems)
        else:
            _unknown(f"{path}/{child.tag}", "element", child, problems)
        if (child.tail or "").strip():
            _unknown(f"{path}/text()", "text", child, problems)
    return {**values, **{name: tuple(items) for name, items in lists.items()}}


def _unknown(path: str, what: str, element: Any, problems: list[str]) -> None:
    if len(problems) < _MAX_PROBLEMS:
        problems.append(f"{path}: unknown {what} (line {element.sourceline})")
