"""Operations at random, most of which can be done."""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import Any

from ecat.annotate import OPERATIONS
from ecat.model import AnnotatedObject, Event, KeyFrame, Layer, Relation, Role, Segment
from ecat.model.annotation import Argument
from tests.annotate.bench import N_FRAMES, event, op, relation, thing

CAUSE = Role(name="Cause", target="a1", kind="event")
MACHINE = Layer(
    name="machine",
    events=(
        Event(id="a1", type="slide", segments=(Segment(start_frame=5, end_frame=30),), status="proposed"),
        Event(id="a2", parent="a1", segments=(Segment(start_frame=6, end_frame=9),), status="proposed"),
        Event(id="a3", segments=(Segment(start_frame=40, end_frame=50),), roles=(CAUSE,)),
    ),
    relations=(Relation(id="r1", predicate="ON", start_frame=3, arguments=(Argument(target="o1"),)),),
)  # fmt: skip

OTHER = Layer(
    objects=(
        AnnotatedObject(
            id="o4", name="cup", kind="point", key_frames=(KeyFrame(frame=3, coordinates=(1.0, 2.0)),)
        ),
        AnnotatedObject(id="o5", name="gone", kind="point", key_frames=(KeyFrame(frame=3, present=False),)),
    ),
    relations=(Relation(id="r1", predicate="STAND", start_frame=3, arguments=(Argument(target="o4"),)),),
)
BEGINNING = [
    thing("cup", "rectangle", frame=3, coordinates=[1, 2, 3, 4]),
    thing("box", "polygon", frame=0, coordinates=[1, 2, 3, 4, 5, 6]),
    event(2, 50, text="cup on box", tier="event"),
    event(4, 20, parent="a1", tier="sub-event"),
    event(60, 70, tier="event", roles={"Theme": "o1"}),
    event(80, 90, text="cup", roles={"Cause": "a3"}),
    relation("ON", "o1", "o2"),
    op("link_events", id="a1", type="CAUSE", target="a3"),
    op("add_reference", id="a1", start=0, end=3, target="o1"),
    op("add_segment", id="a3", start_frame=72, end_frame=75),
]
"""Nothing happens to a layer without anything in it."""


class Chance:
    """Draws values for the fields of operations on ``layer``."""

    def __init__(self, random: Random, layer: Layer) -> None:
        self.random = random
        self.layer = layer

    def id(self, *kinds: str) -> str:
        """The id of an element, mostly of one that there is."""
        ids = [item.id for kind in kinds for item in getattr(self.layer, f"{kind}s")]
        return self.one(*ids * 8, "x99")

    def one(self, *values: Any) -> Any:
        """One of the values."""
        return self.random.choice(values)

    def maybe(self, value: Any) -> Any:
        """The value, or nothing."""
        return self.one(value, None)

    def frame(self) -> int:
        """A frame, mostly where things are."""
        near = self.random.randrange(90)
        return self.one(near, near, near, near, self.random.randrange(-1, N_FRAMES + 2))

    def span(self) -> list[int]:
        """A stretch, mostly a short one."""
        start = self.frame()
        return [start, start + self.random.choice([0, 1, 5, 5, 20, 40])]

    def text(self) -> str:
        """A text, or the name of an object."""
        return self.one("", "cup", "Cup beside the cup", "box", "put the box on the cup, cupboard")

    def kind(self) -> str:
        """The type of an event."""
        return self.one("", "slide_next", "grasp", "move")

    def tier(self) -> str:
        """A tier."""
        return self.one("", "event", "event", "sub-event")

    def mark(self) -> dict[str, int]:
        """Characters of a text."""
        start, end = self.one((0, 3), (4, 6), (7, 10), (2, 8), (5, 5), (7, 40))
        return {"start": start, "end": end}

    def proposal(self) -> str:
        """A proposal."""
        return self.one("machine/a1", "machine/a2", "machine/a3", "machine/r1", "machine/a9")


