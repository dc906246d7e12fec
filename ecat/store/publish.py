"""Annotation layers as Parquet-ready tables: the same facts as the XML, tidy, for queries.

Frames are clamped to the recording's start and every interval has at least one image: position -1 of an
imported key frame shows the first image (see :mod:`ecat.model.annotation`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import pyarrow as pa

from ecat.model import AnnotatedObject, KeyFrame, Layer, Manifest
from ecat.model.holding import intervals, present_at
from ecat.model.scheme import ECAT_2018_SCHEME, CodingScheme
from ecat.tables import PUBLISHED

Row = dict[str, Any]


def publish(
    layers: Sequence[Layer], manifest: Manifest, scheme: CodingScheme = ECAT_2018_SCHEME
) -> dict[str, pa.Table]:
    """The published tables (:data:`ecat.tables.PUBLISHED`) of ``layers``.

    ``scheme`` decides when a relation without an end stops holding; ``manifest`` gives the clock.
    """
    rows: dict[str, list[Row]] = {schema.name: [] for schema in PUBLISHED}
    for layer in layers:
        _objects(layer, manifest, rows)
        _events(layer, manifest, rows)
        rows["relations"] += _relations(layer, manifest, scheme)
    return {schema.name: _table(rows[schema.name], schema.arrow) for schema in PUBLISHED}


def _table(rows: list[Row], schema: pa.Schema) -> pa.Table:
    return pa.Table.from_arrays(
        [pa.array([row[field.name] for row in rows], type=field.type) for field in schema], schema=schema
    )


def _interval(
    manifest: Manifest, start: int, end: int | None, start_ns: int | None, end_ns: int | None
) -> Row:
    start = max(start, 0)
    end = None if end is None else max(end, start + 1)
    clock, n = manifest.clock, manifest.n_frames
    return {
        "start_frame": start,
        "end_frame": end,
        "start_ns": start_ns if start_ns is not None else clock.t_ns(start, n),
        "end_ns": end_ns if end_ns is not None or end is None else clock.t_ns(end, n),
    }


def _objects(layer: Layer, manifest: Manifest, rows: dict[str, list[Row]]) -> None:
    for thing in layer.objects:
        rows["objects"].append(
            {
                "layer": layer.name,
                "object_id": thing.id,
                "name": thing.name,
                "kind": thing.kind,
                "origin": thing.origin,
                "dimensions": thing.dimensions,
                "semantic_type": thing.semantic_type,
                "stream": thing.stream,
                "color": thing.color,
                "properties": [(p.name, p.value) for p in thing.properties],
            }
        )
        for dimensions, keys in ((2, thing.key_frames), (3, thing.key_frames_3d)):
            for key in keys:
                rows["keyframes"] += _vertices(layer.name, thing, key, dimensions, manifest)


def _vertices(
    layer: str, thing: AnnotatedObject, key: KeyFrame, dimensions: int, manifest: Manifest
) -> list[Row]:
    frame = max(key.frame, 0)
    base: Row = {
        "layer": layer,
        "object_id": thing.id,
        "t_ns": key.t_ns if key.t_ns is not None else manifest.clock.t_ns(frame, manifest.n_frames),
        "frame": frame,
        "dimensions": dimensions,
        "present": key.present,
    }
    numbers: list[float | None] = [None if math.isnan(value) else value for value in key.coordinates]
    found = [
        base | {"vertex": i, "x": vertex[0], "y": vertex[1], "z": vertex[2] if dimensions == 3 else None}
        for i, vertex in enumerate(zip(*[iter(numbers)] * dimensions, strict=False))
    ]
    return found or [base | {"vertex": None, "x": None, "y": None, "z": None}]


def _events(layer: Layer, manifest: Manifest, rows: dict[str, list[Row]]) -> None:
    for event in layer.events:
        key = {"layer": layer.name, "event_id": event.id}
        spans = [
            _interval(manifest, s.start_frame, s.end_frame, s.start_ns, s.end_ns) for s in event.segments
        ] or [_interval(manifest, 0, None, None, None)]
        whole = min(spans, key=lambda s: s["start_frame"]) | {
            name: max(spans, key=lambda s: s["end_frame"] or 0)[name] for name in ("end_frame", "end_ns")
        }
        rows["events"].append(
            key
            | whole
            | {
                "type": event.type,
                "text": event.text,
                "tier": event.tier,
                "parent": event.parent,
                "status": event.status,
                "unsure": event.unsure,
                "author": event.author,
            }
        )
        rows["event_segments"] += [key | {"segment": i} | s for i, s in enumerate(spans) if event.segments]
        if event.parent is not None:
            parent = {"layer": layer.name, "event_id": event.parent}
            rows["event_links"].append(parent | {"type": "SUBEVENT", "target": event.id})
        rows["event_links"] += [key | {"type": link.type, "target": link.target} for link in event.links]
        rows["event_roles"] += [
            key | {"role": r.name, "kind": r.kind, "target": r.target, "text_start": None, "text_end": None}
            for r in event.roles
        ]
        rows["event_roles"] += [
            key
            | {
                "role": "reference",
                "kind": "object",
                "target": r.target,
                "text_start": r.start,
                "text_end": r.end,
            }
            for r in event.references
        ]


def _relations(layer: Layer, manifest: Manifest, scheme: CodingScheme) -> list[Row]:
    things = {thing.id: thing for thing in layer.objects}

    def is_present(object_id: str, frame: int) -> bool:
        thing = things.get(object_id)
        # an object of another session is taken to be there: looking would mean opening that session
        return present_at(thing, frame) if thing is not None else "/" in object_id

    ends = {index: end for index, _, end in intervals(layer.relations, scheme, is_present)}
    return [
        {
            "layer": layer.name,
            "relation": index,
            "predicate": relation.predicate,
            "arguments": list(relation.targets),
            "polarity": relation.polarity,
            "source": relation.source,
            "status": relation.status,
        }
        | _interval(
            manifest,
            relation.start_frame,
            # a fact about something absent never held: its interval is the one image it was marked on
            ends.get(index, relation.start_frame if relation.polarity else relation.end_frame),
            relation.start_ns,
            relation.end_ns,
        )
        for index, relation in enumerate(layer.relations)
    ]
