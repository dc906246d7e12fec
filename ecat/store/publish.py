"""Annotation layers as Parquet-ready tables: the same facts as the XML, tidy, for queries.

Frames are clamped to the recording's start: position -1 of an imported key frame shows the first image (see
:mod:`ecat.model.annotation`).  Of several key frames at one image the last counts.  Every interval has at least
one image, but that of a fact that never held, which is empty.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import Any

import pyarrow as pa

from ecat.errors import SchemaError
from ecat.model import AnnotatedObject, KeyFrame, Layer, Manifest
from ecat.model.holding import ALWAYS, Stretches, intervals, presence
from ecat.model.scheme import ECAT_2018_SCHEME, CodingScheme
from ecat.tables import PUBLISHED, TableSchema

Row = dict[str, Any]


def publish(
    layers: Sequence[Layer],
    manifest: Manifest,
    scheme_of: Callable[[str], CodingScheme] = lambda _: ECAT_2018_SCHEME,
) -> dict[str, pa.Table]:
    """The published tables (:data:`ecat.tables.PUBLISHED`) of ``layers``.

    The coding scheme of a layer (``scheme_of`` its name) decides when a relation without an end stops holding;
    ``manifest`` gives the clock.
    """
    rows: dict[str, list[Row]] = {schema.name: [] for schema in PUBLISHED}
    for layer in layers:
        _objects(layer, manifest, rows)
        _events(layer, manifest, rows)
        rows["relations"] += _relations(layer, manifest, scheme_of(layer.scheme))
    return {schema.name: _table(rows[schema.name], schema) for schema in PUBLISHED}


def _table(rows: list[Row], schema: TableSchema) -> pa.Table:
    if schema.order:
        # nulls last, as Arrow sorts them
        rows = sorted(rows, key=lambda row: [(row[name] is None, row[name]) for name in schema.order])
    columns = [_column([row[field.name] for row in rows], field, schema.name) for field in schema.arrow]
    return pa.Table.from_arrays(columns, schema=schema.arrow)


def _column(values: list[Any], field: pa.Field[Any], table: str) -> pa.Array[Any]:
    try:
        return pa.array(values, type=field.type)
    except (ValueError, OverflowError):
        wrong = (f"{field.name}: {value!r:.60}" for value in values if not _fits(value, field.type))
        raise SchemaError(
            f"cannot publish the table of {table}",
            problems=tuple(islice(wrong, 100)),
            consequence="nothing was changed",
            fix=f"correct the annotation: the column is {field.type}",
        ) from None


def _fits(value: object, kind: pa.DataType) -> bool:
    try:
        pa.array([value], type=kind)
    except (ValueError, OverflowError):
        return False
    return True


def _interval(
    manifest: Manifest,
    start: int,
    end: int | None,
    *,
    start_ns: int | None = None,
    end_ns: int | None = None,
    images: int = 1,
) -> Row:
    start = max(start, 0)
    end = None if end is None else max(end, start + images)
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
            for key in {max(key.frame, 0): key for key in keys}.values():
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
            _interval(manifest, s.start_frame, s.end_frame, start_ns=s.start_ns, end_ns=s.end_ns)
            for s in event.segments
        ] or [_interval(manifest, 0, None)]
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


def _relations(layer: Layer, manifest: Manifest, scheme: CodingScheme) -> Iterator[Row]:
    there = {thing.id: presence(thing) for thing in layer.objects}

    def present(object_id: str) -> Stretches:
        # an object of another session is taken to be there: looking would mean opening that session
        return there.get(object_id, ALWAYS if "/" in object_id else ())

    held = intervals(layer.relations, scheme, present)
    for index, relation in enumerate(layer.relations):
        start, end = relation.start_frame, relation.end_frame
        stretches = held[index] or ((start, start),) if relation.polarity else ((start, end),)
        for first, last in stretches:
            yield {
                "layer": layer.name,
                "relation": index,
                "predicate": relation.predicate,
                "arguments": list(relation.targets),
                "polarity": relation.polarity,
                "source": relation.source,
                "status": relation.status,
            } | _interval(
                manifest,
                first,
                last,
                start_ns=relation.start_ns if first == start else None,
                end_ns=relation.end_ns if last == end else None,
                images=0,
            )
