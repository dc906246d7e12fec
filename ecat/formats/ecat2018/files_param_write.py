"""Writing ``files.param`` from a session's own XML and tables (ECAT 2018 file format §1.2.1).

What was imported and not changed comes out byte for byte; what ECAT cannot express is left out and named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ecat.formats.ecat2018.elements import (
    EVENT_CHILDREN,
    PREFIX,
    SHAPES,
    kept,
    key_frame_text,
    link_type,
    object_attributes,
    predicate_attributes,
)
from ecat.formats.ecat2018.files_param import DECLARATION
from ecat.formats.ecat2018.lexical import attribute, format_code, format_numbers, missing_corners, parse_code, text
from ecat.formats.ecat2018.marks import KINECT_TO_CAMERA
from ecat.formats.ecat2018.xml_input import parse_floats
from ecat.model import AnnotatedObject, Event, KeyFrame, Layer, Manifest, Property, Relation, Stream

def file_name(manifest: Manifest, stream: Stream) -> str:
    """The name of a stream's file in an ECAT session: as imported, or its own name without folders."""
    return stream.name if manifest.provenance.format == "ecat-2018" else stream.file.rpartition("/")[2] or stream.name


ReadTable = Callable[[str], pa.Table | None]
"""Gives a table of the session by name, or None."""


def files_param(manifest: Manifest, layer: Layer, read: ReadTable, findings: list[str]) -> Iterator[bytes]:
    """The document, in pieces.

    Parameters
    ----------
    manifest, layer, read : the session.
    findings : gets a line for everything that ECAT cannot express.
    """
    foreign = {
        key.removeprefix(PREFIX): value for key, value in manifest.foreign.items() if key.startswith(PREFIX)
    }
    line_end = "\r\n" if foreign.get("line_end") == "crlf" else "\n"
    if foreign.get("bom") != "no":
        yield b"\xef\xbb\xbf"
    writer = _Writer(manifest, layer, read, foreign, findings)
    end = foreign.get("end", "")
    held = ""
    for piece in writer.lines():
        if held:
            yield held.replace("\n", line_end).encode()
        held = piece
    # no line end after </session>, unless the file had one
    yield (held.removesuffix("\n") + end).replace("\n", line_end).encode()


