"""What these formats share: the objects of a session with their boxes, cameras, table, clock, and a layer."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.errors import NotFoundError
from ecat.formats.robotics.tracks import numbers, stretches
from ecat.geometry.boxes import boxes_by_codes
from ecat.geometry.cameras import Camera
from ecat.geometry.records import camera_of, depth_from_camera
from ecat.geometry.transforms import Floats, Rigid
from ecat.model import Manifest, Stream
from ecat.model.annotation import Event, Segment
from ecat.model.prototype import BoxPrototype, Triple
from ecat.store import Session
from ecat.store.media import annotated_stream
from ecat.store.media.images import times_of_stream

Rgb: TypeAlias = tuple[int, int, int]
PALETTE: tuple[Rgb, ...] = (
    (77, 171, 247),
    (255, 146, 43),
    (105, 219, 124),
    (247, 120, 186),
    (177, 151, 252),
    (255, 212, 59),
    (56, 217, 200),
    (255, 107, 107),
)
_NEAR_PLANE_M = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Thing:
    """An annotated object: ``name`` is its own among all objects; ``size_m`` is that of its box, where known."""

    id: str
    name: str
    color: Rgb
    kind: str = "other"
    semantic_type: str = ""
    size_m: Triple | None = None
    is_surface: bool = False
    """Whether it was drawn in space: a table."""


class Things(dict[str, Thing]):
    """The annotated objects by their id; what nobody declared goes by its id."""

    def __missing__(self, key: str) -> Thing:
        made = Thing(id=key, name=key, color=PALETTE[len(self) % len(PALETTE)])
        self[key] = made
        return made


def things_of(session: Session) -> Things:
    """The objects of all layers; the first layer decides on an id."""
    found, taken = Things(), set[str]()
    sizes = _box_sizes(session)
    rows = session.objects.to_arrow().to_pylist() if session.has_table("objects") else []
    for row in rows:
        key = row["object_id"]
        if key in found:
            continue
        name = row["name"].strip() or key
        name = name if name not in taken else f"{name} ({key})"
        taken.add(name)
        found[key] = Thing(
            id=key,
            name=name,
            color=PALETTE[len(found) % len(PALETTE)],
            kind=row["kind"],
            semantic_type=row["semantic_type"],
            size_m=sizes.get(key),
            is_surface=row["kind"] == "polygon" and row["dimensions"] == 3,
        )
    return found


def _box_sizes(session: Session) -> dict[str, Triple]:
    """Edge lengths of each object's box, metres: those of the prototype that most of its codes belong to."""
    prototypes = [BoxPrototype.from_dict(data) for data in session.manifest.prototypes]
    mirrored = any(camera.mirrored for camera in session.manifest.cameras)
    seen: Counter[tuple[str, str]] = Counter()
    for table in ("markers_2d", "markers_3d"):
        if prototypes and session.has_table(table):
            for rows in stretches(session, table, ("object_id", "code")):
                counted = rows.group_by(["object_id", "code"]).aggregate([([], "count_all")])
                for row in counted.to_pylist():
                    if row["code"] is not None:
                        seen[row["object_id"], row["code"]] += row["count_all"]
    return {key: box.size_m for key, box in boxes_by_codes(seen, prototypes, mirrored=mirrored).items()}


