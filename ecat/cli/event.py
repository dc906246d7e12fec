"""``ecat event``: events and sub-events of an annotation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ecat.cli.edit import Fields, Moment, edits, given, layer_option, listing, pairs, path_argument, spans
from ecat.cli.output import Output
from ecat.cli.verb import Group, verb

_EVENT = click.argument("event", help="The event's id (`ecat event list`).")
_SPAN = "FROM:TO"


@verb(
    "list", examples=("ecat event list my_session", "ecat event list my_session --layer machine --type slide")
)
@path_argument
@layer_option
@click.option("--type", "kind", help="Only those of this type.")
@click.option("--tier", help="Only those of this tier.")
def list_(out: Output, path: Path, layer: str, kind: str | None, tier: str | None) -> None:
    """List the events of a layer."""
    from ecat.store import open_session

    rows = [
        {
            "id": event.id,
            "type": event.type,
            "tier": event.tier,
            "frames": ", ".join(f"{s.start_frame}:{s.end_frame}" for s in event.segments),
            "parent": event.parent,
            "roles": ", ".join(f"{role.name}={role.target}" for role in event.roles),
            "status": event.status + (" (unsure)" if event.unsure else ""),
            "text": event.text,
        }
        for event in open_session(path).layer(layer).events
        if kind in {None, event.type} and tier in {None, event.tier}
    ]
    listing(out, rows, ("id", "type", "tier", "frames", "parent", "roles", "status", "text"), "event")


@edits(
    "add",
    examples=(
        "ecat event add my_session --type slide --span 120:180 --role Agent=o3 --role Theme=o1",
        "ecat event add my_session --type grasp --span 4s:4.6s --parent a1",
        "ecat event add my_session --type hold --span 10:20 --span 40:50 --unsure --author ann",
    ),
)
@click.option("--type", default="", help="What happens.")
@click.option(
    "--span",
    "segments",
    multiple=True,
    required=True,
    metavar=_SPAN,
    help="When, in frames or seconds (4.2s); may be repeated.",
)
@click.option("--tier", default="", help="The tier it is on.")
@click.option("--parent", help="The event that it is part of.")
@click.option(
    "--text", default="", help="A description; names of objects in it can be found with `find-references`."
)
@click.option(
    "--role",
    "roles",
    multiple=True,
    metavar="NAME=TARGET",
    help="Who or what takes part: an object, joint or event; may be repeated.",
)
@click.option("--unsure", is_flag=True, help="Mark it as doubtful.")
@click.option("--id", help="The id that it gets; the next free one by default.")
def add(at: Moment, segments: tuple[str, ...], roles: tuple[str, ...], **fields: Any) -> Fields:
    """Add an event."""
    said = {name: value for name, value in fields.items() if value}
    return {"op": "add_event", "segments": spans(segments, at), "roles": pairs(roles, "role"), **said}


@edits(
    "edit",
    examples=(
        "ecat event edit my_session a1 --type push",
        "ecat event edit my_session a1 --text 'Ann slides Shell' --sure",
    ),
)
@_EVENT
@click.option("--type", help="What happens.")
@click.option("--tier", help="The tier it is on.")
@click.option("--text", help="A description.")
@click.option("--unsure/--sure", default=None, help="Whether it is doubtful.")
@click.option("--status", type=click.Choice(["proposed", "confirmed"]), help="Whether a person confirmed it.")
def edit(at: Moment, event: str, **fields: Any) -> Fields:
    """Change an event's type, tier, text or status."""
    del at
    return {"op": "edit_event", "id": event, **given(**fields)}


@edits(
    "remove", examples=("ecat event remove my_session a1", "ecat event remove my_session a1 --keep-children")
)
@_EVENT
@click.option("--keep-children", is_flag=True, help="Keep its sub-events, under its own parent.")
def remove(at: Moment, event: str, *, keep_children: bool) -> Fields:
    """Remove an event, its sub-events, and the links to them."""
    del at
    return {"op": "remove_event", "id": event, "children": "keep" if keep_children else "remove"}


