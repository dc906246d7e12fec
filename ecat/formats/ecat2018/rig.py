"""``rig_<stamp>.xml``: the skeletons of a recording (§1.4), and the video frames they belong to (§2.6).

The file has one record per tracked body and body frame. Its quirks, undone here: joints are in Kinect camera
space (x to the right of the mirrored image, y up), the confidences of inferred and not tracked joints look
exchanged, the depth-image pixels are labelled metres, projected points may be infinite, the wall clock is
local time marked Z.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.errors import FormatError, UsageError
from ecat.formats.ecat2018.body_scheme import KINECT_V2, BodyScheme
from ecat.formats.ecat2018.lexical import attribute
from ecat.formats.ecat2018.number_text import format_float32, parse_floats, parse_int
from ecat.formats.ecat2018.xml_input import Element, iterparse_safe, place, reading

BATCH_RECORDS = 256
_DEPTH_PATH = "Skeleton_Depth_Joint_Locations/Pts"
_CONFIDENCE_PATH = "Skeleton_Joint_Confidences/Vals"
_TIME_FROM_BEGIN_PATH = "Timestamp/@timeFromBegin"
_STATES = {1.0: "tracked", 0.0: "inferred", 0.5: "not_tracked"}
_TO_OPENCV = np.array([-1.0, -1.0, 1.0])
_NAME = pa.dictionary(pa.int32(), pa.string())
_NUMBERS = ("x", "y", "z", "u_px", "v_px", "depth_u_px", "depth_v_px", "confidence")

RIG_SCHEMA = pa.schema(
    [
        pa.field("record", pa.int32(), nullable=False),
        pa.field("t_ns", pa.int64()),
        pa.field("recorded_at", pa.timestamp("us")),
        pa.field("counter", pa.int32(), nullable=False),
        pa.field("body", pa.int8(), nullable=False),
        pa.field("joint", _NAME, nullable=False),
        *(pa.field(name, pa.float64()) for name in _NUMBERS),
        pa.field("state", _NAME),
    ]
)
"""One row per joint of a record, in file order.

