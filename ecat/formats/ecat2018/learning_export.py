"""The event export of ECAT 2018: skeleton, two marker boxes and labelled windows per session (§1.11).

XML with a BOM in a ``.txt``: per frame 13 joints and one face of each box in Kinect camera space, then
windows with five labels. Only sessions with one skeleton and two boxes were exported, the others are empty.
Malformed events left their element open, so that what follows is nested in it; it is read where it belongs.
Labels of a session leak from one event to the next, and ``0,0,0`` stands for a point that was never seen
(null here).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain, pairwise
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.errors import FormatError
from ecat.formats.ecat2018.lexical import attribute, text
from ecat.formats.ecat2018.number_text import format_float32, parse_floats, parse_int
from ecat.formats.ecat2018.xml_input import (
    Element,
    iterparse_safe,
    open_input,
    place,
    reading,
    required_attribute,
)

JOINTS = (
    "SpineShoulder",
    *("ShoulderLeft", "ElbowLeft", "WristLeft", "HandLeft", "HandTipLeft", "ThumbLeft"),
    *("ShoulderRight", "ElbowRight", "WristRight", "HandRight", "HandTipRight", "ThumbRight"),
)
LABELS = ("rig_role", "box1_role", "box2_role", "verb", "preposition")
_PARTS = (("rig", len(JOINTS)), ("glyph", 4), ("glyph", 4))
_POINTS = len(JOINTS) + 8
_HEAD_BYTES = 4096
_BEFORE_XML = b"\xef\xbb\xbf\xff\xfe\x00 \t\r\n"
"""White space and byte order marks; of other encodings too, as an error says what is wrong with these."""
_MOST_FINDINGS = 20
_TO_OPENCV = np.array([-1.0, -1.0, 1.0])
_NAME = pa.dictionary(pa.int32(), pa.string())
_XYZ = tuple(pa.field(axis, pa.float64()) for axis in "xyz")

JOINT_SCHEMA = pa.schema(
    [pa.field("frame", pa.int32(), nullable=False), pa.field("joint", _NAME, nullable=False), *_XYZ]
)
"""One row per joint of a frame; ``x y z`` are metres in camera/depth (OpenCV axes)."""
BOX_SCHEMA = pa.schema(
    [
        pa.field("frame", pa.int32(), nullable=False),
        pa.field("box", pa.int8(), nullable=False),
        pa.field("corner", pa.int8(), nullable=False),
        *_XYZ,
    ]
)
"""One row per corner (0-3, ring order) of one face of ``box`` 1 or 2; metres in camera/depth."""
EVENT_SCHEMA = pa.schema(
    [
        pa.field("first_frame", pa.int32(), nullable=False),
        pa.field("last_frame", pa.int32(), nullable=False),
        *(pa.field(label, _NAME) for label in LABELS),
    ]
)
"""One row per window: its frames as written (inclusive, unreliable) and five labels, null for ``None``."""


@dataclass(frozen=True, slots=True)
class ExportedSession:
    """One session of an export; ``empty`` when it was named but not exported."""

    name: str
    joints: pa.Table
    boxes: pa.Table
    events: pa.Table
    empty: bool = False
    findings: tuple[str, ...] = ()


_Event: TypeAlias = tuple[int, int, list[str | None]]


@dataclass(slots=True)
class _Open:
    """A session whose end has not been read."""

    numbers: list[int] = field(default_factory=list[int])
    points: list[NDArray[np.float64]] = field(default_factory=list[NDArray[np.float64]])
    events: list[_Event] = field(default_factory=list[_Event])
    findings: list[str] = field(default_factory=list[str])


# ---------------------------------------------------------------------------------------------- reading


def learning_exports_below(folder: Path) -> tuple[list[Path], list[str]]:
    """The files ``*.txt`` in a folder and all folders in it, by path, and a line for each that was left out.

    Left out is what is not XML, by its first character: notes lie beside exports.  Whether the others are exports shows
    when they are read.

    Raises
    ------
    StoreError : a file cannot be read.
    """
    paths = sorted(path for path in folder.rglob("*.txt") if path.is_file())
    found = [path for path in paths if _begins_as_xml(path)]
    others = sorted({*paths} - {*found})
    findings = [
        f"{path} was left out: it is not XML, so no learning export" for path in others[:_MOST_FINDINGS]
    ]
    if len(others) > _MOST_FINDINGS:
        findings.append(f"{len(others) - _MOST_FINDINGS:,} more were left out: they are not XML")
    return found, findings


def _begins_as_xml(path: Path) -> bool:
    with open_input(path, reading(path, "")) as file:
        return file.read(_HEAD_BYTES).lstrip(_BEFORE_XML).startswith(b"<")


def read_learning_export(source: Path | bytes) -> Iterator[ExportedSession]:
    """The sessions of an export, one in memory at a time, in the order in which they end.

    Raises
    ------
    FormatError : not an export, a frame without one rig of 13 joints and two boxes of 4 corners, or an event
        without five labels. Sessions complete before the fault have been yielded.
    LimitError : a text or element too large.
    StoreError : the file cannot be read.
    """
    what = reading(source, "the learning export")
    elements = iterparse_safe(source, tags=("session", "frame", "event"), what=what)
    root = next(elements)
    if root.tag != "project":
        raise FormatError(what, where=f"{place(root)}: expected the root <project>")
    sessions: dict[Element, _Open] = {}
    for element in elements:
        if element.tag == "session":
            name = required_attribute(element, "name", what=what)
            yield _close(name, sessions.pop(element, None) or _Open(), empty=element.find("data") is None)
            continue
        owner = next(element.iterancestors("session"), None)
        if owner is None:
            raise FormatError(what, where=f"{place(element)}: outside any session")
        session = sessions.setdefault(owner, _Open())
        if element.tag == "frame":
            session.numbers.append(_int(element, "no", what))
            session.points.append(_points(element, what))
        elif len(element):
            session.findings.append(f"{place(element)}: the event was left open and is dropped")
        else:
            session.events.append(_event(element, what))


def _int(element: Element, name: str, what: str) -> int:
    value = required_attribute(element, name, what=what)
    return parse_int(value, what=what, where=f"{place(element)} {name}")


def _points(frame: Element, what: str) -> NDArray[np.float64]:
    """float64[21, 3]: joints, box 1, box 2, in camera/depth; NaN for points never seen."""
    if [child.get("type") for child in frame] != [kind for kind, _ in _PARTS]:
        raise FormatError(what, where=_unlike(frame))
    values = np.concatenate(
        [
            parse_floats(child.text or "", 3 * count, what=what, where=place(child))
            for child, (_, count) in zip(frame, _PARTS, strict=True)
        ]
    ).reshape(_POINTS, 3)
    seen = np.isfinite(values).all(axis=1, keepdims=True) & values.any(axis=1, keepdims=True)
    return np.where(seen, values * _TO_OPENCV, np.nan)


def _unlike(frame: Element) -> str:
    """What a frame has instead of a rig and two glyphs, in that order, and in which session."""
    kinds = [child.get("type") for child in frame]
    rigs, boxes = (kinds.count(kind) for kind in ("rig", "glyph"))
    found = f"{rigs} rig{'s' * (rigs != 1)}, {boxes} glyph{'s' * (boxes != 1)}"
    if others := len(kinds) - rigs - boxes:
        found += f", {others} of another type"
    elif (rigs, boxes) == (1, 2):
        found += " in another order"
    name = next((session.get("name") for session in frame.iterancestors("session")), None)
    inside = "" if name is None else f" of session {name[:100]}"
    return f"{place(frame)}{inside}: expected one rig and two glyphs, found {found}"


def _event(element: Element, what: str) -> _Event:
    labels = (element.text or "").split(",")
    if len(labels) != len(LABELS):
        raise FormatError(
            what,
            where=f"{place(element)}: expected {len(LABELS)} labels, found {(element.text or '')[:60]!r}",
        )
    known = [None if label == "None" else label for label in labels]
    return _int(element, "start", what), _int(element, "end", what), known


def _close(name: str, session: _Open, *, empty: bool) -> ExportedSession:
    findings = list(session.findings)
    if session.numbers and session.numbers != list(range(len(session.numbers))):
        findings.append(f"session {name}: its frames are not numbered 0, 1, 2, ...")
    if any(last < first for first, last, _ in session.events):
        findings.append(f"session {name}: an event ends before it starts")
    points = np.array(session.points).reshape(-1, _POINTS, 3)
    frames = np.array(session.numbers, dtype=np.int32)
    n, m = len(frames), len(JOINTS)
    joints = [pa.array(np.repeat(frames, m)), pa.array(list(JOINTS) * n, _NAME), *_axes(points[:, :m])]
    ring = np.arange(8, dtype=np.int8)
    places = np.repeat(frames, 8), np.tile(ring // 4 + 1, n), np.tile(ring % 4, n)
    boxes = [*map(pa.array, places), *_axes(points[:, m:])]
    events = [
        pa.array([first for first, _, _ in session.events], pa.int32()),
        pa.array([last for _, last, _ in session.events], pa.int32()),
        *(pa.array([row[i] for _, _, row in session.events], _NAME) for i in range(len(LABELS))),
    ]
    return ExportedSession(
        name,
        pa.Table.from_arrays(joints, schema=JOINT_SCHEMA),
        pa.Table.from_arrays(boxes, schema=BOX_SCHEMA),
        pa.Table.from_arrays(events, schema=EVENT_SCHEMA),
        empty=empty,
        findings=tuple(findings),
    )


def _axes(points: NDArray[np.float64]) -> list[Any]:
    flat = points.reshape(-1, 3)
    return [pa.array(flat[:, i], mask=np.isnan(flat[:, i])) for i in range(3)]


# ---------------------------------------------------------------------------------------------- writing


def write_learning_export(
    sessions: Iterable[ExportedSession], *, newline: Literal["\n", "\r\n"] = "\r\n"
) -> Iterator[bytes]:
    """The file in pieces, one session each; real files come back byte for byte."""
    yield newline.join(['\ufeff<?xml version="1.0" encoding="utf-8"?>', "<project>", ""]).encode()
    for session in sessions:
        yield newline.join([*_session_lines(session), ""]).encode()
    yield b"</project>"


def _session_lines(session: ExportedSession) -> Iterator[str]:
    if session.empty:
        yield f"  <session{attribute('name', session.name)} />"
        return
    yield f"  <session{attribute('name', session.name)}>"
    yield from _container("data", chain.from_iterable(_frame_lines(*frame) for frame in _frames(session)))
    yield from _container("events", _event_lines(session.events))
    yield "  </session>"


def _container(name: str, lines: Iterable[str]) -> Iterator[str]:
    content = list(lines)
    if content:
        yield f"    <{name}>"
        yield from content
        yield f"    </{name}>"
    else:
        yield f"    <{name} />"


def _frames(session: ExportedSession) -> Iterator[tuple[int, NDArray[np.float64]]]:
    tables = (session.joints, len(JOINTS)), (session.boxes, 8)
    parts = [
        np.column_stack([table[axis].to_numpy() for axis in "xyz"]).reshape(-1, count, 3)
        for table, count in tables
    ]
    points = np.nan_to_num(np.concatenate(parts, axis=1) * _TO_OPENCV, nan=0.0) + 0.0
    numbers = session.joints["frame"].to_numpy()[:: len(JOINTS)].tolist()
    return zip(numbers, points, strict=True)


def _frame_lines(number: int, points: NDArray[np.float64]) -> Iterator[str]:
    yield f'      <frame no="{number}">'
    bounds = np.cumsum([0, *(count for _, count in _PARTS)]).tolist()
    for (kind, _), (start, end) in zip(_PARTS, pairwise(bounds), strict=True):
        yield f'        <o type="{kind}">{format_float32(points[start:end])}</o>'
    yield "      </frame>"


def _event_lines(events: pa.Table) -> Iterator[str]:
    for row in events.to_pylist():
        labels = ",".join("None" if row[label] is None else row[label] for label in LABELS)
        span = f'start="{row["first_frame"]}" end="{row["last_frame"]}"'
        yield f"      <event {span}>{text(labels)}</event>"
