"""What an annotator would say about a sample: objects, events with sub-events, relations."""

from __future__ import annotations

from itertools import count

import numpy as np

from ecat.geometry.transforms import Floats
from ecat.model import (
    AnnotatedObject,
    CodingScheme,
    Event,
    EventType,
    KeyFrame,
    Layer,
    Link,
    PredicateType,
    Relation,
    Role,
    RoleType,
    Segment,
    TextPredicate,
    TextReference,
    Tier,
)
from ecat.model.annotation import Argument, with_relation_ids
from ecat.sample.scene import TABLE_OUTLINE_M
from ecat.sample.script import Carry, Move
from ecat.sample.sensor import NoiseModel
from ecat.sample.truth import GroundTruth, runs

RIG_ID, TABLE_ID = "o1", "o4"
STREAM = "color"
TOUCHING_M, NEAR_M, ON_M = 0.005, 0.1, 0.002
"""Free distance up to which two cubes touch or are near; height up to which a cube is on the table."""
_AUTHOR = "sample"
_PREPOSITIONS = {
    "next": "next to",
    "past": "past",
    "around": "around",
    "toward": "toward",
    "away": "away from",
}
_PARTS = ("grasp", "hold", "move", "release")

_ARGUMENTS = tuple(RoleType(name=name, required=True) for name in ("Agent", "Theme", "Landmark"))
_HAND = (RoleType(name="Agent", kind="joint", required=True), RoleType(name="Theme", required=True))
SCHEME = CodingScheme(
    name="ecat-sample",
    tiers=(Tier(name="event"), Tier(name="sub-event", parent="event", constraint="included_in")),
    event_types=(
        *(
            EventType(name=f"slide_{kind}", tier="event", voxml="slide", roles=_ARGUMENTS)
            for kind in _PREPOSITIONS
        ),
        *(EventType(name=part, tier="sub-event", voxml=part, roles=_HAND) for part in _PARTS),
    ),
    predicates=(
        *(PredicateType(name=name) for name in ("ON", "TOUCHING", "NEAR")),
        *(PredicateType(name=name, target="event") for name in ("SUBEVENT", "CAUSE")),
    ),
)
"""The coding scheme that sample annotations follow."""


def annotate(truth: GroundTruth, noise: NoiseModel, rng: np.random.Generator) -> Layer:
    """The layer ``main`` of a sample session."""
    objects = (_rig(), *_boxes(truth), _table(truth, noise, rng))
    events = _events(truth)
    made = Layer(
        name="main",
        object_counter=len(objects),
        event_counter=len(events),
        scheme=SCHEME.name,
        objects=objects,
        events=events,
        relations=_relations(truth),
    )
    return with_relation_ids(made)


# ---------------------------------------------------------------------------------------------- objects


def _rig() -> AnnotatedObject:
    return AnnotatedObject(
        id=RIG_ID,
        name="Performer 1",
        kind="rig",
        origin="provided",
        dimensions=3,
        semantic_type="bodyRig",
        stream=STREAM,
        color="#008000ff",
    )


def _boxes(truth: GroundTruth) -> tuple[AnnotatedObject, ...]:
    return tuple(
        AnnotatedObject(
            id=object_id,
            name=box.name,
            kind="marker_box",
            origin="tracked",
            dimensions=3,
            stream=STREAM,
            color="#000000ff",
        )
        for object_id, box in zip(truth.object_ids, truth.prototypes, strict=True)
    )


