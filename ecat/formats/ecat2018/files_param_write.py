"""Writing ``files.param`` from a session's own XML and tables (ECAT 2018 file format §1.2.1).

What was imported and not changed comes out byte for byte; what ECAT cannot express is left out and named.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from ecat.formats.ecat2018.elements import PREFIX, kept, kept_attributes
from ecat.formats.ecat2018.events import EVENT_CHILDREN, is_type_read, with_action
from ecat.formats.ecat2018.face_lines import FaceLines, ReadTable
from ecat.formats.ecat2018.files_param import DECLARATION, SECTIONS
from ecat.formats.ecat2018.key_frames import key_frame_attributes, key_frame_text
from ecat.formats.ecat2018.lexical import attribute, text
from ecat.formats.ecat2018.nesting import linked, unread_tiers
from ecat.formats.ecat2018.objects import SHAPES, is_attribute, object_attributes
from ecat.formats.ecat2018.old_ids import with_old_ids
from ecat.formats.ecat2018.relations import link_attributes, link_spans, predicate_attributes
from ecat.model import AnnotatedObject, Event, KeyFrame, Layer, Manifest, Property, Relation, Stream


def file_name(manifest: Manifest, stream: Stream) -> str:
    """The name of a stream's file in an ECAT session: as imported, or its own name without folders."""
    imported = manifest.provenance.format == "ecat-2018"
    return stream.name if imported else stream.file.rpartition("/")[2] or stream.name


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
    held = ""
    for piece in _Writer(manifest, layer, read, foreign, findings).lines():
        if held:
            yield held.replace("\n", line_end).encode()
        held = piece
    # no line end after </session>, unless the file had one
    yield (held.removesuffix("\n") + foreign.get("end", "")).replace("\n", line_end).encode()