``record`` counts records from zero. ``t_ns`` is the time since the first colour frame, ``recorded_at`` the
wall clock (local time of an unknown zone). ``counter`` is the recorder's count of colour frames, from one,
which several body frames can share: it is not a frame of the video, see `frames_as_ecat`. ``body`` is the
Kinect body slot 0-5. ``x y z`` are metres in camera/depth (OpenCV axes of the physical camera: the file's -X,
-Y, Z), ``u_px v_px`` pixels of the (mirrored) colour image and ``depth_*`` of the depth image; both are null
where infinite. ``confidence`` is as in the file: 1, 0 or 0.5, which say tracked, inferred, not_tracked in
``state``.
"""


@dataclass(frozen=True, slots=True)
class Rig:
    """The joints of a rig file (`RIG_SCHEMA`), and what was wrong with it, one sentence each."""

    joints: pa.Table
    findings: tuple[str, ...] = ()


# ---------------------------------------------------------------------------------------------- reading


def read_rig(source: Path | bytes, scheme: BodyScheme = KINECT_V2) -> Rig:
    """Read a whole rig file.

    A recording that crashed leaves an unfinished file: the records before the fault are kept and the fault
    becomes a finding.

    Raises
    ------
    FormatError : the root is another element, or a record is wrong: no counter, body or joints, or not the
        scheme's number of joints.
    LimitError : a text or element too large.
    StoreError : the file cannot be read.
    """
    batches: list[pa.RecordBatch] = []
    findings: list[str] = []
    records = _Records(source, scheme)
    try:
        batches.extend(records)
    except FormatError as error:
        if records.fault is None:
            raise
        findings.append(f"the file is damaged, {records.count} records before it were kept: {error.where}")
        batches.extend(records.rest())
    return Rig(pa.Table.from_batches(batches, schema=RIG_SCHEMA), tuple(findings))


def iter_rig(source: Path | bytes, scheme: BodyScheme = KINECT_V2) -> Iterator[pa.RecordBatch]:
    """Stream a rig file as batches of `RIG_SCHEMA`, `BATCH_RECORDS` records each; errors as in `read_rig`.

    A damaged file yields every record before the fault, then raises its `FormatError`.
    """
    records = _Records(source, scheme)
    try:
        yield from records
    except FormatError:
        yield from records.rest()
        raise


class _Records:
    """The records of a file in batches; ``fault`` is set when the XML itself broke off."""

    def __init__(self, source: Path | bytes, scheme: BodyScheme) -> None:
        self._source = source
        self._scheme = scheme
        self._what = reading(source, "the rig file")
        self._pending: list[_Record] = []
        self.count = 0
        self.fault: FormatError | None = None

    def __iter__(self) -> Iterator[pa.RecordBatch]:
        elements = iterparse_safe(self._source, tags=(self._scheme.frame_root,), what=self._what)
        root = next(elements)
        if root.tag != self._scheme.sequence_root:
            expected = self._scheme.sequence_root
            raise FormatError(self._what, where=f"{place(root)}: expected the root <{expected}>")
        while (element := self._next(elements)) is not None:
            self._pending.append(_record(element, self._scheme, self._what))
            self.count += 1
            if len(self._pending) == BATCH_RECORDS:
                yield from self.rest()
        yield from self.rest()

    def rest(self) -> Iterator[pa.RecordBatch]:
        """The records read but not yielded yet."""
        if self._pending:
            pending, self._pending = self._pending, []
            yield _batch(pending, self.count - len(pending), self._scheme)

    def _next(self, elements: Iterator[Element]) -> Element | None:
        try:
            return next(elements, None)
        except FormatError as error:
            self.fault = error
            raise


@dataclass(slots=True)
class _Record:
    t_ns: int | None
    recorded_at: datetime | None
    counter: int
    body: int
    values: NDArray[np.float64]  # joints x _NUMBERS


def _record(element: Element, scheme: BodyScheme, what: str) -> _Record:
    at = place(element)
    n = len(scheme.joints)
    counter = parse_int(_required(element, scheme.counter_path, what), what=what, where=f"{at} counter")
    body = parse_int(
        _required(element, scheme.body_path, what), what=what, where=f"{at} body", low=0, high=127
    )
    elapsed = _value(element, scheme.time_from_begin_path or _TIME_FROM_BEGIN_PATH)
    elapsed_ms = None if elapsed is None else parse_int(elapsed, what=what, where=f"{at} time")
    values = np.full((n, len(_NUMBERS)), np.nan)
    points = parse_floats(_required(element, scheme.points_3d_path, what), 3 * n, what=what, where=at)
    values[:, 0:3] = points.reshape(n, 3) * _TO_OPENCV
    for columns, path in (
        (slice(3, 5), scheme.points_2d_path),
        (slice(5, 7), _DEPTH_PATH),
        (slice(7, 8), _CONFIDENCE_PATH),
    ):
        text = _value(element, path)
        if text is not None:
            width = columns.stop - columns.start
            values[:, columns] = parse_floats(text, width * n, what=what, where=at).reshape(n, width)
    recorded_at = _wall_clock(_value(element, scheme.time_path))
    return _Record(None if elapsed_ms is None else elapsed_ms * 10**6, recorded_at, counter, body, values)


def _value(element: Element, path: str) -> str | None:
    """The text or attribute at the end of a path of names, None where there is none."""
    parts, _, name = path.partition("@")
    parts = parts.rstrip("/")
    found = element.find(parts) if parts else element
    if found is None:
        return None
    return found.get(name) if name else found.text or ""


def _required(element: Element, path: str, what: str) -> str:
    value = _value(element, path)
    if value is None:
        raise FormatError(what, where=f"{place(element)}: {path} is missing")
    return value


def _wall_clock(text: str | None) -> datetime | None:
    """Local time despite its Z; None where it is missing or no time (other recorders wrote other forms)."""
    try:
        return datetime.fromisoformat(text.removesuffix("Z")).replace(tzinfo=None) if text else None
    except ValueError:
        return None


def _batch(records: list[_Record], first: int, scheme: BodyScheme) -> pa.RecordBatch:
    n = len(scheme.joints)
    values = np.concatenate([record.values for record in records])
    missing = ~np.isfinite(values)
    states = [_STATES.get(confidence) for confidence in values[:, -1].tolist()]
    names = [joint.name for joint in scheme.joints]

    def per_joint(items: list[Any], kind: pa.DataType) -> Any:
        return pa.array(list(chain.from_iterable([item] * n for item in items)), kind)

    return pa.record_batch(
        [
            per_joint(list(range(first, first + len(records))), pa.int32()),
            per_joint([record.t_ns for record in records], pa.int64()),
            per_joint([record.recorded_at for record in records], pa.timestamp("us")),
            per_joint([record.counter for record in records], pa.int32()),
            per_joint([record.body for record in records], pa.int8()),
            pa.array(names * len(records), _NAME),
            *(pa.array(values[:, i], mask=missing[:, i]) for i in range(len(_NUMBERS))),
            pa.array(states, _NAME),
        ],
        schema=RIG_SCHEMA,
    )


# ---------------------------------------------------------------------------------------------- alignment


def frames_as_ecat(
    recorded_at: NDArray[np.datetime64], start: np.datetime64, duration_ms: int, length: int
) -> NDArray[np.int32]:
    """The frame ECAT showed each record at: elapsed whole milliseconds over ``duration / length``, plus one.

    One-based like ECAT's track bar, whereas detections are zero-based, so image and skeleton are one frame
    apart; and the wall clock is when a record was written. For comparison with ECAT only.

    Parameters
    ----------
    recorded_at : datetime64[n].
    start, duration_ms, length : start of recording, duration and number of frames of the session.
    """
    if duration_ms <= 0 or length <= 0:
        where = f"{length} frames in {duration_ms} ms"
        raise UsageError("cannot align the skeletons", where=where, fix="give more than none of both")
    elapsed_us = (recorded_at.astype("M8[us]") - start.astype("M8[us]")).astype(np.int64)
    frame = np.trunc(np.trunc(elapsed_us / 1000) / (duration_ms / length)) + 1
    return np.clip(frame, -(2**31), 2**31 - 1).astype(np.int32)


def frames_renumbered(counter: NDArray[np.int32]) -> NDArray[np.int32]:
    """ECAT's other rule, for sessions without a start time: the distinct counters become 1, 2, 3, ..."""
    return (np.unique(counter, return_inverse=True)[1] + 1).astype(np.int32)


