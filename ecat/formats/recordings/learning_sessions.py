"""A session of an event export as a session of ecat, and back (ECAT 2018 file format §1.11).

What the model has no field for is kept with the session and its events under :data:`NAME`, so that a session that was
not changed gives back what it was made of.  Kept facts count only while they still mean what the model says.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pyarrow as pa

from ecat.formats.ecat2018.learning_export import (
    BOX_SCHEMA,
    EVENT_SCHEMA,
    JOINT_SCHEMA,
    JOINTS,
    LABELS,
    ExportedSession,
)
from ecat.formats.ecat2018.session_folder import kinect_cameras
from ecat.model import (
    AnnotatedObject,
    Clock,
    Event,
    Foreign,
    Layer,
    Manifest,
    Property,
    Provenance,
    Role,
    Segment,
)
from ecat.model.annotation import foreign_value
from ecat.store import Draft, Session, TableData
from ecat.tables import JOINTS as JOINT_TABLE
from ecat.tables import MARKERS_3D

NAME = "ecat-learning"
"""The format's name, and what begins the keys of kept facts."""
_OBJECTS = ("o1", "o2", "o3")
"""The skeleton and the two boxes, whose roles are the first three labels."""
_CORNERS = [f"{axis}{corner}" for corner in range(4) for axis in "xyz"]


# ---------------------------------------------------------------------------------------------- to a session


def draft_of(one: ExportedSession, name: str, source: str, facts: dict[str, str]) -> Draft:
    """A session called ``name`` of one in the file ``source``; ``facts`` are kept with it.

    The file says nothing of times, of images, and of which face of a box was seen.
    """
    said = facts | {"name": one.name} | ({"empty": "yes"} if one.empty else {})
    frames = one.joints["frame"].to_numpy()
    manifest = Manifest(
        name=name,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        n_frames=max(int(frames.max(initial=-1)) + 1, 0),
        clock=Clock(rule="unknown"),
        cameras=kinect_cameras(),
        provenance=Provenance(format=NAME, source=source, notes=one.findings),
        foreign={f"{NAME}:{key}": value for key, value in said.items()},
    )
    if one.empty:
        return Draft(manifest=manifest, layers=(Layer(),))
    tables = {
        "joints": TableData(data=_joint_rows(one.joints)),
        "markers_3d": TableData(data=_marker_rows(one.boxes)),
    }
    layer = Layer(
        object_counter=len(_OBJECTS),
        event_counter=one.events.num_rows,
        objects=_objects(),
        events=tuple(_event(i, row) for i, row in enumerate(one.events.to_pylist(), start=1)),
    )
    return Draft(
        manifest=manifest, layers=(layer,), tables={k: v for k, v in tables.items() if one.joints.num_rows}
    )


def _objects() -> tuple[AnnotatedObject, ...]:
    rig, *boxes = _OBJECTS
    return (
        AnnotatedObject(
            id=rig, name="Performer 1", kind="rig", origin="provided", dimensions=3, semantic_type="bodyRig"
        ),
        *(
            AnnotatedObject(id=box, name=f"box {i}", kind="marker_box", origin="tracked", dimensions=3)
            for i, box in enumerate(boxes, start=1)
        ),
    )


@dataclass(frozen=True)
class _Meaning:
    """What five labels say, in the model's terms."""

    type: str = ""
    roles: tuple[Role, ...] = ()
    properties: tuple[Property, ...] = ()


def _meaning(labels: Sequence[str | None]) -> _Meaning:
    verb, preposition = labels[3:]
    return _Meaning(
        verb or "",
        tuple(Role(name=role, target=o) for o, role in zip(_OBJECTS, labels, strict=False) if role),
        (Property("preposition", preposition),) if preposition else (),
    )


def _labels(said: Event | _Meaning) -> list[str | None]:
    """The labels that say the same."""
    roles = {role.target: role.name for role in reversed(said.roles)}
    prepositions = [p.value for p in said.properties if p.name == "preposition"]
    return [*map(roles.get, _OBJECTS), said.type or None, next(iter(prepositions), None)]


def _segment(first: int, last: int) -> Segment:
    """The file's last frame belongs to the window; one before the first is none."""
    return Segment(start_frame=first, end_frame=max(last, first) + 1)


def _event(number: int, row: dict[str, Any]) -> Event:
    labels: list[str | None] = [row[label] for label in LABELS]
    meaning, first, last = _meaning(labels), row["first_frame"], row["last_frame"]
    kept: list[Foreign] = []
    if _labels(meaning) != labels:
        kept.append(Foreign(f"{NAME}:labels", _text(labels)))
    if last < first:
        kept.append(Foreign(f"{NAME}:last_frame", str(last)))
    return Event(
        id=f"a{number}",
        type=meaning.type,
        segments=(_segment(first, last),),
        roles=meaning.roles,
        properties=meaning.properties,
        foreign=tuple(kept),
    )


def _text(labels: Iterable[str | None]) -> str:
    return ",".join("None" if label is None else label for label in labels)


def _joint_rows(joints: pa.Table) -> pa.Table:
    n = joints.num_rows
    columns = {name: joints[name] for name in ("frame", "joint", "x", "y", "z")} | {
        "object_id": pa.array([_OBJECTS[0]] * n, pa.string()).dictionary_encode(),
        "body": pa.array(np.zeros(n, np.int8)),
    }
    return _sorted(columns, JOINT_TABLE.arrow, n)


