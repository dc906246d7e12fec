"""``ecat scheme``: coding schemes."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ecat.cli.edit import Fields, Moment, edits, path_argument
from ecat.cli.output import Output
from ecat.cli.text import columns
from ecat.cli.verb import Group, verb
from ecat.errors import UsageError

if TYPE_CHECKING:
    from ecat.model import CodingScheme

_NAME = click.argument("name", help="The coding scheme's name.")


@verb("list", examples=("ecat scheme list my_session",))
@path_argument
def list_(out: Output, path: Path) -> None:
    """List the coding schemes that a session can use: its own, its project's, and those of ecat."""
    from ecat.annotate import schemes
    from ecat.store import open_session

    session = open_session(path)
    found = [schemes.find_scheme(session, name) for name in schemes.scheme_names(session)]
    rows = [
        [s.name, s.version, f"{len(s.event_types)} event types", f"{len(s.predicates)} predicates"]
        for s in found
    ]
    out.result({"schemes": [asdict(scheme) for scheme in found]}, columns(rows))


@verb("show", examples=("ecat scheme show my_session blocks",))
@path_argument
@_NAME
def show(out: Output, path: Path, name: str) -> None:
    """Show what a coding scheme allows to say."""
    from ecat.annotate import schemes
    from ecat.store import open_session

    scheme = schemes.find_scheme(open_session(path), name)
    out.result({"scheme": asdict(scheme)}, _text(scheme))


def _text(scheme: CodingScheme) -> str:
    tiers = [
        [tier.name, f"under {tier.parent}" if tier.parent else "", tier.constraint] for tier in scheme.tiers
    ]
    types = [
        [
            kind.name,
            kind.tier,
            kind.key,
            " ".join(role.name + ("" if role.required else "?") for role in kind.roles),
        ]
        for kind in scheme.event_types
    ]
    facts = [[p.name, f"{p.arity} {p.target}" + ("" if p.arity == 1 else "s")] for p in scheme.predicates]
    rules = [[c.kind, c.predicates, str(c.unique_argument or "")] for c in scheme.constraints]
    things = [[kind.name, kind.types, kind.head, kind.concavity] for kind in scheme.object_types]
    parts = (
        ("tiers", tiers),
        ("event types", types),
        ("object types", things),
        ("predicates", facts),
        ("constraints", rules),
    )
    closed = "nothing else may be said" if scheme.closed else "other types may be used too"
    lines = [f"{scheme.name} {scheme.version}: {closed}"]
    for title, rows in parts:
        if rows:
            lines += [f"{title}:", columns(rows, indent=2)]
    return "\n".join(lines)


@edits(
    "set", examples=("ecat scheme set my_session blocks", "ecat scheme set my_session ecat-2018 --layer ann")
)
@_NAME
def set_(at: Moment, name: str) -> Fields:
    """Let a layer follow a coding scheme; undo takes it back."""
    del at
    return {"op": "set_scheme", "name": name}


@verb(
    "import",
    examples=(
        "ecat scheme import my_session kitchen.scheme.xml",
        "ecat scheme import my_session option.txt --name lab",
        "ecat scheme import my_session cup.xml --name lab",
    ),
)
@path_argument
@click.argument(
    "source", type=click.Path(path_type=Path), help="A .scheme.xml, ECAT's option.txt, or a VoxML entry."
)
@click.option("--name", help="Its name here; of a VoxML entry the scheme that it is added to.")
def import_(out: Output, path: Path, source: Path, name: str | None) -> None:
    """Add a coding scheme to a session or project, or a VoxML entry to one of its schemes."""
    from ecat.annotate import schemes
    from ecat.formats.ecat2018.scheme_import import read_any_scheme, with_entry
    from ecat.model import CodingScheme

    found = read_any_scheme(source, name or "")
    replaces = not isinstance(found, CodingScheme)
    if replaces:
        if name is None:
            raise UsageError(
                f"cannot import {source.name}",
                where="a VoxML entry is part of a coding scheme",
                fix="name the scheme with --name; a new one begins as a copy of ecat-2018",
            )
        found = with_entry(schemes.scheme_to_extend(path, name), found, source.stem)
    dest = schemes.scheme_file(path, found.name)
    schemes.write_scheme(found, dest, overwrite=replaces)
    out.result(
        {"scheme": asdict(found), "file": str(dest)},
        f"{_text(found)}\ntry: ecat scheme set SESSION {found.name}",
    )


@verb("export", examples=("ecat scheme export my_session blocks blocks.scheme.xml",))
@path_argument
@_NAME
@click.argument("dest", type=click.Path(path_type=Path), help="The file to write.")
def export(out: Output, path: Path, name: str, dest: Path) -> None:
    """Write a coding scheme to a file, to change it or to use it elsewhere."""
    from ecat.annotate import schemes
    from ecat.store import open_session

    schemes.write_scheme(schemes.find_scheme(open_session(path), name), dest)
    out.result({"file": str(dest)}, f"wrote {dest}")


command = Group(
    "scheme",
    (list_, show, set_, import_, export),
    """Use coding schemes: which tiers, event types, roles and predicates an annotation has, and their constraints.""",
    examples=("ecat scheme list my_session", "ecat scheme set my_session blocks"),
)