class _Writer:
    def __init__(
        self, manifest: Manifest, layer: Layer, read: ReadTable, foreign: dict[str, str], findings: list[str]
    ) -> None:
        self._manifest = manifest
        self._layer = layer
        self._read = read
        self._foreign = foreign
        self._findings = findings
        self._roles = 0
        self._file_names = {stream.name: file_name(manifest, stream) for stream in manifest.streams}
        self._link_relations = [r for r in layer.relations if kept(r.foreign, "link") is not None]
        self._predicates = [r for r in layer.relations if kept(r.foreign, "link") is None]

    def lines(self) -> Iterator[str]:
        """The document in pieces that end with a line feed."""
        declaration = self._foreign.get("declaration", DECLARATION)
        if declaration:
            yield f"{declaration}\n"
        yield f"<session{''.join(attribute(n, v) for n, v in self._session_attributes())}>\n"
        with_predicates = self._predicates or self._foreign.get("predicates") == "yes"
        usual = ["files", "objects", "annotations", *(["predicates"] if with_predicates else [])]
        order = self._foreign["sections"].split(",") if "sections" in self._foreign else usual
        order = [name for name in order if name]
        # a section that the file did not have is written once there is something in it
        content = {"objects": self._layer.objects, "annotations": self._layer.events, "predicates": self._predicates}
        order += [name for name in usual if name not in order and content.get(name)]
        write = {
            "files": self._files,
            "objects": self._objects,
            "annotations": self._annotations,
            "predicates": self._predicate_lines,
        }
        for name in order:
            yield from self._section(name, write[name]())
        yield "</session>\n"

    def _section(self, name: str, lines: Iterator[str]) -> Iterator[str]:
        head = f"  <{name}{self._section_attributes(name)}"
        empty = True
        for line in lines:
            if empty:
                yield f"{head}>\n"
                empty = False
            yield line
        yield f"{head} />\n" if empty else f"  </{name}>\n"

    def _section_attributes(self, name: str) -> str:
        said: list[tuple[str, str]] = []
        if name == "objects" and self._foreign.get("objects@no") != "absent":
            said.append(("no", str(self._layer.object_counter)))
        if name == "annotations" and "annotations@no" in self._foreign:
            said.append(("no", str(self._layer.event_counter)))
        prefix = f"{name}@"
        said += [(k.removeprefix(prefix), v) for k, v in self._foreign.items() if k.startswith(prefix) and k[len(prefix):] != "no"]
        return "".join(attribute(n, v) for n, v in said)

    def _session_attributes(self) -> list[tuple[str, str]]:
        manifest, foreign = self._manifest, self._foreign
        values: dict[str, str] = {"name": foreign.get("name", manifest.name)}
        if foreign.get("length") != "absent":
            values["length"] = self._number("length", manifest.n_frames)
        milliseconds = (manifest.clock.duration_ns or 0) // 1_000_000
        if milliseconds or "duration" in foreign:
            values["duration"] = self._number("duration", milliseconds)
        if manifest.clock.start is not None:
            raw = foreign.get("startWriteRGB")
            same = raw is not None and raw.removesuffix("Z") == manifest.clock.start
            values["startWriteRGB"] = raw if same and raw is not None else f"{manifest.clock.start}Z"
        values |= {k.removeprefix("session@"): v for k, v in foreign.items() if k.startswith("session@")}
        order = foreign.get("attributes")
        if order is None:
            return list(values.items())
        said = order.split(",")
        return [(n, values[n]) for n in said if n in values] + [(n, v) for n, v in values.items() if n not in said]

    def _number(self, name: str, value: int) -> str:
        """A count; what was no number is written as it was while the count is still 0."""
        raw = self._foreign.get(name, "")
        return raw[1:] if raw.startswith("=") and (value == 0 or raw[1:].lstrip("0+ ") == str(value)) else str(value)

    # ------------------------------------------------------------------------------------------- sections

    def _files(self) -> Iterator[str]:
        listed = self._foreign.get("files")
        unlisted = set(self._foreign.get("unlisted", "").split("\n"))
        names = [name for name in self._file_names.values() if name not in unlisted]
        if listed is not None:
            said = listed.split("\n") if listed else []
            names = [n for n in said if n in names] + [n for n in names if n not in said]
        yield from (_leaf("file", "", name, "    ") for name in names)

    def _objects(self) -> Iterator[str]:
        faces = _FaceLines(self._read)
        for thing in self._layer.objects:
            if thing.kind == "point":
                self._findings.append(f"object {thing.id}: ECAT has no points; left out")
                continue
            body = self._object_body(thing, faces)
            named = replace(thing, stream=self._file_names.get(thing.stream, thing.stream))
            if thing.kind == "rig":
                named = replace(named, properties=(*thing.properties, *self._rig_properties(thing)))
            said = "".join(attribute(n, v) for n, v in object_attributes(named))
            first = next(body, None)
            if first is None:
                yield f"    <object{said} />\n"
                continue
            yield f"    <object{said}>\n{first}"
            yield from body
            yield "    </object>\n"

    def _rig_properties(self, thing: AnnotatedObject) -> list[Property]:
        """Where a rig's joints are, if the object does not say so itself (it was not imported from ECAT)."""
        said = {p.name for p in thing.properties}
        skeletons = [self._file_names[s.name] for s in self._manifest.streams if s.kind == "skeleton"]
        joints = self._read("joints")
        if not skeletons or joints is None or "source" in said:
            return []
        mine = joints.filter(pc.equal(joints["object_id"], pa.scalar(thing.id)))
        body = mine["body"][0].as_py() if mine.num_rows else 0
        scheme = next((n for n in self._file_names.values() if n.lower() == "bodyscheme.xml"), "bodyScheme.xml")
        values = {"rigIndex": str(body), "source": skeletons[0], "sourceScheme": scheme}
        return [Property(name, value) for name, value in values.items() if name not in said]

    def _object_body(self, thing: AnnotatedObject, faces: _FaceLines) -> Iterator[str]:
        for dimensions, keys in ((2, thing.key_frames), (3, thing.key_frames_3d)):
            tag = "markers3d" if dimensions == 3 else "markers"  # noqa: PLR2004
            if thing.kind == "marker_box":
                lines = faces.markers(thing, dimensions)
            else:
                lines = (_drawn(key, dimensions) for key in keys)
            first = next(lines, None)
            if first is None:
                continue
            if kept(thing.foreign, "layout") == "flat":
                yield from (line.removeprefix("  ") for line in (first, *lines))
                continue
            yield f"      <{tag}>\n{first}"
            yield from lines
            yield f"      </{tag}>\n"
        yield from self._links(thing)

    def _links(self, thing: AnnotatedObject) -> Iterator[str]:
        mine = [r for r in self._link_relations if r.targets[:1] == (thing.id,)]
        wrapped = kept(thing.foreign, "links")
        bare = kept(thing.foreign, "spatialLinks")
        layout = wrapped if wrapped is not None else bare
        if layout is None and not mine:
            return
        frames = [f for f in (layout or "").split(",") if f]
        frames += [f for f in dict.fromkeys(str(r.start_frame + 1) for r in mine) if f not in frames]
        tag, indent = ("spatialLink", "      ") if bare is not None else ("link", "        ")
        lines = [self._link(tag, frame, [r for r in mine if str(r.start_frame + 1) == frame], indent) for frame in frames]
        if bare is not None:
            yield from lines
        elif lines:
            yield "      <links>\n"
            yield from lines
            yield "      </links>\n"
        else:
            yield "      <links />\n"

    def _link(self, tag: str, frame: str, relations: list[Relation], indent: str) -> str:
        lines: list[str] = []
        for relation in relations:
            said = dict(predicate_attributes(relation))
            kind = said["type"] if kept(relation.foreign, "type") is not None else relation.predicate
            values: list[tuple[str, str]] = []
            for target in relation.targets[1:2]:
                session, _, other = target.rpartition("/")
                values += [("otherSession", session)] if session else []
                values.append(("id", other))
            if kept(relation.foreign, "q") != "absent":
                values.append(("q", said["q"]))
            values.append(("type", kind))
            lines.append(f"{indent}  <linkTo{''.join(attribute(n, v) for n, v in values)} />\n")
        head = f"{indent}<{tag}{attribute('frame', frame)}"
        return f"{head}>\n{''.join(lines)}{indent}</{tag}>\n" if lines else f"{head} />\n"

    def _annotations(self) -> Iterator[str]:
        children: dict[str, list[str]] = {}
        for event in self._layer.events:
            if event.parent is not None:
                children.setdefault(event.parent, []).append(event.id)
        for event in self._layer.events:
            if event.status == "proposed":
                self._findings.append(f"event {event.id}: a proposal; left out until it is confirmed")
            else:
                yield self._annotation(event, children.get(event.id, []))
        if self._roles:
            self._findings.append(f"ECAT has no roles: {self._roles} roles of events were left out")

    def _annotation(self, event: Event, parts: list[str]) -> str:
        event_id = kept(event.foreign, "id") or event.id
        said: dict[str, str] = {"id": event_id}
        order = kept(event.foreign, "attributes")
        names = order.split(",") if order is not None else ["id"]
        head = "".join(attribute(n, said.get(n) or kept(event.foreign, f"@{n}") or "") for n in names if n)
        links = [(link.target, link_type(link)) for link in event.links]
        linked = {(target, kind.partition("(")[0]) for target, kind in links}
        links += [(part, "SUBEVENT(X,Y)") for part in parts if (part, "SUBEVENT") not in linked]
        body = {
            "duration": self._duration(event),
            "text": _leaf("text", "", event.text, "      "),
            "refs": _list("refs", [("ref", _pairs(start=r.start, end=r.end, refTo=r.target)) for r in event.references]),
            "events": _list(
                "events", [("event", _pairs(start=p.start, end=p.end, semanticType=p.type)) for p in event.predicates]
            ),
            "link": _list("link", [("linkTo", [("id", target), ("type", kind)]) for target, kind in links]),
        }
        self._roles += len(event.roles)
        tags = kept(event.foreign, "children")
        chosen = EVENT_CHILDREN if tags is None else tuple(tag for tag in tags.split(",") if tag in body)
        lines = "".join(body[tag] for tag in chosen)
        return f"    <annotation{head}>\n{lines}    </annotation>\n" if lines else f"    <annotation{head} />\n"

    def _duration(self, event: Event) -> str:
        if not event.segments:
            return ""
        if len(event.segments) > 1:
            self._findings.append(
                f"event {event.id}: ECAT has one span per event; {len(event.segments)} segments became the span over all"
            )
        start = min(s.start_frame for s in event.segments) + 1
        end = max(s.end_frame for s in event.segments)
        return f"      <duration{attribute('startFrame', str(start))}{attribute('endFrame', str(end))} />\n"

    def _predicate_lines(self) -> Iterator[str]:
        for relation in self._predicates:
            if relation.status == "proposed" or len(relation.targets) not in (0, 1, 2):
                self._findings.append(f"relation {relation.predicate}{relation.targets}: left out")
                continue
            yield _predicate(relation)
            # a fact that holds to the end of the recording needs no denial after it
            if relation.end_frame is not None and relation.polarity and relation.end_frame < self._manifest.n_frames:
                ended = Relation(
                    predicate=relation.predicate,
                    start_frame=relation.end_frame,
                    polarity=False,
                    arguments=relation.arguments,
                )
                yield _predicate(ended)