def _table(truth: GroundTruth, noise: NoiseModel, rng: np.random.Generator) -> AnnotatedObject:
    """The table top, outlined by hand at the first image and again in the middle."""
    frames = (0, truth.n_frames // 2)
    pixels = truth.scene.pixels(TABLE_OUTLINE_M)
    space = truth.scene.depth_from_table.apply(TABLE_OUTLINE_M)

    def error(sigma: float, dimensions: int) -> Floats:
        return rng.normal(0, 1, (len(TABLE_OUTLINE_M), dimensions)) * sigma

    return AnnotatedObject(
        id=TABLE_ID,
        name="table",
        kind="polygon",
        dimensions=3,
        semantic_type="table",
        stream=STREAM,
        key_frames=tuple(_key(truth, f, pixels + error(noise.polygon_px, 2), 3) for f in frames),
        key_frames_3d=tuple(_key(truth, f, space + error(noise.polygon_m, 3), 6) for f in frames),
    )


def _key(truth: GroundTruth, frame: int, drawn: Floats, digits: int) -> KeyFrame:
    return KeyFrame(
        frame=frame,
        t_ns=truth.clock.t_ns(frame, truth.n_frames),
        coordinates=tuple(np.round(drawn, digits).ravel().tolist()),
    )


# ----------------------------------------------------------------------------------------------- events


def _segment(truth: GroundTruth, start: int, end: int) -> Segment:
    return Segment(
        start_frame=start,
        end_frame=end,
        start_ns=truth.clock.t_ns(start, truth.n_frames),
        end_ns=truth.clock.t_ns(end, truth.n_frames),
    )


def _events(truth: GroundTruth) -> tuple[Event, ...]:
    """Each action followed by its parts; rearrangements between actions are not annotated."""
    ids = (f"a{number}" for number in count(1))
    events: list[Event] = []
    for move in truth.moves:
        if move.kind == "set":
            continue
        action = _action(truth, move, next(ids))
        events.append(action)
        for carry in move.carries:
            names = {"action": action.id} | {part: next(ids) for part in _PARTS}
            events += [_part(truth, move, carry, part, names) for part in _PARTS]
    return tuple(events)


def _action(truth: GroundTruth, move: Move, event_id: str) -> Event:
    """From the first touch to the last; not while the hand is away in between."""
    theme, landmark = truth.prototypes[move.box].name, truth.prototypes[move.landmark].name
    theme_id, landmark_id = truth.object_ids[move.box], truth.object_ids[move.landmark]
    text = f"Slide {theme} {_PREPOSITIONS[move.kind]} {landmark}"
    spans = ((text.index(theme), theme, theme_id), (text.rindex(landmark), landmark, landmark_id))
    return Event(
        id=event_id,
        type=f"slide_{move.kind}",
        tier="event",
        author=_AUTHOR,
        text=text,
        segments=tuple(_segment(truth, carry.grasp, carry.retreat) for carry in move.carries),
        roles=(
            Role(name="Agent", target=RIG_ID),
            Role(name="Theme", target=theme_id),
            Role(name="Landmark", target=landmark_id),
        ),
        references=tuple(TextReference(start=s, end=s + len(named), target=t) for s, named, t in spans),
        predicates=(TextPredicate(start=0, end=len("Slide"), type="slide"),),
    )


def _part(truth: GroundTruth, move: Move, carry: Carry, part: str, ids: dict[str, str]) -> Event:
    """One part of a carry: grasp, hold and release follow one another, the movement lies within the hold."""
    start, end = {
        "grasp": (carry.grasp, carry.hold),
        "hold": (carry.hold, carry.release),
        "move": (carry.move, carry.still),
        "release": (carry.release, carry.retreat),
    }[part]
    return Event(
        id=ids[part],
        type=part,
        tier="sub-event",
        parent=ids["action"],
        author=_AUTHOR,
        segments=(_segment(truth, start, end),),
        roles=(
            Role(name="Agent", target=f"{RIG_ID}/{move.hand}", kind="joint"),
            Role(name="Theme", target=truth.object_ids[move.box]),
        ),
        links=(Link(type="CAUSE", target=ids["move"]),) if part == "hold" else (),
    )


# -------------------------------------------------------------------------------------------- relations


def _relations(truth: GroundTruth) -> tuple[Relation, ...]:
    """ON, TOUCHING and NEAR wherever the geometry has them; one denial: the cubes do not touch at first."""
    pair = truth.object_ids
    touching = truth.gap_m <= TOUCHING_M
    found = [
        _relation(truth, "ON", (object_id, TABLE_ID), start, end)
        for object_id, lift in zip(pair, truth.lift_m, strict=True)
        for start, end in runs(lift <= ON_M)
    ]
    found += [_relation(truth, "TOUCHING", pair, start, end) for start, end in runs(touching)]
    found += [_relation(truth, "NEAR", pair, start, end) for start, end in runs(truth.gap_m <= NEAR_M)]
    start, end = runs(~touching)[0]
    found.append(_relation(truth, "TOUCHING", pair, start, end, holds=False))
    return tuple(sorted(found, key=lambda relation: relation.start_frame))


def _relation(
    truth: GroundTruth, predicate: str, targets: tuple[str, ...], start: int, end: int, *, holds: bool = True
) -> Relation:
    return Relation(
        predicate=predicate,
        start_frame=start,
        end_frame=end,
        start_ns=truth.clock.t_ns(start, truth.n_frames),
        end_ns=truth.clock.t_ns(end, truth.n_frames),
        polarity=holds,
        source="computed" if holds else "marked",
        author=_AUTHOR,
        arguments=tuple(Argument(target=target) for target in targets),
    )