def records_shown_by_ecat(
    frame: NDArray[np.int32], counter: NDArray[np.int32], body: NDArray[np.int8]
) -> dict[tuple[int, int], tuple[int, int]]:
    """Which records ECAT showed, with its two losses when several fall together.

    Records that share a counter keep the time (so the frame) of the first and the joints of each body's last;
    of several counters on one frame, the one seen first last wins.

    Parameters
    ----------
    frame, counter, body : (n,) of every record in file order; ``frame`` by one of the rules above.

    Returns
    -------
    (frame, body) -> (index of the record whose time counts, index of the record whose joints are shown).
    """
    timed: dict[int, int] = {}
    joints: dict[tuple[int, int], int] = {}
    for i, key in enumerate(zip(counter.tolist(), body.tolist(), strict=True)):
        timed.setdefault(key[0], i)
        joints[key] = i
    shown: dict[tuple[int, int], tuple[int, int]] = {}
    for count, first in timed.items():
        for slot in dict.fromkeys(body.tolist()):
            if (count, slot) in joints:
                shown[int(frame[first]), slot] = (first, joints[count, slot])
    return shown


# ---------------------------------------------------------------------------------------------- writing


def write_rig(joints: pa.Table, scheme: BodyScheme = KINECT_V2) -> Iterator[bytes]:
    """The rig file of a table of `RIG_SCHEMA`, in pieces; `read_rig` reads it back equal.

    Nulls of the 2-D points become ``-∞``; the scheme's paths are ECAT's own whatever the scheme says.

    Raises
    ------
    UsageError : a record does not have the scheme's joints in order.
    """
    yield b'\xef\xbb\xbf<?xml version="1.0" encoding="utf-8"?>\r\n<BodyDataSequence>\r\n'
    n = len(scheme.joints)
    if joints.num_rows % n or joints["joint"].to_pylist() != [j.name for j in scheme.joints] * (
        joints.num_rows // n
    ):
        raise UsageError(
            "cannot write the rig file",
            where="a record does not have the scheme's joints in order",
            fix="give each record all joints of the scheme, in its order",
        )
    for start in range(0, joints.num_rows, n * BATCH_RECORDS):
        rows = joints.slice(start, n * BATCH_RECORDS)
        heads = rows.take(np.arange(0, rows.num_rows, n)).to_pylist()
        numbers = np.column_stack([rows[name].to_numpy() for name in _NUMBERS]).reshape(-1, n, len(_NUMBERS))
        for head, values in zip(heads, numbers, strict=True):
            yield ("\r\n".join(_record_lines(head, values)) + "\r\n").encode()
    yield b"</BodyDataSequence>"


def _record_lines(head: dict[str, Any], values: NDArray[np.float64]) -> Iterator[str]:
    time = (
        ""
        if head["recorded_at"] is None
        else attribute("time", f"{head['recorded_at']:%Y-%m-%dT%H:%M:%S.%f}Z")
    )
    elapsed = "" if head["t_ns"] is None else attribute("timeFromBegin", str(head["t_ns"] // 10**6))
    yield "  <Body_Data>"
    yield f"    <Subject{attribute('id', str(head['body']))} />"
    yield f"    <Timestamp{time}{elapsed}{attribute('frame', str(head['counter']))} />"
    for name, child, unit, numbers in (
        ("Skeleton_Joint_Locations_Orig", "Pts", "m", values[:, 0:3] * _TO_OPENCV),
        ("Skeleton_Depth_Joint_Locations", "Pts", "m", values[:, 5:7]),
        ("Skeleton_ImgPlane_Joint_Locations", "Pts", "px", values[:, 3:5]),
        ("Skeleton_Joint_Confidences", "Vals", "", values[:, 7]),
    ):
        if child == "Vals" and np.isnan(numbers).all():
            continue
        known = np.where(np.isnan(numbers), -np.inf, numbers)
        yield f"    <{name}>"
        yield f"      <{child}{attribute('unit', unit) if unit else ''}>{format_float32(known)}</{child}>"
        yield f"    </{name}>"
    yield "  </Body_Data>"
