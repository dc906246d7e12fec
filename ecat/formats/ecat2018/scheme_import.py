"""What ECAT's ``option.txt`` and VoxML entries say, as coding schemes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ecat.errors import FormatError
from ecat.formats.ecat2018.coding_scheme import coding_scheme
from ecat.formats.ecat2018.options import read_options
from ecat.formats.ecat2018.voxml import VoxmlEntry, read_voxml
from ecat.model import CodingScheme, EventType, ObjectType
from ecat.store import files
from ecat.store.schemes import read_scheme

_HEAD_BYTES = 4096
_PROGRAM = "program"


def read_any_scheme(source: Path, name: str) -> CodingScheme | VoxmlEntry:
    """A coding scheme called ``name`` (its own name if that is empty), or a VoxML entry, whichever ``source`` is.

    Raises
    ------
    FormatError, SchemaError, LimitError : it is neither a ``.scheme.xml``, nor an ``option.txt``, nor a VoxML entry, or
        it is damaged.
    """
    with files.typed_errors(f"cannot read {source.name}", source), files.open_regular(source) as file:
        head = file.read(_HEAD_BYTES)
    if b"<coding_scheme" in head:
        scheme = read_scheme(source)
        return replace(scheme, name=name) if name else scheme
    if b"<Options" in head:
        return coding_scheme(read_options(source), name=name or source.stem)
    if b"<VoxML" in head:
        return read_voxml(source)
    raise FormatError(
        f"cannot read {source.name}",
        where=f"{source}: neither a coding scheme, nor ECAT's options, nor a VoxML entry",
        consequence="nothing was changed",
        fix="give a .scheme.xml, an option.txt, or a VoxML file",
    )


def with_entry(scheme: CodingScheme, entry: VoxmlEntry, name: str) -> CodingScheme:
    """``scheme`` with a VoxML entry, instead of the one of the same name: a program is an event type, else an object's.

    ``name`` is what the entry is called if it does not say so itself.
    """
    called = entry.lex.pred or name
    if _PROGRAM in {kind.lower() for kind in entry.lex.types} or entry.type.head == "process":
        program = next((t for t in scheme.event_types if t.name == called), EventType(name=called))
        others = tuple(t for t in scheme.event_types if t.name != called)
        return replace(scheme, event_types=(*others, replace(program, voxml=called)))
    thing = ObjectType(
        name=called,
        types="*".join(entry.lex.types),
        head=entry.type.head or "",
        concavity=entry.type.concavity or "",
        affordances="\n".join(entry.affordances),
    )
    return replace(scheme, object_types=(*(t for t in scheme.object_types if t.name != called), thing))