def _marker_rows(boxes: pa.Table) -> pa.Table:
    """A row for the one face of each box in each frame; nobody wrote down which face it is."""
    n = boxes.num_rows // 4
    points = np.column_stack([boxes[axis].to_numpy() for axis in "xyz"]).reshape(n, 12)
    which = boxes["box"].to_numpy()[::4].astype(np.int32) - 1
    columns: dict[str, Any] = {
        "frame": pa.array(boxes["frame"].to_numpy()[::4]),
        "object_id": pa.DictionaryArray.from_arrays(pa.array(which, pa.int32()), pa.array(_OBJECTS[1:])),
        "order": pa.array(np.zeros(n, np.int16)),
        "present": pa.array(np.ones(n, bool)),
    } | {name: pa.array(points[:, i], from_pandas=True) for i, name in enumerate(_CORNERS)}
    return _sorted(columns, MARKERS_3D.arrow, n)


def _sorted(columns: dict[str, Any], schema: pa.Schema, n: int) -> pa.Table:
    """The table of these columns, null in all others, by frames; what is of one frame stays in its order."""
    rows = [columns[field.name] if field.name in columns else pa.nulls(n, field.type) for field in schema]
    table = pa.table(rows, schema=schema)
    return table.take(np.argsort(table["frame"].to_numpy(), kind="stable"))


# ---------------------------------------------------------------------------------------------- back


def kept(session: Session, key: str) -> str | None:
    """A fact that was kept with the session."""
    return session.manifest.foreign.get(f"{NAME}:{key}")


def exported(session: Session, findings: list[str]) -> ExportedSession:
    """What an export says of the session; what it cannot say is told.

    Only a session with one skeleton of the 13 joints and one face of each of two boxes in every frame has a place in
    the format; ECAT left the others empty, and so does this.
    """
    name = kept(session, "name")
    name = session.name if name is None else name
    empty = ExportedSession(
        name, JOINT_SCHEMA.empty_table(), BOX_SCHEMA.empty_table(), EVENT_SCHEMA.empty_table(), empty=True
    )
    if kept(session, "empty") is not None:
        return empty
    has = session.has_table("joints"), session.has_table("markers_3d")
    parts = _points(session) if all(has) else None
    if parts is None and (any(has) or session.manifest.n_frames or kept(session, "name") is None):
        findings.append(
            f"{session.name}: left empty, as it does not have one skeleton and two boxes in every frame"
        )
        return empty
    joints, boxes = parts or (empty.joints, empty.boxes)
    extra = [record.name for record in session.manifest.layers if record.name != "main"]
    findings += [f"{session.name}: the format has one layer; {layer!r} was left out" for layer in extra]
    layer = session.layer("main") if session.manifest.layer("main") is not None else Layer()
    events = pa.Table.from_pylist(list(_event_rows(session.name, layer, findings)), schema=EVENT_SCHEMA)
    return ExportedSession(name, joints, boxes, events)


def _points(session: Session) -> tuple[pa.Table, pa.Table] | None:
    """The joints and the corners of the boxes, if there are as many in every frame as the format has places for."""
    joints, marks = session.table("joints").to_arrow(), session.table("markers_3d").to_arrow()
    frame, n = joints["frame"].to_numpy(), joints.num_rows // len(JOINTS)
    things = list(dict.fromkeys(marks["object_id"].to_pylist()))
    fits = (
        joints["joint"].to_pylist() == list(JOINTS) * n
        and len(set(joints["body"].to_pylist())) <= 1
        and len(things) == 2 * bool(n)
        and marks["object_id"].to_pylist() == things * n
        and (frame.reshape(n, -1) == frame[:: len(JOINTS), None]).all()
        and (marks["frame"].to_numpy() == np.repeat(frame[:: len(JOINTS)], 2)).all()
    )
    if not fits:
        return None
    corners = np.column_stack([marks[name].to_numpy() for name in _CORNERS]).reshape(-1, 3)
    ring = np.arange(8, dtype=np.int8)
    boxes = [
        pa.array(np.repeat(frame[:: len(JOINTS)], 8)),
        pa.array(np.tile(ring // 4 + np.int8(1), n)),
        pa.array(np.tile(ring % 4, n)),
        *(pa.array(corners[:, i], from_pandas=True) for i in range(3)),
    ]
    rows = [joints[name].combine_chunks() for name in JOINT_SCHEMA.names]
    return pa.table(rows, schema=JOINT_SCHEMA), pa.table(boxes, schema=BOX_SCHEMA)


def _event_rows(name: str, layer: Layer, findings: list[str]) -> Iterator[dict[str, Any]]:
    for event in layer.events:
        labels = _labels(event)
        text = foreign_value(event.foreign, f"{NAME}:labels")
        said = _parsed(text) if text is not None else None
        if said is not None and _meaning(said) == _Meaning(event.type, event.roles, event.properties):
            labels = said
        elif any(label is not None and ("," in label or label == "None") for label in labels):
            findings.append(
                f"{name}: event {event.id} was left out: its labels cannot be told from one another"
            )
            continue
        for segment in event.segments:
            last = segment.end_frame - 1
            before = foreign_value(event.foreign, f"{NAME}:last_frame")
            if before is not None and _segment(segment.start_frame, int(before)) == segment:
                last = int(before)
            yield {"first_frame": segment.start_frame, "last_frame": last} | dict(
                zip(LABELS, labels, strict=True)
            )


def _parsed(text: str) -> list[str | None] | None:
    labels = [None if label == "None" else label for label in text.split(",")]
    return labels if len(labels) == len(LABELS) else None