@edits(
    "span", examples=("ecat event span my_session a1 120:180", "ecat event span my_session a1 1s:2s 4s:6s")
)
@_EVENT
@click.argument("segments", nargs=-1, required=True, metavar=f"{_SPAN}...", help="All its stretches.")
def span(at: Moment, event: str, segments: tuple[str, ...]) -> Fields:
    """Say when an event happens."""
    return {"op": "set_segments", "id": event, "segments": spans(segments, at)}


@edits(
    "edge",
    examples=(
        "ecat event edge my_session a1 end 184",
        "ecat event edge my_session a1 start 4.2s --segment 1 --clip",
    ),
)
@_EVENT
@click.argument("edge", type=click.Choice(["start", "end"]), help="Which edge.")
@click.argument("frame", help="Where to, a frame or a time (4.2s).")
@click.option("--segment", type=int, default=0, show_default=True, help="Of which stretch, from 0.")
@click.option("--clip", is_flag=True, help="Cut sub-events off that would stick out, instead of refusing.")
def edge(at: Moment, event: str, edge: str, frame: str, segment: int, *, clip: bool) -> Fields:
    """Move one edge of an event."""
    where = {"id": event, "segment": segment, "edge": edge, "frame": at(frame)}
    return {"op": "move_edge", **where, "children": "clip" if clip else "refuse"}


@edits("shift", examples=("ecat event shift my_session a1 --frames -3",))
@_EVENT
@click.option("--frames", type=int, required=True, help="By how many; negative is earlier.")
def shift(at: Moment, event: str, frames: int) -> Fields:
    """Move an event with its sub-events."""
    del at
    return {"op": "move_event", "id": event, "frames": frames}


@edits("split", examples=("ecat event split my_session a1 150",))
@_EVENT
@click.argument("frame", help="The first frame of the second part, or its time.")
def split(at: Moment, event: str, frame: str) -> Fields:
    """Make two events of one; sub-events go with the part they are in."""
    return {"op": "split_event", "id": event, "frame": at(frame)}


@edits("merge", examples=("ecat event merge my_session a1 a2",))
@click.argument("events", nargs=-1, required=True, help="The events; the first one stays.")
def merge(at: Moment, events: tuple[str, ...]) -> Fields:
    """Make one event of several."""
    del at
    return {"op": "merge_events", "ids": list(events)}


@edits("nest", examples=("ecat event nest my_session a2 --under a1", "ecat event nest my_session a2 --top"))
@_EVENT
@click.option("--under", help="The event that it is part of.")
@click.option("--top", is_flag=True, help="It is part of none.")
def nest(at: Moment, event: str, under: str | None, *, top: bool) -> Fields:
    """Make an event part of another."""
    del at
    if (under is None) != top:
        raise click.UsageError("give either --under EVENT or --top")
    return {"op": "set_parent", "id": event, "parent": under}


@edits(
    "link",
    examples=("ecat event link my_session a1 CAUSE a2", "ecat event link my_session a1 CAUSE a2 --remove"),
)
@_EVENT
@click.argument("kind", metavar="TYPE", help="CAUSE, or another of the coding scheme.")
@click.argument("target", help="The other event.")
@click.option("--remove", is_flag=True, help="Remove the link.")
def link(at: Moment, event: str, kind: str, target: str, *, remove: bool) -> Fields:
    """Link an event to another."""
    del at
    return {"op": "unlink_events" if remove else "link_events", "id": event, "type": kind, "target": target}


@edits(
    "role",
    examples=(
        "ecat event role my_session a1 Theme o1",
        "ecat event role my_session a1 Agent o3/HandRight --kind joint",
        "ecat event role my_session a1 Theme",
    ),
)
@_EVENT
@click.argument("role", help="Agent, Theme, Landmark, or another of the coding scheme.")
@click.argument("target", required=False, help="Who or what; left out, the role becomes empty.")
@click.option(
    "--kind",
    type=click.Choice(["object", "joint", "event"]),
    default="object",
    show_default=True,
    help="What the target is.",
)
def role(at: Moment, event: str, role: str, target: str | None, kind: str) -> Fields:
    """Say who or what takes part in an event."""
    del at
    return {"op": "set_role", "id": event, "role": role, "target": target, "kind": kind}