def _pairs(**values: object) -> list[tuple[str, str]]:
    return [(name, str(value)) for name, value in values.items()]


def _predicate(relation: Relation) -> str:
    return f"    <predicate{''.join(attribute(n, v) for n, v in predicate_attributes(relation))} />\n"


def _leaf(tag: str, attributes: str, value: str, indent: str) -> str:
    body = text(value)
    return f"{indent}<{tag}{attributes}>{body}</{tag}>\n" if body else f"{indent}<{tag}{attributes} />\n"


def _list(tag: str, items: Sequence[tuple[str, list[tuple[str, str]]]]) -> str:
    if not items:
        return f"      <{tag} />\n"
    lines = "".join(f"        <{name}{''.join(attribute(n, v) for n, v in values)} />\n" for name, values in items)
    return f"      <{tag}>\n{lines}      </{tag}>\n"


def _drawn(key: KeyFrame, dimensions: int) -> str:
    values = {"frame": str(key.frame + 1)}
    if dimensions == 2:  # noqa: PLR2004
        values = {"type": "LOCATION" if key.present else "DELETE"} | values
    order = kept(key.foreign, "attributes")
    names = order.split(",") if order is not None else list(values)
    said = "".join(attribute(n, values[n] if n in values else kept(key.foreign, f"@{n}") or "") for n in names)
    return _leaf("marker", said, key_frame_text(key, dimensions), "        ")