ANYTHING: dict[str, Callable[[Chance], dict[str, Any]]] = {
    "add_object": lambda c: {
        "kind": "rectangle", "name": c.text(), "frame": c.frame(), "coordinates": [1, 2, 3, c.one(4, 4, 4, 0)],
    },
    "edit_object": lambda c: {"id": c.id("object"), "name": c.text(), "interpolation": c.one("linear", "hold")},
    "remove_object": lambda c: {"id": c.id("object")},
    "set_property": lambda c: {"target": c.id("object", "event"), "name": c.one("a", "b"), "value": c.maybe(c.text())},
    "set_key_frame": lambda c: {"object": c.id("object"), "frame": c.frame(), "coordinates": c.maybe([5, 6, 7, 8])},
    "set_absent": lambda c: {"object": c.id("object"), "frame": c.frame()},
    "remove_key_frame": lambda c: {"object": c.id("object"), "frame": c.one(0, 3, c.frame())},
    "set_presence": lambda c: {
        "object": c.id("object"), "present": c.one(True, False),
        **dict(zip(("start_frame", "end_frame"), c.one(c.span(), [c.frame(), None]), strict=True)),
    },
    "copy_objects": lambda c: {"session": "other", "frame": c.frame(), "mode": c.one("last_frame", "last_appearance")},
    "add_event": lambda c: {
        "segments": [c.span() for _ in range(c.one(1, 1, 2))], "type": c.kind(), "tier": c.tier(),
        "parent": c.one(None, None, c.id("event")), "text": c.text(), "roles": c.one({}, {"Theme": c.id("object")}),
    },
    "edit_event": lambda c: {"id": c.id("event"), "text": c.text(), "tier": c.maybe(c.tier()), "type": c.kind()},
    "remove_event": lambda c: {"id": c.id("event"), "children": c.one("remove", "keep")},
    "set_segments": lambda c: {"id": c.id("event"), "segments": [c.span() for _ in range(c.one(0, 1, 1, 2))]},
    "move_edge": lambda c: {
        "id": c.id("event"), "edge": c.one("start", "end"), "frame": c.frame(), "segment": c.one(0, 0, 0, 1),
        "children": c.one("refuse", "clip"),
    },
    "move_event": lambda c: {"id": c.id("event"), "frames": c.one(-3, -1, 2, 40)},
    "add_segment": lambda c: {
        "id": c.id("event"), **dict(zip(("start_frame", "end_frame"), c.span(), strict=True)),
    },
    "remove_segment": lambda c: {"id": c.id("event"), "segment": c.one(0, 0, 1, 2)},
    "split_event": lambda c: {"id": c.id("event"), "frame": c.frame()},
    "merge_events": lambda c: {"ids": [c.id("event") for _ in range(c.one(1, 2, 2, 3))]},
    "set_parent": lambda c: {"id": c.id("event"), "parent": c.maybe(c.id("event"))},
    "link_events": lambda c: {"id": c.id("event"), "type": "CAUSE", "target": c.id("event")},
    "unlink_events": lambda c: {
        "id": c.one("a1", c.id("event")), "type": "CAUSE", "target": c.one("a3", c.id("event")),
    },
    "set_role": lambda c: {
        "id": c.id("event"), "role": c.one("Agent", "Theme"), "target": c.maybe(c.id("object", "event")),
    },
    "add_reference": lambda c: {"id": c.id("event"), "target": c.id("object"), **c.mark()},
    "remove_reference": lambda c: {"id": c.id("event"), **c.one({"start": 0, "end": 3}, c.mark())},
    "find_references": lambda _: {},
    "set_predicates": lambda c: {"id": c.id("event"), "predicates": [{**c.mark(), "type": "put"}]},
    "set_slots": lambda c: {
        "id": c.id("event"), "subject": c.maybe(c.id("object")), "verb": c.kind(), "adjunct": c.maybe(c.text()),
    },
    "add_relation": lambda c: {
        "predicate": c.one("ON", "STAND", "SIT", "LOOK_AT"), "polarity": c.one(True, False),
        "start_frame": c.frame(), "arguments": [c.id("object") for _ in range(c.one(1, 2))], "end_frame": c.maybe(95),
    },
    "edit_relation": lambda c: {
        "id": c.id("relation"), "start_frame": c.maybe(c.frame()), "polarity": c.one(True, False),
    },
    "remove_relation": lambda c: {"id": c.id("relation")},
    "accept_proposal": lambda c: {
        "proposal": c.proposal(), "start_frame": c.one(None, None, c.frame()),
        "end_frame": c.one(None, None, c.frame()),
    },
    "reject_proposal": lambda c: {"proposal": c.proposal()},
    "set_scheme": lambda _: {"name": ""},
    "add_windows": lambda c: {
        "start": c.frame(), "step": c.one(100, 400), "duration": c.one(20, 80), "tier": c.tier(),
        "existing": c.one("add", "replace", "skip", "clear"),
    },
}  # fmt: skip
"""The fields of every operation but its name."""
assert ANYTHING.keys() == OPERATIONS.keys()


def anything(random: Random, layer: Layer) -> dict[str, Any]:
    """Anything that may be asked of a layer."""
    name = random.choice(list(ANYTHING))
    return op(name, **ANYTHING[name](Chance(random, layer)))
