"""Reading ``files.param``, the session file of ECAT 2018, in every generation (ECAT 2018 file format §1.2).

The document is streamed: markers, objects, events and predicates are taken as they end.  What the model has a field for goes
there; what it has none for is kept as ``foreign`` facts (``ecat-2018:...``), so that
:mod:`ecat.formats.ecat2018.files_param_write` can write the same bytes again.

ECAT's track bar numbers the images from one, with a position 0 that shows the first image too (§0.9): drawn key frames,
event spans and predicates are stored in that numbering, detections are not.  Here image F - 1 is meant, -1 standing for 0.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ecat.errors import FormatError
from ecat.formats.ecat2018.elements import (
    Element,
    event_of,
    frame_number,
    key_frame_of,
    object_links,
    object_of,
    relation_of,
)
from ecat.formats.ecat2018.face_scanner import FaceScanner, Run
from ecat.formats.ecat2018.marks import CodeBook, Faces
from ecat.formats.ecat2018.xml_input import iter_records, open_input
from ecat.model import AnnotatedObject, Clock, Event, Foreign, KeyFrame, Layer, Relation
from ecat.model.scheme import ECAT_2018_SCHEME

DECLARATION = '<?xml version="1.0" encoding="utf-8"?>'
_RECORDS = ("marker", "object", "annotation", "predicate", "file", "files", "objects", "annotations", "predicates")
_KNOWN = frozenset(
    (
        *_RECORDS,
        *("session", "markers", "markers3d", "links", "link", "linkTo", "spatialLink", "face", "bounding", "code"),
        *("duration", "text", "refs", "ref", "events", "event"),
    )
)
_FACE_MARKER_2D = ["type", "frame", "glyphSize"]
_FACE_MARKER_3D = ["frame", "glyphSize"]
_RUN_FACES = 4096


@dataclass
class SessionFile:
    """What a ``files.param`` says."""

    name: str = ""
    n_frames: int = 0
    clock: Clock = field(default_factory=Clock)
    files: list[str] = field(default_factory=list[str])
    layer: Layer = field(default_factory=Layer)
    faces_2d: list[Faces] = field(default_factory=list[Faces])
    faces_3d: list[Faces] = field(default_factory=list[Faces])
    book: CodeBook = field(default_factory=CodeBook)
    foreign: dict[str, str] = field(default_factory=dict[str, str])
    findings: list[str] = field(default_factory=list[str])


def read_files_param(path: Path, *, what: str = "", skip_bad_markers: bool = False) -> SessionFile:
    """Read one session file.

    Parameters
    ----------
    path : the file.
    what : first line of an error; names the file by default.
    skip_bad_markers : keep a marker whose code or corners cannot be read without them, and say so, instead of refusing
        the file.

    Raises
    ------
    FormatError, LimitError : the file is not a readable session file; nothing was kept of it.
    """
    what = what or f"cannot import {path.parent.name}/{path.name}"
    reader = _Reader(what, skip_bad_markers)
    root: Element | None = None
    handlers = reader.handlers()
    scanner = FaceScanner(reader.take_faces)
    for element in iter_records(path, tags=_RECORDS, what=what, cut=scanner.cut):
        if root is None:
            root = element.getroottree().getroot()
        handlers[element.tag](element)
    reader.finish_objects()
    if root is None or root.tag != "session":
        raise FormatError(
            what,
            where=f"the root element is <{'unknown' if root is None else root.tag}> without sections, expected <session>",
            fix="name a files.param written by ECAT, or the folder that holds it",
        )
    reader.session(root, _lexical_profile(path, what))
    return reader.result


def _lexical_profile(path: Path, what: str) -> dict[str, str]:
    """How the document is laid out: byte order mark, line ends, declaration, end of file."""
    with open_input(path, what) as file:
        head = file.read(512)
        file.seek(-min(16, path.stat().st_size), 2)
        tail = file.read()
    profile: dict[str, str] = {}
    if not head.startswith(b"\xef\xbb\xbf"):
        profile["bom"] = "no"
    if b"\r\n" in head:
        profile["line_end"] = "crlf"
    if end := re.search(rb">([\r\n \t]+)$", tail):
        profile["end"] = end.group(1).decode().replace("\r\n", "\n")
    declaration = head.removeprefix(b"\xef\xbb\xbf").partition(b"\n")[0].strip().decode("utf-8", "replace")
    if declaration != DECLARATION:
        profile["declaration"] = declaration if declaration.startswith("<?xml") else ""
    return profile


class _Reader:
    """Takes the records of a document in their order."""

    def __init__(self, what: str, skip_bad: bool) -> None:
        self.result = SessionFile()
        self._what = what
        self._skip_bad = skip_bad
        self._objects: list[AnnotatedObject] = []
        self._events: list[Event] = []
        self._relations: list[Relation] = []
        self._links: list[Relation] = []
        self._object_ids: Counter[str] = Counter()
        self._event_ids: Counter[str] = Counter()
        self._list: Element | None = None
        self._keys: dict[int, list[KeyFrame]] = {2: [], 3: []}
        self._faces: dict[int, Faces] = {}
        self._parsed: dict[int, Run] = {}
        self._parsed_lines: dict[int, list[int]] = {}
        self._is_box = False
        self._flat = False
        self._marker_notes: list[Foreign] = []
        self._sections: list[str] = []
        self._counters: dict[str, int | None] = {"objects": None, "annotations": None}

    def handlers(self) -> dict[str, Any]:
        """Element name -> what takes it."""
        return {
            "marker": self._marker,
            "object": self._object,
            "annotation": self._annotation,
            "predicate": self._predicate,
            "file": lambda e: self.result.files.append(e.text or ""),
            **dict.fromkeys(("files", "objects", "annotations", "predicates"), self._section),
        }

    # ------------------------------------------------------------------------------------------- markers

    def take_faces(self, dimensions: int, run: Run) -> None:
        """Markers with faces, as the scanner cut them out of the object that is being read."""
        self._take_parsed(dimensions)
        self._faces_of(dimensions).add(run)

    def _take_parsed(self, dimensions: int) -> None:
        """Hand over the markers that came through the parser."""
        lines = self._parsed_lines
        if run := self._parsed.pop(dimensions, None):
            run.line = lines.pop(dimensions).__getitem__
            self._faces_of(dimensions).add(run)

    def _faces_of(self, dimensions: int) -> Faces:
        faces = self._faces.get(dimensions)
        if faces is None:
            result = self.result
            faces = Faces(dimensions, self._what, result.book, self._skip_bad, result.findings)
            self._faces[dimensions] = faces
        return faces

    def _marker(self, element: Element) -> None:
        parent = element.getparent()
        if parent is not self._list:
            self._open_list(parent)
        if not self._is_box:
            self._drawn(element)
            return
        dimensions = 3 if parent is not None and parent.tag == "markers3d" else 2
        faces = self._faces_of(dimensions)
        if element.keys() != (_FACE_MARKER_2D if dimensions == 2 else _FACE_MARKER_3D):
            self._note_attributes(element, dimensions)
        line = element.sourceline or 0
        frame = frame_number(element.get("frame"), self._what, line)
        size_text = element.get("glyphSize", "5")
        size = int(size_text) if size_text.isdigit() and len(size_text) < 4 else 0
        run = self._parsed.setdefault(dimensions, Run([], [], [], [], [], lambda _: 0))
        if element.get("type") == "DELETE":
            faces.absent.add(len(faces.frames) + sum(max(count, 1) for count in run.counts))
        for order, face in enumerate(element):
            if [child.tag for child in face] != ["bounding", "code"]:
                raise self._bad_face(face, frame, order)
            run.corners.append((face[0].text or "").encode())
            run.codes.append((face[1].text or "").encode())
        run.frames.append(frame)
        run.sizes.append(size)
        run.counts.append(len(element))
        self._parsed_lines.setdefault(dimensions, []).append(line)
        if len(run.corners) >= _RUN_FACES:
            self._take_parsed(dimensions)

    def _bad_face(self, face: Element, frame: int, order: int) -> FormatError:
        found = ", ".join(f"<{child.tag}>" for child in face) or "nothing"
        return FormatError(
            self._what,
            where=f"line {face.sourceline}, <{face.tag}> {order + 1} of frame {frame}: "
            f"expected <bounding> and <code>, found {found}",
            consequence="the session was not imported; nothing was written",
            fix="correct or remove the marker",
        )

    def _open_list(self, parent: Element | None) -> None:
        """Markers of another list follow: of a box, or drawn?"""
        owner = parent
        if parent is not None and parent.tag in ("markers", "markers3d"):
            owner = parent.getparent()
        if parent is None or owner is None or owner.tag != "object":
            raise FormatError(
                self._what,
                where="a <marker> outside of an <object>",
                consequence="the session was not imported; nothing was written",
                fix="restore the file from a copy",
            )
        self._list = parent
        self._flat = parent is owner
        self._is_box = (owner.get("shape") or "").endswith("GlyphBoxObject")

    def _new_id(self, owner: Element) -> str:
        """The id that an object gets: its own, with a suffix if an object before it has the same."""
        own = owner.get("id") or f"line{owner.sourceline}"
        count = self._object_ids[own]
        return own if not count else f"{own}~{count + 1}"

    def _drawn(self, element: Element) -> None:
        parent = element.getparent()
        dimensions = 3 if parent is not None and parent.tag == "markers3d" else 2
        self._keys[dimensions].append(key_frame_of(element, dimensions, self._what))

    def _note_attributes(self, element: Element, dimensions: int) -> None:
        names = ",".join(element.keys())
        extra = "|".join(
            f"{k}={v}" for k, v in element.items() if k not in ("type", "frame", "glyphSize")
        )
        self._marker_notes.append(
            Foreign(f"ecat-2018:marker{dimensions}d@{element.get('frame')}", f"{names};{extra}")
        )

    # ------------------------------------------------------------------------------------------- objects

    def _object(self, element: Element) -> None:
        self._take_parsed(2)
        self._take_parsed(3)
        object_id = self._new_id(element)
        self._object_ids[element.get("id") or f"line{element.sourceline}"] += 1
        foreign = list(self._marker_notes)
        if self._flat:
            foreign.append(Foreign("ecat-2018:layout", "flat"))
        if object_id != element.get("id"):
            self.result.findings.append(
                f"line {element.sourceline}: object id {element.get('id')!r} is used twice; here it is {object_id!r}"
            )
        links, layout = object_links(element, object_id, self._what)
        made = object_of(
            element,
            object_id,
            self._checked(self._keys[2], object_id),
            self._checked(self._keys[3], object_id),
            (*foreign, *layout),
            self._what,
        )
        self._objects.append(made)
        self._links += links
        for dimensions, target in ((2, self.result.faces_2d), (3, self.result.faces_3d)):
            if faces := self._faces.get(dimensions):
                if made.kind != "marker_box":
                    raise FormatError(
                        self._what,
                        where=f"line {element.sourceline}: object {object_id!r} has faces but is no glyph box",
                        consequence="the session was not imported; nothing was written",
                        fix="correct the object's shape",
                    )
                faces.object_id = object_id
                target.append(faces)
        self._report_unknown(element)
        self._keys = {2: [], 3: []}
        self._faces = {}
        self._list = None
        self._flat = False
        self._marker_notes = []

    def _checked(self, keys: list[KeyFrame], object_id: str) -> tuple[KeyFrame, ...]:
        """Key frames in frame order, one per frame (the last one counts, as in ECAT)."""
        frames = [key.frame for key in keys]
        if all(a < b for a, b in zip(frames, frames[1:], strict=False)):
            return tuple(keys)
        self.result.findings.append(f"object {object_id}: key frames out of order or doubled; put in order")
        return tuple(dict(sorted({key.frame: key for key in keys}.items())).values())

    def finish_objects(self) -> None:
        """Put the faces of every box in frame order where the file had them otherwise."""
        for faces in (*self.result.faces_2d, *self.result.faces_3d):
            if faces.put_in_order():
                self.result.findings.append(
                    f"object {faces.object_id}: markers out of order or doubled; put in order"
                )

    # ------------------------------------------------------------------------------------------- the rest

    def _annotation(self, element: Element) -> None:
        own = element.get("id") or f"line{element.sourceline}"
        self._event_ids[own] += 1
        count = self._event_ids[own]
        event_id = own if count == 1 else f"{own}~{count}"
        if event_id != element.get("id"):
            self.result.findings.append(
                f"line {element.sourceline}: event id {element.get('id')!r} is used twice; here it is {event_id!r}"
            )
        self._events.append(event_of(element, event_id, self._what))
        self._report_unknown(element)

    def _predicate(self, element: Element) -> None:
        self._relations.append(relation_of(element, self._what))

    def _section(self, element: Element) -> None:
        parent = element.getparent()
        if parent is None or parent.tag != "session":
            return  # <events> inside an annotation is read with it
        self._sections.append(element.tag)
        number = element.get("no")
        if element.tag in self._counters and number is not None:
            self._counters[element.tag] = frame_number(number, self._what, element.sourceline or 0)
        for name, value in element.items():
            if name != "no":
                self.result.foreign[f"{element.tag}@{name}"] = value

    def _report_unknown(self, element: Element) -> None:
        for child in element.iterdescendants():
            if child.tag not in _KNOWN:
                self.result.findings.append(
                    f"line {child.sourceline}: <{child.tag}> is not part of the format and was not imported"
                )

    # ------------------------------------------------------------------------------------------- session

    def session(self, root: Element, profile: dict[str, str]) -> None:
        """Take what stands on the root, and put the layer together."""
        result = self.result
        result.foreign |= profile
        result.name = root.get("name") or ""
        known = {"name", "length", "duration", "startWriteRGB"}
        usual = [name for name in ("name", "length", "duration", "startWriteRGB") if name in root.attrib]
        if root.keys() != usual:
            result.foreign["attributes"] = ",".join(root.keys())
        for name, value in root.items():
            if name not in known:
                result.foreign[f"session@{name}"] = value
        result.n_frames = self._count(root, "length")
        duration_ms = self._count(root, "duration")
        start = root.get("startWriteRGB")
        result.clock = Clock(
            rule="uniform" if duration_ms and result.n_frames > 1 else "unknown",
            # the file says Z, but it is the local time of an unknown zone (§0.10)
            start=start.removesuffix("Z") if start else None,
            duration_ns=duration_ms * 1_000_000 if duration_ms else None,
        )
        if start is not None and not start.endswith("Z"):
            result.foreign["startWriteRGB"] = start
        self._finish_layer()
        for child in root:
            if child.tag not in _KNOWN:
                result.findings.append(f"line {child.sourceline}: <{child.tag}> was not imported")

    def _count(self, root: Element, name: str) -> int:
        """A count on the root; what is no usual number is 0 and kept as it was written."""
        text = root.get(name)
        if text is None:
            if name == "length":
                self.result.foreign["length"] = "absent"
            return 0
        number = int(text) if re.fullmatch(r"[0-9]{1,9}", text) else 0
        if str(number) != text or (name == "duration" and number == 0):
            self.result.foreign[name] = f"={text}"
        return number

    def _finish_layer(self) -> None:
        foreign = self.result.foreign
        sections = ["files", "objects", "annotations", *(["predicates"] if "predicates" in self._sections else [])]
        if self._sections != sections:
            foreign["sections"] = ",".join(self._sections)
        elif "predicates" in self._sections:
            foreign["predicates"] = "yes"
        if self._counters["objects"] is None:
            foreign["objects@no"] = "absent"
        if self._counters["annotations"] is not None:
            foreign["annotations@no"] = "yes"
        self.result.layer = Layer(
            object_counter=self._counters["objects"] or _highest(self._object_ids, "o"),
            event_counter=self._counters["annotations"] or _highest(self._event_ids, "a"),
            objects=tuple(self._objects),
            events=tuple(self._events),
            relations=(*self._links, *self._relations),
            # people could add predicates to ECAT's own; which, is not written down with the session
            scheme=ECAT_2018_SCHEME.name if self._in_scheme() else "",
        )

    def _in_scheme(self) -> bool:
        known = {predicate.name for predicate in ECAT_2018_SCHEME.predicates}
        return all(relation.predicate in known for relation in (*self._links, *self._relations))


def _highest(ids: Counter[str], letter: str) -> int:
    numbers = [int(i[1:]) for i in ids if i.startswith(letter) and i[1:].isdigit() and len(i) < 11]
    return max(numbers, default=0)
