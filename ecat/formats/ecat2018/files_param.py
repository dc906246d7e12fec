"""Reading ``files.param``, the session file of ECAT 2018, in every generation (ECAT 2018 file format §1.2).

The document is streamed: markers, objects, events and predicates are taken as they end.  What the model has a
field for goes there; what it has none for is kept as ``foreign`` facts (``ecat-2018:...``), so that
:mod:`ecat.formats.ecat2018.files_param_write` can write the same bytes again.

ECAT's track bar numbers the images from one, with a position 0 that shows the first image too (§0.9): drawn key frames,
event spans and predicates are stored in that numbering, detections are not.  Here image F - 1 is meant, -1
standing for 0.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

from ecat.formats.ecat2018.elements import attributes_of, frame_number, refused, tag_of
from ecat.formats.ecat2018.events import event_of
from ecat.formats.ecat2018.face_scanner import FaceScanner
from ecat.formats.ecat2018.marker_reader import MarkerReader
from ecat.formats.ecat2018.marks import CodeBook, Faces
from ecat.formats.ecat2018.nesting import nested
from ecat.formats.ecat2018.objects import object_of
from ecat.formats.ecat2018.relations import object_links, relation_of
from ecat.formats.ecat2018.xml_input import Element, iter_records, open_input
from ecat.model import AnnotatedObject, Clock, Event, KeyFrame, Layer, Relation

DECLARATION = '<?xml version="1.0" encoding="utf-8"?>'
SESSION_ATTRIBUTES = ("name", "length", "duration", "startWriteRGB")
SECTIONS = ("files", "objects", "annotations", "predicates")
_WHOLE = ("object", "annotation")
_RECORDS = ("marker", "object", "annotation", "predicate", "file", *SECTIONS, "session")
# element -> what may be in it
_CHILDREN = {
    "session": {*SECTIONS},
    "files": {"file"},
    "objects": {"object"},
    "annotations": {"annotation"},
    "predicates": {"predicate"},
    "object": {"markers", "markers3d", "marker", "links", "spatialLink"},
    "markers": {"marker"},
    "markers3d": {"marker"},
    "links": {"link"},
    "link": {"linkTo"},
    "spatialLink": {"linkTo"},
    "annotation": {"duration", "text", "refs", "events", "link"},
    "refs": {"ref"},
    "events": {"event"},
}


@dataclass
class SessionFile:
    """What a ``files.param`` says.

    ``faces_2d`` and ``faces_3d`` have one entry per glyph box that has any; ``findings`` tells what was odd
    or is not kept.
    """

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
    skip_bad_markers : keep a marker whose code or numbers cannot be read without them, and say so, instead of refusing
        the file.

    Raises
    ------
    FormatError, LimitError : the file is not a readable session file; nothing was kept of it.
    StoreError : the file cannot be opened or read.
    """
    what = what or f"cannot import {path.parent.name}/{path.name}"
    reader = _Reader(what, skip_bad=skip_bad_markers)
    scanner = FaceScanner(reader.markers.take_faces)
    for element in iter_records(path, tags=_RECORDS, whole=_WHOLE, what=what, cut=scanner.cut):
        reader.take(element)
    if not reader.is_session:
        raise refused(
            what,
            "the root element is not <session>",
            "name a files.param written by ECAT, or the folder that holds it",
        )
    reader.result.foreign |= _lexical_profile(path, what)
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
    found = re.match(rb"<\?xml[^>]*\?>", head.removeprefix(b"\xef\xbb\xbf"))
    declaration = found.group().decode("utf-8", "replace") if found else ""
    if declaration != DECLARATION:
        profile["declaration"] = declaration
    return profile


