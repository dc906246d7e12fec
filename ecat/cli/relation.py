"""``ecat relation``: what holds between objects."""

from __future__ import annotations

from pathlib import Path

import click

from ecat.cli.edit import Fields, Moment, edits, given, layer_option, listing, moments, path_argument
from ecat.cli.output import Output
from ecat.cli.verb import Group, verb

_RELATION = click.argument("relation", help="The relation's id (`ecat relation list`).")


@verb("list", examples=("ecat relation list my_session", "ecat relation list my_session --at 120"))
@path_argument
@layer_option
@click.option("--at", "when", metavar="FRAME", help="Only what holds at this frame, or time (4.2s).")
def list_(out: Output, path: Path, layer: str, when: str | None) -> None:
    """List the relations of a layer."""
    from ecat.annotate.queries import holding_at
    from ecat.store import open_session

    session = open_session(path)
    said = session.layer(layer)
    holding = None if when is None else holding_at(session, said, moments(session)(when))
    rows = [
        {
            "id": fact.id,
            "predicate": fact.predicate,
            "arguments": " ".join(fact.targets),
            "holds": "yes" if fact.polarity else "denied",
            "from": fact.start_frame,
            "to": fact.end_frame,
            "source": fact.source,
            "status": fact.status,
        }
        for fact in said.relations
        if holding is None or fact.id in holding
    ]
    listing(
        out, rows, ("id", "predicate", "arguments", "holds", "from", "to", "source", "status"), "relation"
    )


@edits(
    "add",
    examples=(
        "ecat relation add my_session ON o1 o2 --from 30 --to 90",
        "ecat relation add my_session LOOK_AT o3 o1 --from 4.2s",
        "ecat relation add my_session SUPPORT o2 o1 --from 90 --denied",
    ),
)
@click.argument("predicate", help="What holds: ON, SUPPORT, LOOK_AT, or another of the coding scheme.")
@click.argument(
    "arguments",
    nargs=-1,
    required=True,
    metavar="OBJECT...",
    help="Of which objects, in order; SESSION/ID for one of another session.",
)
@click.option("--from", "start", required=True, metavar="FRAME", help="From this frame, or time (4.2s),")
@click.option(
    "--to", "end", metavar="FRAME", help="until before this one; by default until it is contradicted."
)
@click.option("--denied", is_flag=True, help="It does not hold: the end of an earlier fact.")
def add(
    at: Moment, predicate: str, arguments: tuple[str, ...], start: str, end: str | None, *, denied: bool
) -> Fields:
    """Say that something holds between objects."""
    when = given(start_frame=at(start), end_frame=None if end is None else at(end))
    return {
        "op": "add_relation",
        "predicate": predicate,
        "arguments": list(arguments),
        "polarity": not denied,
        **when,
    }


@edits("edit", examples=("ecat relation edit my_session r1 --to 95",))
@_RELATION
@click.option("--predicate", help="What holds.")
@click.option("--from", "start", metavar="FRAME", help="From this frame, or time.")
@click.option("--to", "end", metavar="FRAME", help="Until before this one.")
@click.option("--denied/--holds", "denied", default=None, help="Whether it is denied.")
def edit(
    at: Moment,
    relation: str,
    predicate: str | None,
    start: str | None,
    end: str | None,
    *,
    denied: bool | None,
) -> Fields:
    """Change a relation."""
    when = given(
        start_frame=None if start is None else at(start),
        end_frame=None if end is None else at(end),
        polarity=None if denied is None else not denied,
    )
    return {"op": "edit_relation", "id": relation, **given(predicate=predicate), **when}


@edits("remove", examples=("ecat relation remove my_session r1",))
@_RELATION
def remove(at: Moment, relation: str) -> Fields:
    """Remove a relation."""
    del at
    return {"op": "remove_relation", "id": relation}


command = Group(
    "relation",
    (list_, add, edit, remove),
    """Add and change relations between objects: what holds, of what, and when.

    A fact that the coding scheme does not allow together with an earlier one ends it.  Every call is one step that
    `ecat undo` takes back.
    """,
    examples=("ecat relation add my_session ON o1 o2 --from 30", "ecat relation list my_session --at 120"),
)