def slug(name: str) -> str:
    """The name as part of a file's name or a topic: letters, digits, ``.``, ``-`` and ``_``."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._") or "_"


def file_names(names: Sequence[str]) -> list[str]:
    """A :func:`slug` for each name, no two alike, also where capitals do not count."""
    taken: set[str] = set()
    found: list[str] = []
    for name in map(slug, names):
        n, free = 2, name
        while free.lower() in taken:
            n, free = n + 1, f"{name}_{n}"
        taken.add(free.lower())
        found.append(free)
    return found


# ------------------------------------------------------------------------------------------------- time


def frame_times(session: Session) -> NDArray[np.int64] | None:
    """When each frame of the session was taken, and when the last ended: (n + 1,) ns; None without a clock."""
    manifest = session.manifest
    n, stream = manifest.n_frames, annotated_stream(manifest)
    if stream is not None and session.has_table("frames"):
        times = times_of_stream(session.table("frames").to_arrow(), stream.name)
        if times is not None and n:
            step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
            at = np.arange(n + 1)
            late = np.maximum(at - len(times) + 1, 0) * step
            return (times[np.minimum(at, len(times) - 1)] + late.round()).astype(np.int64)
    known = manifest.clock.times_ns(range(n + 1), n)
    return None if None in known else np.array(known, np.int64)


def required_times(session: Session, what: str) -> NDArray[np.int64]:
    """:func:`frame_times`.

    Raises
    ------
    NotFoundError : the session has no clock.
    """
    times = frame_times(session)
    if times is None:
        raise NotFoundError(
            what,
            where=f"{session.name}: the recording has no clock, and the format is about times",
            consequence="this session was not written",
            fix="choose a format that counts frames (bvh, ply, glb), or import the recording with its times",
        )
    return times


def span_ns(segment: Segment, times: NDArray[np.int64]) -> tuple[int, int]:
    """When a segment begins and ends, half-open; its frames tell where it has no times of its own."""
    last = len(times) - 1
    start = (
        segment.start_ns if segment.start_ns is not None else times[min(max(segment.start_frame, 0), last)]
    )
    end = segment.end_ns if segment.end_ns is not None else times[min(max(segment.end_frame, 0), last)]
    return int(start), int(end)


def clock_shift_ns(session: Session, times: str, what: str, findings: list[str]) -> int:
    """What to add to times since the session's start: nothing, or for ``wall`` the wall clock then, ns since 1970.

    Raises
    ------
    NotFoundError : the wall clock is not known.
    """
    if times == "session":
        return 0
    start = session.manifest.clock.start
    offset = _wall_ns(start)
    if start is None or offset is None:
        raise NotFoundError(
            what,
            where=f"{session.name}: the recorder's wall clock is not known",
            consequence="this session was not written",
            fix="leave out times=wall",
        )
    if datetime.fromisoformat(start).tzinfo is None:
        findings.append(f"the time zone of {start} is not known; it was taken for UTC")
    return offset


def _wall_ns(start: str | None) -> int | None:
    try:
        moment = datetime.fromisoformat(start or "")
    except ValueError:
        return None
    since = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)) - datetime(1970, 1, 1, tzinfo=UTC)
    ns = (since.days * 86_400 + since.seconds) * 1_000_000_000 + since.microseconds * 1000
    return ns if ns >= 0 else None


# ------------------------------------------------------------------------------------------------ space


def stream_camera(manifest: Manifest, stream: Stream) -> Camera | None:
    """The camera of a stream, which takes points of ``camera/depth``; None where it is unknown."""
    record = manifest.camera(stream.camera)
    if record is None:
        return None
    from_depth = depth_from_camera(manifest, record).inverse()
    return replace(camera_of(record), reference="camera/depth", from_reference=from_depth)


@dataclass(frozen=True)
class TableFits:
    """Where the table was: from each of the frames (n,) on, ``table_from_camera`` (n,) takes ``camera/depth`` to it."""

    frame: NDArray[np.int64]
    table_from_camera: Rigid

    def at(self, frame: int) -> Rigid:
        """``table_from_camera`` at a frame; the first fit also holds before it."""
        pose = self.at_each(np.array([frame]))
        return Rigid(pose.rotation[0], pose.translation[0])

    def at_each(self, frames: NDArray[np.int64]) -> Rigid:
        """``table_from_camera`` at each of the frames (f,)."""
        i = np.maximum(np.searchsorted(self.frame, frames, side="right") - 1, 0)
        return Rigid(self.table_from_camera.rotation[i], self.table_from_camera.translation[i])


def table_fits(session: Session) -> TableFits | None:
    """The table's place; None where no table was found."""
    if not session.has_table("table_plane"):
        return None
    rows = session.table("table_plane").to_arrow()
    quaternion, origin = numbers(rows, "qx qy qz qw"), numbers(rows, "origin_x origin_y origin_z")
    kept = np.isfinite(quaternion).all(1) & np.isfinite(origin).all(1)
    if not kept.any():
        return None
    frame = np.asarray(rows["frame"].to_numpy(), np.int64)[kept]
    return TableFits(frame, Rigid.from_quaternion(quaternion[kept], origin[kept]).inverse())