class _Reader:
    """Takes the records of a document in their order."""

    def __init__(self, what: str, *, skip_bad: bool) -> None:
        self.result = SessionFile()
        self.is_session = False
        self.markers = MarkerReader(what, self.result.book, self.result.findings, skip_bad=skip_bad)
        self._what = what
        self._objects: list[AnnotatedObject] = []
        self._events: list[Event] = []
        self._relations: list[Relation] = []
        self._links: list[Relation] = []
        # the ids given out, and the suffix that the last thing with the same one got
        self._ids: dict[str, dict[str, int]] = {"object": {}, "event": {}}
        self._sections: list[str] = []
        self._counters: dict[str, int] = {}
        self._handlers: dict[str, Callable[[Element], None]] = {
            "marker": self.markers.take,
            "object": self._object,
            "annotation": self._annotation,
            "predicate": self._predicate,
            "file": self._file,
            "session": self._session,
            **dict.fromkeys(SECTIONS, self._section),
        }

    def take(self, element: Element) -> None:
        """Take a record that has ended."""
        self._handlers[tag_of(element)](element)

    def _odd(self, finding: str) -> None:
        self.result.findings.append(finding)

    # ------------------------------------------------------------------------------------------- objects

    def _object(self, element: Element) -> None:
        object_id = self._new_id("object", element)
        read = self.markers.finish()
        links, layout = object_links(element, object_id, self._what)
        two, three = (self._in_order(read.key_frames[dimensions], object_id) for dimensions in (2, 3))
        made = object_of(element, object_id, two, three, (*read.notes, *layout), what=self._what)
        self._objects.append(made)
        self._links += links
        for dimensions, target in ((2, self.result.faces_2d), (3, self.result.faces_3d)):
            if faces := read.faces.get(dimensions):
                if made.kind != "marker_box":
                    where = f"line {element.sourceline}: object {object_id!r} has faces but is no glyph box"
                    raise refused(self._what, where, "correct the object's shape")
                faces.object_id = object_id
                if faces.put_in_order():
                    self._odd(f"object {object_id}: markers out of order or doubled; put in order")
                target.append(faces)
        self._report_unknown(element)

    def _in_order(self, keys: list[KeyFrame], object_id: str) -> tuple[KeyFrame, ...]:
        """Key frames in frame order, one per frame (the last one counts, as in ECAT)."""
        if all(a.frame < b.frame for a, b in pairwise(keys)):
            return tuple(keys)
        self._odd(f"object {object_id}: key frames out of order or doubled; put in order")
        by_frame = {key.frame: key for key in keys}
        return tuple(by_frame[frame] for frame in sorted(by_frame))

    def _new_id(self, kind: str, element: Element) -> str:
        """The id that a thing gets: its own, with a suffix if one before it has the same."""
        own = element.get("id") or f"line{element.sourceline}"
        used, made = self._ids[kind], own
        count = used.get(own, 1)
        while made in used:
            count += 1
            made = f"{own}~{count}"
        used[own] = count
        used.setdefault(made, 1)
        if made != element.get("id"):
            why = "is used twice" if element.get("id") else "is missing"
            self._odd(
                f"line {element.sourceline}: {kind} id {element.get('id') or ''!r} {why}; here it is {made!r}"
            )
        return made

    # ------------------------------------------------------------------------------------------- the rest

    def _annotation(self, element: Element) -> None:
        self._events.append(event_of(element, self._new_id("event", element), self._what))
        self._report_unknown(element)

    def _predicate(self, element: Element) -> None:
        self._relations.append(relation_of(element, self._what))
        self._report_unknown(element)

    def _file(self, element: Element) -> None:
        self.result.files.append(element.text or "")

    def _section(self, element: Element) -> None:
        parent, tag, said = element.getparent(), tag_of(element), attributes_of(element, self._what)
        if parent is None or parent.tag != "session":
            return  # <events> inside an annotation is read with it
        self._sections.append(tag)
        if "no" in said and tag in ("objects", "annotations"):
            self._counters[tag] = frame_number(said.pop("no"), self._what, element.sourceline or 0)
        self.result.foreign |= {f"{tag}@{name}": value for name, value in said.items()}
        self._report_unknown(element)

    def _report_unknown(self, element: Element) -> None:
        allowed = _CHILDREN.get(tag_of(element), set[str]())
        for child in element:
            if child.tag in allowed:
                self._report_unknown(child)
            else:
                where = f"line {child.sourceline}: <{tag_of(child)[:100]}> inside of <{tag_of(element)}>"
                self._odd(f"{where} is not part of the format and was not imported")

    # ------------------------------------------------------------------------------------------- session

    def _session(self, root: Element) -> None:
        """Take what stands on the root, and put the layer together."""
        if root.getparent() is not None:
            raise refused(
                self._what, f"line {root.sourceline}: a <session> inside of an element", "check the file"
            )
        self.is_session = True
        result, said = self.result, attributes_of(root, self._what)
        result.name = said.get("name", "")
        if "name" not in said or list(said) != [name for name in SESSION_ATTRIBUTES if name in said]:
            result.foreign["attributes"] = ",".join(said)
        result.foreign |= {f"session@{name}": v for name, v in said.items() if name not in SESSION_ATTRIBUTES}
        result.n_frames = self._count(said, "length")
        if "length" not in said:
            result.foreign["length"] = "absent"
        duration_ms = self._count(said, "duration")
        start = said.get("startWriteRGB")
        result.clock = Clock(
            rule="uniform" if duration_ms and result.n_frames > 1 else "unknown",
            # the file says Z, but it is the local time of an unknown zone (§0.10)
            start=(start or "").removesuffix("Z") or None,
            duration_ns=duration_ms * 1_000_000 if duration_ms else None,
        )
        if start is not None and not (start.endswith("Z") and len(start) > 1):
            result.foreign["startWriteRGB"] = start
        self._finish_layer()
        self._report_unknown(root)

    def _count(self, said: dict[str, str], name: str) -> int:
        """A count on the root; what is no usual number is 0 and kept as it was written."""
        text = said.get(name)
        if text is None:
            return 0
        number = int(text) if re.fullmatch(r"[0-9]{1,9}", text) else 0
        if str(number) != text or (name == "duration" and number == 0):
            self.result.foreign[name] = f"={text}"
        return number

    def _finish_layer(self) -> None:
        foreign, counters = self.result.foreign, self._counters
        sections = list(dict.fromkeys(self._sections))
        if sections != self._sections:
            self._odd("a section occurs more than once; put together")
        with_predicates = "predicates" in sections
        if sections != [*SECTIONS[:3], *(["predicates"] if with_predicates else [])]:
            foreign["sections"] = ",".join(sections)
        elif with_predicates:
            foreign["predicates"] = "yes"
        if "objects" not in counters:
            foreign["objects@no"] = "absent"
        if "annotations" in counters:
            foreign["annotations@no"] = "yes"
        self.result.layer = Layer(
            object_counter=counters.get("objects", _highest(self._ids["object"], "o")),
            event_counter=counters.get("annotations", _highest(self._ids["event"], "a")),
            objects=tuple(self._objects),
            events=nested(self._events),
            relations=(*self._links, *self._relations),
            scheme="ecat-2018",
        )


def _highest(ids: Iterable[str], letter: str) -> int:
    """The highest number that was used in ids of the form ``o12``."""
    found = (re.fullmatch(letter + "([0-9]{1,9})", i) for i in ids)
    return max((int(match.group(1)) for match in found if match), default=0)