class _FaceLines:
    """The markers of glyph boxes, from the tables."""

    def __init__(self, read: ReadTable) -> None:
        self._read = read
        self._tables: dict[int, pa.Table | None] = {}
        self._codes: dict[tuple[str | None, str | None], str] = {}

    def markers(self, thing: AnnotatedObject, dimensions: int) -> Iterator[str]:
        """The lines of an object's marker list, one marker at a time."""
        if dimensions not in self._tables:
            self._tables[dimensions] = self._read(f"markers_{dimensions}d")
        table = self._tables[dimensions]
        if table is None:
            return
        mine = table.filter(pc.equal(table["object_id"], pa.scalar(thing.id)))
        for batch in mine.to_batches(max_chunksize=16_384):
            yield from self._batch(thing, batch, dimensions)

    def _batch(self, thing: AnnotatedObject, batch: pa.RecordBatch, dimensions: int) -> Iterator[str]:
        columns: dict[str, list[Any]] = {
            name: batch.column(name).to_pylist()
            for name in ("frame", "order", "present", "glyph_size", "code", "code_text", "corners_text")
        }
        first = batch.schema.get_field_index("corners_text") + 1
        numbers = np.column_stack(
            [batch.column(i).to_numpy(zero_copy_only=False) for i in range(first, batch.num_columns)]
        )
        if dimensions == 3:  # noqa: PLR2004
            numbers = numbers * np.tile(KINECT_TO_CAMERA, 4)
        corners = [format_numbers(row) for row in numbers.tolist()]
        marker: list[str] = []
        for i, order in enumerate(columns["order"]):
            row = {name: values[i] for name, values in columns.items()}
            if order is None or order == 0:
                if marker:
                    yield "".join(marker) + "        </marker>\n"
                    marker = []
                head = self._head(thing, row, dimensions)
                if order is None:
                    yield f"        <marker{head} />\n"
                    continue
                marker = [f"        <marker{head}>\n"]
            said = row["corners_text"]
            if said is None or not _same_corners(said, numbers[i], dimensions):
                said = corners[i]
            marker.append(
                f"          <face>\n            <bounding>{said}</bounding>\n"
                f"            <code>{self._code(row['code'], row['code_text'])}</code>\n          </face>\n"
            )
        if marker:
            yield "".join(marker) + "        </marker>\n"

    def _head(self, thing: AnnotatedObject, row: dict[str, Any], dimensions: int) -> str:
        values = {"frame": str(row["frame"])}
        if dimensions == 2:  # noqa: PLR2004
            values = {"type": "LOCATION" if row["present"] else "DELETE"} | values
        if row["glyph_size"] is not None:
            values["glyphSize"] = str(row["glyph_size"])
        note = kept(thing.foreign, f"marker{dimensions}d@{row['frame']}")
        names = list(values)
        if note is not None:
            order, _, extra = note.partition(";")
            values = dict(pair.split("=", 1) for pair in extra.split("|") if pair) | values
            names = order.split(",")
        return "".join(attribute(name, values.get(name, "")) for name in names)

    def _code(self, code: str | None, raw: str | None) -> str:
        key = (code, raw)
        if key not in self._codes:
            same = raw is not None and (code is None or parse_code(raw) == code)
            self._codes[key] = text(raw) if same and raw is not None else format_code(code or "")
        return self._codes[key]


def _same_corners(raw: str, numbers: np.ndarray[Any, np.dtype[np.float64]], dimensions: int) -> bool:
    """Whether the kept text still says what the table says (``numbers`` in the file's axes)."""
    try:
        values = parse_floats(raw.strip())
    except Exception:  # noqa: BLE001  # what could not be read at import stands for missing numbers
        return bool(np.isnan(numbers).all())
    if len(values) != len(numbers):
        return bool(np.isnan(numbers).all())
    if dimensions == 3:  # noqa: PLR2004
        missing, _ = missing_corners(values.reshape(1, 4, 3))
        values = np.where(missing[..., None], np.nan, values.reshape(1, 4, 3)).ravel()
    else:
        values = np.where(np.isfinite(values), values, np.nan)
    return np.array_equal(values, numbers, equal_nan=True)


__all__ = ["SHAPES", "files_param"]