class _Writer:
    def __init__(
        self, manifest: Manifest, layer: Layer, read: ReadTable, foreign: dict[str, str], findings: list[str]
    ) -> None:
        self._manifest = manifest
        # what was imported keeps the ids that it had
        self._imported = manifest.provenance.format == "ecat-2018"
        self._layer, self._known_as = (layer, {}) if self._imported else with_old_ids(layer)
        self._read = read
        self._foreign = foreign
        self._findings = findings
        self._file_names = {stream.name: file_name(manifest, stream) for stream in manifest.streams}
        self._links: dict[str, list[Relation]] = {}
        self._predicates: list[Relation] = []
        for relation in self._layer.relations:
            if kept(relation.foreign, "link") is not None and relation.targets:
                self._links.setdefault(relation.targets[0], []).append(relation)
            else:
                self._predicates.append(relation)

    def lines(self) -> Iterator[str]:
        """The document in pieces that end with a line feed."""
        declaration = self._foreign.get("declaration", DECLARATION)
        if declaration:
            yield f"{declaration}\n"
        yield f"<session{_said(self._session_attributes())}>\n"
        # a section that the file did not have is written once there is something in it
        needed = {
            "files": "sections" not in self._foreign,
            "objects": "sections" not in self._foreign or self._layer.objects,
            "annotations": "sections" not in self._foreign or self._layer.events,
            "predicates": self._predicates or self._foreign.get("predicates") == "yes",
        }
        order = [name for name in self._foreign.get("sections", "").split(",") if name in SECTIONS]
        for name in dict.fromkeys([*order, *(name for name in SECTIONS if needed[name])]):
            yield from self._section(name)
        yield "</session>\n"

    def _section(self, name: str) -> Iterator[str]:
        write = {
            "files": self._files,
            "objects": self._objects,
            "annotations": self._annotations,
            "predicates": self._predicate_lines,
        }
        head = f"{name}{_said(self._section_attributes(name))}"
        return _wrapped(head, write[name](), "  ", or_empty=True)

    def _section_attributes(self, name: str) -> list[tuple[str, str]]:
        said: list[tuple[str, str]] = []
        if name == "objects" and self._foreign.get("objects@no") != "absent":
            said.append(("no", str(self._layer.object_counter)))
        # ECAT's last version reads no events without it; the earlier ones neither wrote nor miss it
        if name == "annotations" and ("annotations@no" in self._foreign or not self._imported):
            said.append(("no", str(self._layer.event_counter)))
        others = (
            (key.removeprefix(f"{name}@"), value)
            for key, value in self._foreign.items()
            if key.startswith(f"{name}@")
        )
        return said + [(key, value) for key, value in others if key != "no"]

    def _session_attributes(self) -> list[tuple[str, str]]:
        manifest, foreign = self._manifest, self._foreign
        order = foreign.get("attributes", "name").split(",")
        values: dict[str, str] = {"name": foreign.get("name", manifest.name)} if "name" in order else {}
        if foreign.get("length") != "absent" or manifest.n_frames:
            values["length"] = self._number("length", manifest.n_frames)
        milliseconds = (manifest.clock.duration_ns or 0) // 1_000_000
        if milliseconds or "duration" in foreign:
            values["duration"] = self._number("duration", milliseconds)
        start, raw = manifest.clock.start, foreign.get("startWriteRGB")
        if raw is not None and (raw.removesuffix("Z") or None) == start:
            values["startWriteRGB"] = raw
        elif start is not None:
            values["startWriteRGB"] = f"{start}Z"
        values |= {k.removeprefix("session@"): v for k, v in foreign.items() if k.startswith("session@")}
        return [(name, values[name]) for name in dict.fromkeys([*order, *values]) if name in values]

    def _number(self, name: str, value: int) -> str:
        """A count; what was no usual number is written as it was while it still means the same."""
        raw = self._foreign.get(name, "").removeprefix("=")
        digits = raw.lstrip("0")
        means = int(digits) if digits.isascii() and digits.isdigit() and len(digits) <= 9 else 0
        return raw if name in self._foreign and raw != "absent" and means == value else str(value)

    # ------------------------------------------------------------------------------------------- files, objects

    def _files(self) -> Iterator[str]:
        listed = self._foreign.get("files")
        unlisted = set(self._foreign["unlisted"].split("\n")) if "unlisted" in self._foreign else set[str]()
        names = [name for name in self._file_names.values() if name not in unlisted]
        if listed is not None:
            said = [name for name in listed.split("\n") if name in names]
            names = said + [name for name in names if name not in said]
        yield from (_leaf("file", name, "    ") for name in names)

    def _objects(self) -> Iterator[str]:
        faces = FaceLines(self._read)
        for thing in self._layer.objects:
            if thing.kind not in SHAPES and kept(thing.foreign, "shape") is None:
                self._findings.append(
                    f"object {thing.id}: ECAT has no objects of the kind {thing.kind!r}; left out"
                )
                continue
            named = replace(thing, stream=self._file_names.get(thing.stream, thing.stream))
            named = replace(named, properties=tuple(self._writable(named)))
            if thing.interpolation == "hold":
                self._findings.append(
                    f"object {thing.id}: ECAT interpolates all alike; that its shape holds is left out"
                )
            head = f"object{_said(object_attributes(named))}"
            yield from _wrapped(head, self._object_body(thing, faces), "    ", or_empty=True)

    def _writable(self, thing: AnnotatedObject) -> Iterator[Property]:
        """The properties that can be attributes; one that has the name of another attribute would take its place."""
        for item in thing.properties:
            if kept(thing.foreign, "attributes") is not None or is_attribute(item.name):
                yield item
            else:
                self._findings.append(
                    f"object {thing.id}: the property {item.name!r} cannot be an attribute of an object; left out"
                )

    def _object_body(self, thing: AnnotatedObject, faces: FaceLines) -> Iterator[str]:
        flat = kept(thing.foreign, "layout") == "flat"
        for dimensions, keys in ((2, thing.key_frames), (3, thing.key_frames_3d)):
            if thing.kind == "marker_box":
                # the tables know it by the id that it has in the session
                marked = replace(thing, id=self._known_as.get(thing.id, thing.id))
                lines = faces.markers(marked, dimensions)
            else:
                lines = (_drawn(key, dimensions) for key in keys)
            if flat and dimensions == 2:
                yield from (line.removeprefix("  ").replace("\n  ", "\n") for line in lines)
            else:
                yield from _wrapped("markers" if dimensions == 2 else "markers3d", lines, "      ")
        yield from self._object_links(thing)

    def _object_links(self, thing: AnnotatedObject) -> Iterator[str]:
        mine = self._links.get(thing.id, [])
        wrapped, bare = kept(thing.foreign, "links"), kept(thing.foreign, "spatialLinks")
        spans = link_spans(wrapped or bare or "", mine)
        if bare is not None:
            for frame, relations in spans:
                yield from _link("spatialLink", frame, relations, "      ")
        elif wrapped is not None or spans:
            lines = (
                line for frame, relations in spans for line in _link("link", frame, relations, "        ")
            )
            yield from _wrapped("links", lines, "      ", or_empty=True)

    # ------------------------------------------------------------------------------------------- events, relations

    def _annotations(self) -> Iterator[str]:
        parts: dict[str, list[str]] = {}
        written = [event for event in self._layer.events if event.status == "confirmed"]
        for event in written:
            if event.parent is None:
                continue
            if kept(event.foreign, "id") is None:
                parts.setdefault(event.parent, []).append(event.id)
            else:
                self._findings.append(
                    f"event {event.id}: not the only one of its id in the file; that it is a part of {event.parent} "
                    f"was left out"
                )
        self._findings += _left_out(written)
        for event in self._layer.events:
            if event.status == "proposed":
                self._findings.append(f"event {event.id}: a proposal; left out until it is confirmed")
            else:
                values = {"id": kept(event.foreign, "id") or event.id}
                head = f"annotation{_said(kept_attributes(values, event.foreign))}"
                body = self._event_body(with_action(event), parts.get(event.id, []))
                yield from _wrapped(head, body, "    ", or_empty=True)

    def _event_body(self, event: Event, parts: list[str]) -> Iterator[str]:
        lists = {
            "refs": [("ref", _pairs(start=r.start, end=r.end, refTo=r.target)) for r in event.references],
            "events": [
                ("event", _pairs(start=p.start, end=p.end, semanticType=p.type)) for p in event.predicates
            ],
            "link": [("linkTo", [("id", target), ("type", kind)]) for target, kind in linked(event, parts)],
        }
        had = kept(event.foreign, "children")
        filled = {"duration": event.segments, "text": event.text, **lists}
        order = [tag for tag in (had or "").split(",") if tag in EVENT_CHILDREN]
        order += [tag for tag in EVENT_CHILDREN if had is None or filled[tag]]
        for tag in dict.fromkeys(order):
            if tag == "duration":
                yield self._duration(event)
            elif tag == "text":
                yield _leaf("text", event.text, "      ")
            else:
                lines = (f"        <{name}{_said(values)} />\n" for name, values in lists[tag])
                yield from _wrapped(tag, lines, "      ", or_empty=True)

    def _duration(self, event: Event) -> str:
        if not event.segments:
            return ""
        n = len(event.segments)
        if n > 1:
            self._findings.append(
                f"event {event.id}: ECAT has one span per event; {n} segments became the span over all"
            )
        start = min(s.start_frame for s in event.segments) + 1
        end = max(s.end_frame for s in event.segments)
        return f"      <duration{_said(_pairs(startFrame=start, endFrame=end))} />\n"

    def _predicate_lines(self) -> Iterator[str]:
        for relation in self._predicates:
            strange = len(relation.arguments) not in {1, 2} and kept(relation.foreign, "type") is None
            if relation.status == "proposed" or strange:
                why = (
                    "a proposal" if relation.status == "proposed" else f"{len(relation.arguments)} arguments"
                )
                self._findings.append(f"relation {relation.predicate}{relation.targets}: {why}; left out")
                continue
            yield f"    <predicate{_said(predicate_attributes(relation))} />\n"
            # a fact that holds to the end of the recording needs no denial after it
            to_the_end = 0 < self._manifest.n_frames <= (relation.end_frame or 0)
            if relation.end_frame is not None and relation.polarity and not to_the_end:
                ended = replace(relation, start_frame=relation.end_frame, polarity=False, foreign=())
                yield f"    <predicate{_said(predicate_attributes(ended))} />\n"