@edits(
    "slots",
    examples=(
        "ecat event slots my_session a1 --subject o3 --verb slide --object o1 --adjunct past --locative o2",
    ),
)
@_EVENT
@click.option("--subject", help="Who does it.")
@click.option("--object", help="What it is done to.")
@click.option("--locative", help="What it is done relative to.")
@click.option("--verb", help="What is done: the event's type.")
@click.option("--adjunct", help="How: toward, past, away from.")
def slots(at: Moment, event: str, **fields: str | None) -> Fields:
    """Fill the slots of the sentence that describes an event."""
    del at
    return {"op": "set_slots", "id": event, **given(**fields)}


@edits(
    "refer", examples=("ecat event refer my_session a1 0:5 o1", "ecat event refer my_session a1 0:5 --remove")
)
@_EVENT
@click.argument("characters", metavar=_SPAN, help="Which characters of the text, from 0.")
@click.argument("target", required=False, help="The object that they mean.")
@click.option("--remove", is_flag=True, help="Remove the reference.")
def refer(at: Moment, event: str, characters: str, target: str | None, *, remove: bool) -> Fields:
    """Say which object words of an event's text mean."""
    del at
    [[start, end]] = spans([characters], int)
    if remove:
        return {"op": "remove_reference", "id": event, "start": start, "end": end}
    if target is None:
        raise click.UsageError("give the object that the characters mean, or --remove")
    return {"op": "add_reference", "id": event, "start": start, "end": end, "target": target}


@edits(
    "actions",
    examples=("ecat event actions my_session a1 0:5=slide", "ecat event actions my_session a1"),
)
@_EVENT
@click.argument(
    "actions",
    nargs=-1,
    metavar="[START:END=TYPE]...",
    help="Characters of the text, from 0, and the action's type.",
)
def actions_(at: Moment, event: str, actions: tuple[str, ...]) -> Fields:
    """Say which words of an event's text name actions; those that were marked before are not any more."""
    del at
    marked = [(*spans([place], int)[0], kind) for place, kind in pairs(actions, "action").items()]
    said = [{"start": start, "end": end, "type": kind} for start, end, kind in marked]
    return {"op": "set_predicates", "id": event, "predicates": said}


@edits(
    "find-references",
    examples=("ecat event find-references my_session", "ecat event find-references my_session a1 a2"),
    of_projects=True,
)
@click.argument("events", nargs=-1, help="Of which events; all by default.")
def find_references(at: Moment, events: tuple[str, ...]) -> Fields:
    """Find the objects' names, as whole words, in the events' texts."""
    del at
    return {"op": "find_references", "ids": list(events) or None}


@edits(
    "windows",
    examples=(
        "ecat event windows my_session --step 5 --duration 20 --tier window",
        "ecat event windows my_project --step 5 --duration 20 --tier window",
    ),
    of_projects=True,
)
@click.option("--start", default=0, show_default=True, help="First frame of the first window.")
@click.option("--step", type=int, required=True, help="Frames from window to window.")
@click.option("--duration", type=int, required=True, help="Frames of each window.")
@click.option("--type", default="", help="Their type.")
@click.option("--text", default="", help="Their text.")
@click.option("--tier", default="", help="Their tier.")
@click.option(
    "--existing",
    type=click.Choice(["add", "replace", "skip", "clear"]),
    default="skip",
    show_default=True,
    help="Where an event has the same span: add another, replace it, skip the window; or clear the tier first.",
)
def windows(at: Moment, **fields: Any) -> Fields:
    """Add events at regular intervals, to be labelled one by one."""
    del at
    return {"op": "add_windows", **fields}


command = Group(
    "event",
    (
        list_,
        add,
        edit,
        remove,
        span,
        edge,
        shift,
        split,
        merge,
        nest,
        link,
        role,
        slots,
        refer,
        actions_,
        find_references,
        windows,
    ),
    """Add and change events and sub-events.

    Frames count the images of the annotated video from 0, spans exclude their end; instead of a frame a time in seconds
    since the session's start can be given (4.2s).  Every call is one step that `ecat undo` takes back.
    """,
    examples=(
        "ecat event add my_session --type slide --span 120:180 --role Theme=o1",
        "ecat event list my_session",
    ),
)
