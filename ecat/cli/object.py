"""``ecat object``: objects of an annotation, and where they are drawn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ecat.cli.edit import Fields, Moment, edits, given, layer_option, listing, numbers, path_argument
from ecat.cli.output import Output
from ecat.cli.verb import Group, verb

_OBJECT = click.argument("name", metavar="OBJECT", help="The object's id (`ecat object list`).")
_FRAME = click.argument("frame", help="A frame, or a time (4.2s).")
_SHAPE = "rectangle: u,v,width,height; polygon: u1,v1,u2,v2,...; point: u,v; pixels of the image as stored"


@verb("list", examples=("ecat object list my_session", "ecat object list my_session --layer machine --json"))
@path_argument
@layer_option
def list_(out: Output, path: Path, layer: str) -> None:
    """List the objects of a layer."""
    from ecat.store import open_session

    rows = [
        {
            "id": thing.id,
            "name": thing.name,
            "kind": thing.kind,
            "semantic_type": thing.semantic_type,
            "key_frames": len(thing.key_frames) + len(thing.key_frames_3d),
            "color": thing.color,
            "properties": {p.name: p.value for p in thing.properties},
        }
        for thing in open_session(path).layer(layer).objects
    ]
    listing(out, rows, ("id", "name", "kind", "semantic_type", "key_frames", "color"), "object")


@edits(
    "add",
    examples=(
        "ecat object add my_session --name mug --kind rectangle --frame 10 --shape 320,200,64,48",
        "ecat object add my_session --name table --kind polygon --frame 0 --shape 10,10,600,12,610,400,8,390",
        "ecat object add my_session --name performer --kind rig",
    ),
)
@click.option("--name", default="", help="What people call it.")
@click.option(
    "--kind",
    type=click.Choice(["rectangle", "polygon", "point", "marker_box", "rig", "other"]),
    required=True,
    help="What it is drawn as; marker_box and rig have their marks in tables.",
)
@click.option("--frame", help="Where its first shape is drawn: a frame, or a time (4.2s).")
@click.option("--shape", "coordinates", metavar="NUMBERS", help=_SHAPE)
@click.option("--stream", default="", help="The video it is drawn in; the annotated one by default.")
@click.option("--color", help="#rrggbb; the next of a palette by default.")
@click.option("--semantic-type", default="", help="A concept, for instance a VoxML entry.")
@click.option(
    "--interpolation", type=click.Choice(["linear", "hold"]), help="What happens between key frames."
)
@click.option("--id", help="The id that it gets; the next free one by default.")
def add(at: Moment, frame: str | None, coordinates: str | None, **fields: Any) -> Fields:
    """Add an object."""
    said = {name: value for name, value in fields.items() if value}
    drawn = given(
        frame=None if frame is None else at(frame),
        coordinates=None if coordinates is None else numbers(coordinates),
    )
    return {"op": "add_object", **said, **drawn}


@edits("edit", examples=("ecat object edit my_session o1 --name cup --color '#3377ff'",))
@_OBJECT
@click.option("--name", "called", help="What people call it.")
@click.option("--color", help="#rrggbb.")
@click.option("--line-width", type=int, help="Of its outline, pixels.")
@click.option("--semantic-type", help="A concept, for instance a VoxML entry.")
@click.option("--stream", help="The video it is drawn in.")
@click.option(
    "--interpolation", type=click.Choice(["linear", "hold"]), help="What happens between key frames."
)
def edit(at: Moment, name: str, called: str | None, **fields: Any) -> Fields:
    """Change an object's name, looks or type."""
    del at
    return {"op": "edit_object", "id": name, **given(name=called, **fields)}


@edits("remove", examples=("ecat object remove my_session o1",))
@_OBJECT
def remove(at: Moment, name: str) -> Fields:
    """Remove an object with its relations, and its roles in events."""
    del at
    return {"op": "remove_object", "id": name}


@edits("draw", examples=("ecat object draw my_session o1 45 --shape 330,210,64,48",))
@_OBJECT
@_FRAME
@click.option("--shape", "coordinates", required=True, metavar="NUMBERS", help=_SHAPE)
@click.option(
    "--dimensions",
    type=click.IntRange(2, 3),
    default=2,
    show_default=True,
    help="2: pixels; 3: metres x1,y1,z1,...",
)
def draw(at: Moment, name: str, frame: str, coordinates: str, dimensions: int) -> Fields:
    """Say where an object is at a frame: a key frame."""
    where = {"object": name, "frame": at(frame), "coordinates": numbers(coordinates)}
    return {"op": "set_key_frame", **where, "dimensions": dimensions}


@edits("absent", examples=("ecat object absent my_session o1 90",))
@_OBJECT
@_FRAME
def absent(at: Moment, name: str, frame: str) -> Fields:
    """Say that an object is not there from a frame on."""
    return {"op": "set_absent", "object": name, "frame": at(frame)}


@edits("present", examples=("ecat object present my_session o1 10 90",))
@_OBJECT
@click.argument("start", help="From this frame, or time,")
@click.argument("end", help="until before this one.")
def present(at: Moment, name: str, start: str, end: str) -> Fields:
    """Say when an object is there."""
    return {"op": "set_presence", "object": name, "start_frame": at(start), "end_frame": at(end)}


@edits("erase", examples=("ecat object erase my_session o1 45",))
@_OBJECT
@_FRAME
@click.option(
    "--dimensions", type=click.IntRange(2, 3), default=2, show_default=True, help="2: pixels; 3: metres."
)
def erase(at: Moment, name: str, frame: str, dimensions: int) -> Fields:
    """Remove an object's key frame."""
    return {"op": "remove_key_frame", "object": name, "frame": at(frame), "dimensions": dimensions}


@edits(
    "property",
    examples=(
        "ecat object property my_session o1 material wood",
        "ecat object property my_session o1 material",
    ),
)
@click.argument("target", help="The object's id, or an event's.")
@click.argument("key", help="The property's name.")
@click.argument("value", required=False, help="Its value; left out, the property is removed.")
def property_(at: Moment, target: str, key: str, value: str | None) -> Fields:
    """Give an object, or an event, a property of its own."""
    del at
    return {"op": "set_property", "target": target, "name": key, "value": value}


@edits("copy", examples=("ecat object copy my_session --from earlier_session --frame 0",))
@click.option("--from", "source", required=True, help="The name of another session of the project.")
@click.option("--object", "objects", multiple=True, help="Which of its objects; all by default.")
@click.option("--frame", default="0", show_default=True, help="Where they appear here.")
@click.option(
    "--mode",
    type=click.Choice(["last_frame", "last_appearance"]),
    default="last_frame",
    show_default=True,
    help="Take those there at its last frame, or all as they were last seen.",
)
def copy(at: Moment, source: str, objects: tuple[str, ...], frame: str, mode: str) -> Fields:
    """Take objects over from another session, with the relations that hold at its end."""
    said = {"session": source, "objects": list(objects) or None, "frame": at(frame), "mode": mode}
    return {"op": "copy_objects", **said}


command = Group(
    "object",
    (list_, add, edit, remove, draw, absent, present, erase, property_, copy),
    """Add and change objects, and where they are drawn.

    Between two key frames an object is interpolated; `absent` ends its presence.  Every call is one step that
    `ecat undo` takes back.
    """,
    examples=(
        "ecat object add my_session --name mug --kind rectangle --frame 10 --shape 320,200,64,48",
        "ecat object list my_session",
    ),
)