def table_outlines(session: Session, fits: TableFits) -> list[tuple[int, Floats]]:
    """The table's edge: from each frame on a convex ring (n, 3) in ``table``, metres, anticlockwise seen from above; as
    found in depth, else as drawn.
    """
    found: list[tuple[int, Floats]] = []
    if session.has_table("table_outline"):
        rows = session.table("table_outline").to_arrow()
        frame, points = np.asarray(rows["frame"].to_numpy(), np.int64), numbers(rows, "x y z")
        found = [(int(at), points[frame == at]) for at in np.unique(frame)]
    else:
        found = list(_drawn(session))
    rings = [(at, fits.at(at).apply(ring[np.isfinite(ring).all(1)])) for at, ring in found]
    flat = [(at, ring) for at, ring in rings if (np.abs(ring[:, 2]) < _NEAR_PLANE_M).all()]
    hulls = [(at, _convex(ring)) for at, ring in flat if len(ring) > 2]
    return [(at, ring) for at, ring in hulls if len(ring) > 2]


def _convex(ring: Floats) -> Floats:
    import cv2

    hull = cv2.convexHull(ring[:, :2].astype(np.float32), clockwise=False)[:, 0].astype(float)
    return np.column_stack([hull, np.zeros(len(hull))])


def _drawn(session: Session) -> Iterator[tuple[int, Floats]]:
    """Shapes drawn in space, each at its frame."""
    if not session.has_table("keyframes"):
        return
    rows = session.table("keyframes").to_arrow()
    solid = rows.filter(pa.array(np.asarray(rows["dimensions"].to_numpy()) == 3))
    keys = np.asarray(solid["object_id"].cast(pa.string()))
    frame, points = np.asarray(solid["frame"].to_numpy(), np.int64), numbers(solid, "x y z")
    for key in dict.fromkeys(keys.tolist()):
        for at in np.unique(frame[keys == key]):
            yield int(at), points[(keys == key) & (frame == at)]


# ------------------------------------------------------------------------------------------- annotation


@dataclass(frozen=True, slots=True, kw_only=True)
class Held:
    """A relation and when it holds, or is denied: half-open, ns; ``arguments`` are names of objects."""

    start_ns: int
    end_ns: int
    predicate: str
    arguments: tuple[str, ...]
    polarity: bool
    source: str
    status: str


def relations_of(session: Session, layer: str, things: Things, times: NDArray[np.int64]) -> list[Held]:
    """The relations of a layer in the order of their beginnings; without times of their own, those of their frames."""
    rows: list[dict[str, Any]] = (
        session.relations.to_arrow().to_pylist() if session.has_table("relations") else []
    )
    last = len(times) - 1

    def at(own: int | None, frame: int | None) -> int:
        return own if own is not None else int(times[last if frame is None else min(max(frame, 0), last)])

    found = [
        Held(
            start_ns=at(row["start_ns"], row["start_frame"]),
            end_ns=at(row["end_ns"], row["end_frame"]),
            predicate=row["predicate"],
            arguments=tuple(things[key].name if key in things else key for key in row["arguments"]),
            polarity=row["polarity"],
            source=row["source"],
            status=row["status"],
        )
        for row in rows
        if row["layer"] == layer
    ]
    return sorted(found, key=lambda held: (held.start_ns, held.end_ns))


def who(event: Event, things: Things) -> dict[str, str]:
    """The roles of an event, each with the name of what fills it; several of one name are joined by commas."""
    found: dict[str, list[str]] = defaultdict(list)
    for role in event.roles:
        key, _, joint = role.target.partition("/")
        name = things[key].name if role.kind != "event" else role.target
        found[role.name].append(f"{name}/{joint}" if joint else name)
    return {role: ", ".join(names) for role, names in found.items()}


def left_behind(session: Session, carried: Sequence[str], *, streams: Sequence[str] = ()) -> list[str]:
    """A line on the tables and streams that have something and are not carried."""
    published = {"objects", "events", "event_segments", "event_links", "event_roles", "relations"}
    rest = [
        f"{record.name} ({record.rows:,} rows)"
        for record in session.manifest.tables
        if record.rows and record.name not in {*carried, *published}
    ]
    kept = [s.name for s in session.manifest.streams if s.present and s.name not in streams]
    lines = [f"tables left behind: {', '.join(rest)}"] if rest else []
    return lines + ([f"streams left behind: {', '.join(kept)}"] if kept else [])
