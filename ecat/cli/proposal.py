"""``ecat proposal``: what the machine proposes, and what people make of it."""

from __future__ import annotations

from pathlib import Path

import click

from ecat.cli.edit import Fields, Moment, edits, given, layer_option, listing, path_argument
from ecat.cli.output import Output
from ecat.cli.verb import Group, verb

_PROPOSALS = click.argument(
    "proposals", nargs=-1, required=True, metavar="PROPOSAL...", help="Their ids (`ecat proposal list`)."
)


@verb("list", examples=("ecat proposal list my_session", "ecat proposal list my_session --layer ann --open"))
@path_argument
@layer_option
@click.option("--open", "undecided", is_flag=True, help="Only those that this layer says nothing about.")
def list_(out: Output, path: Path, layer: str, *, undecided: bool) -> None:
    """List what is proposed, and what a layer decided about it."""
    from ecat.annotate.queries import proposals
    from ecat.store import open_session

    rows = proposals(open_session(path), layer)
    rows = [row for row in rows if not undecided or row["decision"] is None]
    listing(out, rows, ("proposal", "what", "frames", "confidence", "decision", "result"), "proposal")


@edits(
    "accept",
    examples=(
        "ecat proposal accept my_session machine/p1",
        "ecat proposal accept my_session machine/p1 --from 118 --type slide_past",
    ),
)
@_PROPOSALS
@click.option("--from", "start", metavar="FRAME", help="But it starts here.")
@click.option("--to", "end", metavar="FRAME", help="But it ends before here.")
@click.option("--type", "kind", help="But it is this.")
def accept(
    at: Moment, proposals: tuple[str, ...], start: str | None, end: str | None, kind: str | None
) -> list[Fields]:
    """Take proposed events, with their sub-events, and relations over as confirmed."""
    but = given(
        start_frame=None if start is None else at(start),
        end_frame=None if end is None else at(end),
        type=kind,
    )
    return [{"op": "accept_proposal", "proposal": proposal, **but} for proposal in proposals]


@edits("reject", examples=("ecat proposal reject my_session machine/p2 machine/p3",))
@_PROPOSALS
def reject(at: Moment, proposals: tuple[str, ...]) -> list[Fields]:
    """Note that proposals are wrong; they are not shown again."""
    del at
    return [{"op": "reject_proposal", "proposal": proposal} for proposal in proposals]


command = Group(
    "proposal",
    (list_, accept, reject),
    """Decide about what `ecat process` proposes: events with their parts, and relations.

    What is accepted is copied into the layer as confirmed; the proposals themselves stay as they are.
    """,
    examples=("ecat proposal list my_session", "ecat proposal accept my_session machine/p1"),
)
