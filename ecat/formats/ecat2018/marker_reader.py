"""The markers of the ``<object>`` that is being read (ECAT 2018 file format §1.2.4)."""

from __future__ import annotations

import json
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from ecat.formats.ecat2018.elements import attributes_of, fact, frame_number, refused, small_number, tag_of
from ecat.formats.ecat2018.face_markup import Run
from ecat.formats.ecat2018.key_frames import key_frame_of
from ecat.formats.ecat2018.marks import CodeBook, Faces, refuse_marker
from ecat.formats.ecat2018.xml_input import Element
from ecat.model import Foreign, KeyFrame

FACE_ATTRIBUTES = {2: ("type", "frame", "glyphSize"), 3: ("frame", "glyphSize")}
_RUN_FACES = 16_384


@dataclass
class Markers:
    """What was read of one object: key frames and faces by number of dimensions, and how they lay in the file."""

    key_frames: dict[int, list[KeyFrame]] = field(default_factory=lambda: {2: [], 3: []})
    faces: dict[int, Faces] = field(default_factory=dict[int, Faces])
    notes: list[Foreign] = field(default_factory=list[Foreign])


@dataclass
class _Waiting:
    """A run of markers that the parser found, as far as it goes."""

    frames: list[int] = field(default_factory=list[int])
    sizes: list[int] = field(default_factory=list[int])
    counts: list[int] = field(default_factory=list[int])
    corners: list[bytes] = field(default_factory=list[bytes])
    codes: list[bytes] = field(default_factory=list[bytes])
    lines: list[int] = field(default_factory=list[int])

    def run(self) -> Run:
        return Run(
            self.lines.__getitem__,
            np.array(self.frames, np.int32),
            np.array(self.sizes, np.int32),
            np.array(self.counts, np.int32),
            pa.array(self.corners, pa.binary()).dictionary_encode(),
            pa.array(self.codes, pa.binary()).dictionary_encode(),
        )


class MarkerReader:
    """Takes markers as the scanner and the parser find them.

    Parameters
    ----------
    what : first line of an error.
    book : gets the codes.
    findings : gets a line for everything odd.
    skip_bad : keep markers that cannot be read without their values.
    """

    def __init__(self, what: str, book: CodeBook, findings: list[str], *, skip_bad: bool) -> None:
        self._what = what
        self._book = book
        self._findings = findings
        self._skip_bad = skip_bad
        self._read = Markers()
        self._list: Element | None = None
        self._dimensions = 2
        self._is_box = False
        self._waiting = _Waiting()

    def finish(self) -> Markers:
        """Everything since the last call: the object has ended."""
        self._flush()
        read, self._read = self._read, Markers()
        self._list = None
        return read

    def take_faces(self, dimensions: int, run: Run) -> None:
        """Markers with faces, as the scanner cut them out."""
        self._flush()
        self._faces(dimensions).add(run)

    def take(self, element: Element) -> None:
        """A ``<marker>`` as parsed.

        Raises
        ------
        FormatError : it cannot be read, or is not in an object.
        """
        if element.getparent() is not self._list:
            self._open_list(element.getparent())
        if self._is_box:
            self._take_box(element)
        else:
            key = key_frame_of(element, self._dimensions, self._what, self._bad)
            self._read.key_frames[self._dimensions].append(key)

    def _open_list(self, parent: Element | None) -> None:
        """Markers of another list follow; find out whether it is of a box, or drawn."""
        self._flush()
        wrapped = parent is not None and parent.tag in ("markers", "markers3d")
        owner = parent.getparent() if wrapped and parent is not None else parent
        if parent is None or owner is None or owner.tag != "object":
            line = "line 1" if parent is None else f"line {parent.sourceline}"
            raise refused(
                self._what, f"{line}: a <marker> outside of an <object>", "restore the file from a copy"
            )
        self._list = parent
        self._dimensions = 3 if parent.tag == "markers3d" else 2
        self._is_box = (owner.get("shape") or "").endswith("GlyphBoxObject")
        if not wrapped:
            self._read.notes.append(fact("layout", "flat"))

    def _take_box(self, element: Element) -> None:
        line, said = element.sourceline or 0, attributes_of(element, self._what)
        frame = frame_number(said.get("frame"), self._what, line)
        size = small_number(said.get("glyphSize", "5"))
        if (
            tuple(said) != FACE_ATTRIBUTES[self._dimensions]
            or size is None
            or str(size) != said.get("glyphSize")
        ):
            self._note(said)
        run, faces = self._waiting, list(element)
        if said.get("type") == "DELETE":
            self._faces(self._dimensions).absent.add(len(self._faces(self._dimensions)) + len(run.corners))
        for order, face in enumerate(faces):
            self._take_face(face, f"<face> {order + 1} of frame {frame}")
        if not faces:
            run.lines.append(line)
            run.corners.append(b"")
            run.codes.append(b"")
        if (element.text or "").strip():
            self._findings.append(f"line {line}: text in a <marker> with faces was not imported")
        run.frames.append(frame)
        run.sizes.append(size or 0)
        run.counts.append(len(faces))
        if len(run.corners) >= _RUN_FACES:
            self._flush()

    def _take_face(self, face: Element, name: str) -> None:
        tags = [tag_of(child) for child in face]
        if face.tag != "face" or not {"bounding", "code"} <= set(tags):
            found = ", ".join(f"<{tag}>" for tag in tags) or "nothing"
            self._bad(f"line {face.sourceline}, {name}: expected <bounding> and <code>, found {found}")
        elif tags != ["bounding", "code"]:
            self._findings.append(
                f"line {face.sourceline}, {name}: more than <bounding> and <code>; not imported"
            )
        self._waiting.lines.append(face.sourceline or 0)
        self._waiting.corners.append((face.findtext("bounding") or "").encode())
        self._waiting.codes.append((face.findtext("code") or "").encode())

    def _note(self, said: dict[str, str]) -> None:
        """Keep the attributes of a marker that has others than usual; the name says which marker of which list."""
        self._read.notes.append(fact(f"marker{self._dimensions}d@{said['frame']}", json.dumps(said)))

    def _bad(self, where: str) -> None:
        refuse_marker(self._what, where, skip=self._skip_bad, findings=self._findings)

    def _faces(self, dimensions: int) -> Faces:
        faces = self._read.faces.get(dimensions)
        if faces is None:
            faces = Faces(dimensions, self._what, self._book, self._skip_bad, self._findings)
            self._read.faces[dimensions] = faces
        return faces

    def _flush(self) -> None:
        """Hand over the faces that came through the parser."""
        if self._waiting.frames:
            waiting, self._waiting = self._waiting, _Waiting()
            self._faces(self._dimensions).add(waiting.run())