def _left_out(events: Sequence[Event]) -> Iterator[str]:
    """What events say and ECAT cannot express, a line for each kind."""
    lists = {
        "ECAT has no roles; left out": [e.id for e in events if e.roles],
        "ECAT has no doubts; left out": [e.id for e in events if e.unsure],
        "ECAT has no properties of events; left out": [e.id for e in events if e.properties],
        "ECAT has no tiers; left out": unread_tiers(events),
        "ECAT has no types, but the action that a text names": [e.id for e in events if not is_type_read(e)],
    }
    for what, ids in lists.items():
        few = ", ".join(ids[:3]) + (f" and {len(ids) - 3} more" if len(ids) > 3 else "")
        if ids:
            yield f"{'event' if len(ids) == 1 else 'events'} {few}: {what}"


def _said(attributes: Sequence[tuple[str, str]]) -> str:
    return "".join(attribute(name, value) for name, value in attributes)


def _pairs(**values: object) -> list[tuple[str, str]]:
    return [(name, str(value)) for name, value in values.items()]


def _wrapped(head: str, lines: Iterator[str], indent: str, *, or_empty: bool = False) -> Iterator[str]:
    """``lines`` inside of an element; without lines the empty element, or nothing."""
    first = next(lines, None)
    if first is not None:
        yield f"{indent}<{head}>\n{first}"
        yield from lines
        yield f"{indent}</{head.partition(' ')[0]}>\n"
    elif or_empty:
        yield f"{indent}<{head} />\n"


def _leaf(tag: str, value: str, indent: str, attributes: str = "") -> str:
    body = text(value)
    return f"{indent}<{tag}{attributes}>{body}</{tag}>\n" if body else f"{indent}<{tag}{attributes} />\n"


def _drawn(key: KeyFrame, dimensions: int) -> str:
    said = _said(key_frame_attributes(key, dimensions))
    return _leaf("marker", key_frame_text(key, dimensions), "        ", said)


def _link(tag: str, frame: int, relations: list[Relation], indent: str) -> Iterator[str]:
    lines = (f"{indent}  <linkTo{_said(link_attributes(relation))} />\n" for relation in relations)
    return _wrapped(f"{tag}{attribute('frame', str(frame))}", lines, indent, or_empty=True)
