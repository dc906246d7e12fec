"""A layer made of what was found in a file, with a session's clock and the objects that it has."""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Sequence
from dataclasses import replace
from itertools import count

from ecat.errors import LimitError
from ecat.formats.interchange.facts import labels_of, understood
from ecat.formats.interchange.found import Found, FoundEvent, FoundObject, FoundShape, Frames, Times
from ecat.formats.interchange.shapes import simplified
from ecat.formats.interchange.source import counted, listed
from ecat.formats.interchange.times import MOST_FRAMES, SECOND_NS, FrameTimes
from ecat.model import AnnotatedObject, Event, KeyFrame, Layer, Segment

MOST_EVENTS = 500_000
MOST_SHAPES = 2_000_000
_ID = re.compile(r"[A-Za-z_][\w.-]{0,63}", re.ASCII)
_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def layer_of(
    found: Found,
    times: FrameTimes,
    what: str,
    *,
    known: Sequence[AnnotatedObject] = (),
    stream: str = "",
    n_frames: int = 0,
    size_px: tuple[int, int] | None = None,
) -> tuple[Layer, tuple[str, ...]]:
    """The layer that says what was found, and what could not be said in it.

    Parameters
    ----------
    times : of the session's images. known : objects that the session has already; the file may name them.
    stream : the video on which shapes are drawn. n_frames : how many images the session has, if that is known: a
    file that counts others is about the same video at another rate. size_px : of its images, if that is known.

    Raises
    ------
    LimitError : more than ecat is willing to read.
    """
    if len(found.events) > MOST_EVENTS or sum(len(o.shapes) for o in found.objects) > MOST_SHAPES:
        raise LimitError(
            what, where=f"more than {MOST_EVENTS:,} events, or {MOST_SHAPES:,} shapes", fix="split the file"
        )
    made = _Making(found, times, known, stream=stream, n_frames=n_frames, size_px=found.size_px or size_px)
    layer = made.layer()
    return layer, (*found.findings, *made.findings())


class _Making:
    """A layer being made."""

    def __init__(
        self,
        found: Found,
        times: FrameTimes,
        known: Sequence[AnnotatedObject],
        *,
        stream: str,
        n_frames: int,
        size_px: tuple[int, int] | None,
    ) -> None:
        self._found = found
        self._times = times
        self._stream = stream
        self._size_px = size_px
        self._unsized = 0
        self._other_hz = self._counts_otherwise(found, n_frames)
        self._last_ns = min(times.ns(MOST_FRAMES), 2**63 - 1)
        self._outside = self._cleaned = self._orphans = self._untied = self._beyond = 0
        self._ids: set[str] = set()
        self._numbers = count(1)
        self._objects: dict[str, AnnotatedObject] = {}
        self._labels: dict[str, str] = {}
        self._new_objects: list[str] = []
        labels = labels_of({thing.id: thing for thing in reversed(known)}.values())
        self._known = {labels[thing.id]: thing for thing in reversed(known)}
        self._known_ids = {thing.id: thing for thing in reversed(known)}

    def layer(self) -> Layer:
        """The layer."""
        self._reserve()
        for found in self._found.objects:
            self._add_object(found)
        events = [self._event(found) for found in self._found.events]
        events = self._tied(events)
        objects = tuple(self._objects.values())
        return Layer(
            scheme=self._found.scheme_name,
            object_counter=_last_number("o", [thing.id for thing in objects]),
            event_counter=_last_number("a", [event.id for event in events]),
            objects=objects,
            events=tuple(events),
        )

    def findings(self) -> list[str]:
        """What could not be said as it was."""
        unknown = counted(len(self._new_objects), "object")
        said = (
            (
                self._outside,
                f"{counted(self._outside, 'time')} beyond what a recording can have were left out",
            ),
            (
                self._cleaned,
                f"{counted(self._cleaned, 'text')} had characters that XML has not; they were replaced",
            ),
            (
                self._orphans,
                f"{counted(self._orphans, 'event')} named a whole that is not there, or is a part of it",
            ),
            (self._untied, f"{counted(self._untied, 'link')} to an event that is not there were left out"),
            (
                self._unsized,
                f"shapes of {counted(self._unsized, 'object')} left out: the size of the images is not known",
            ),
            (self._beyond, f"{counted(self._beyond, 'mark')} in texts beyond their end were left out"),
            (
                len(self._new_objects),
                f"{unknown} only named, without a shape: {listed(self._new_objects)}",
            ),
        )
        return [line for n, line in said if n]

    def _counts_otherwise(self, found: Found, n_frames: int) -> float | None:
        """Images a second of a file that counts other images than the session has; ``None`` if it counts the same."""
        if not n_frames or not found.n_frames or abs(found.n_frames - n_frames) <= max(2, n_frames // 100):
            return None
        rate = found.rate_hz
        if rate is None and found.duration_ns:
            rate = found.n_frames * SECOND_NS / found.duration_ns
        counts = f"the file counts {found.n_frames:,} images, the session has {n_frames:,}"
        if rate is None or not self._times.known:
            found.findings.append(f"{counts}: its numbers were taken as they are")
            return None
        found.findings.append(f"{counts}: its numbers were taken as times, at {rate:g} images a second")
        return rate

    # ---------------------------------------------------------------------------------------- ids

    def _reserve(self) -> None:
        """Whoever has a key that can be an id keeps it."""
        _tell_apart(self._found)
        self._event_ids = _ids([event.key for event in self._found.events], "a", self._ids)
        keys = [thing.record.id for thing in self._found.objects]
        mine = {
            key: known.id for key in keys if (known := self._known.get(key)) and known.id not in self._ids
        }
        self._ids.update(mine.values())
        # a key that is only the object's name is no id
        named = {thing.record.id for thing in self._found.objects if thing.record.id == thing.record.name}
        self._object_ids = mine | _ids(
            [k for k in keys if k not in mine], "o", self._ids, named - mine.keys()
        )

    def _text(self, text: str) -> str:
        if _NOT_XML.search(text):
            self._cleaned += 1
            return _NOT_XML.sub("\ufffd", text)
        return text

    # ---------------------------------------------------------------------------------------- objects

    def _add_object(self, found: FoundObject) -> None:
        record = found.record
        made = self._object_ids[record.id]
        keys = self._keys(found)
        known = self._known_ids.get(made)
        stream = self._stream or record.stream
        if known is not None and known.kind == record.kind:
            # what the file has no place for is as the session has it
            record = replace(
                record,
                origin=known.origin,
                dimensions=known.dimensions,
                line_width=known.line_width,
                color=known.color,
                semantic_type=record.semantic_type or known.semantic_type,
                properties=record.properties or known.properties,
            )
            stream = known.stream
        texts = {name: self._text(getattr(record, name)) for name in ("name", "semantic_type")}
        properties = tuple(
            replace(p, name=self._text(p.name), value=self._text(p.value)) for p in record.properties
        )
        self._objects[made] = replace(
            record, id=made, stream=stream, key_frames=keys, properties=properties, **texts
        )
        for label in filter(None, (record.id, record.name, made)):
            self._labels.setdefault(label, made)

    def _keys(self, found: FoundObject) -> tuple[KeyFrame, ...]:
        keys: dict[int, KeyFrame] = {}
        if found.per_cent and self._size_px is None:
            self._unsized += 1
            return ()
        for shape in found.shapes:
            if not self._is_told(shape):
                self._outside += 1
                continue
            told = shape.frame
            frame = self._times.frame(shape.t_ns or 0) if told is None else self._image(told)
            t_ns = self._times.ns(frame) if self._times.known else None
            keys[frame] = KeyFrame(
                frame=frame,
                t_ns=t_ns,
                present=shape.present,
                coordinates=self._pixels(shape.coordinates) if found.per_cent else shape.coordinates,
                foreign=shape.foreign,
            )
        ordered = [keys[frame] for frame in sorted(keys)]
        return simplified(ordered) if found.dense else tuple(ordered)

    def _pixels(self, coordinates: tuple[float, ...]) -> tuple[float, ...]:
        """Per cent of the image as pixels, to the millionth."""
        sides = self._size_px or (0, 0)
        return tuple(round(x * sides[at % 2] / 100, 6) for at, x in enumerate(coordinates))

    def _is_told(self, shape: FoundShape) -> bool:
        """Whether a shape is at an image that a recording can have."""
        if shape.frame is None:
            return 0 <= (shape.t_ns or 0) <= self._last_ns
        return 0 <= shape.frame <= MOST_FRAMES

    def _object_of(self, label: str) -> str:
        """The id of the object with this label; one that nobody knows is made."""
        label = self._text(label.strip())
        if label in self._labels:
            return self._labels[label]
        known = self._known.get(label)
        if known is not None and known.id not in self._ids:
            self._ids.add(known.id)
            self._objects[known.id] = replace(known, key_frames=(), key_frames_3d=(), foreign=())
            self._labels[label] = known.id
            return known.id
        made = label
        if not re.fullmatch(r"o\d{1,9}", label) or label in self._ids:
            names = (f"o{n}" for n in self._numbers)
            made = next(name for name in names if name not in self._ids and name not in self._known_ids)
        self._ids.add(made)
        self._objects[made] = AnnotatedObject(id=made, name="" if label == made else label)
        self._labels[label] = made
        self._new_objects.append(label)
        return made

    # ---------------------------------------------------------------------------------------- events

    def _event(self, found: FoundEvent) -> Event:
        said = {self._text(name): self._text(text) for name, text in found.said.items()}
        event = understood(said, self._object_of)
        segments = {self._segment(stretch): None for stretch in found.stretches if self._fits(stretch)}
        return replace(
            event,
            id=self._event_ids[found.key],
            type=self._text(found.type),
            tier=self._text(found.tier),
            segments=tuple(sorted(segments, key=lambda s: (s.start_frame, s.end_frame))),
            foreign=found.foreign,
        )

    def _fits(self, stretch: Times | Frames) -> bool:
        if isinstance(stretch, Times):
            fits = max(stretch.start_ns, stretch.last_ns) <= self._last_ns
        else:
            fits = stretch.start < MOST_FRAMES and stretch.end <= MOST_FRAMES
        self._outside += not fits
        return fits

    def _segment(self, stretch: Times | Frames) -> Segment:
        times = self._times
        frames = stretch if isinstance(stretch, Frames) else None if times.known else stretch.frames
        if frames is not None:
            return times.of_frames(self._image(frames.start), self._image(frames.end))
        assert isinstance(stretch, Times)
        if stretch.end_ns is None:
            return times.of_moment(stretch.start_ns, within_ns=stretch.within_ns)
        return times.of_times(stretch.start_ns, stretch.end_ns, within_ns=stretch.within_ns)

    def _image(self, frame: int) -> int:
        """The session's image for one of the file's, which may count others (:meth:`_counts_otherwise`)."""
        rate = self._other_hz
        return frame if rate is None else self._times.frame(round(frame * SECOND_NS / rate))

    def _tied(self, events: list[Event]) -> list[Event]:
        """Events that name each other by their ids; who names one that is not there, or itself, does not."""
        parents = {event.id: self._event_ids.get(event.parent or "") for event in events}
        _cut_rounds(parents)
        return [self._tie(event, parents[event.id]) for event in events]

    def _tie(self, event: Event, parent: str | None) -> Event:
        links = tuple(
            replace(link, target=self._event_ids[link.target])
            for link in event.links
            if link.target in self._event_ids
        )
        roles = tuple(
            role if role.kind != "event" else replace(role, target=self._event_ids[role.target])
            for role in event.roles
            if role.kind != "event" or role.target in self._event_ids
        )
        self._untied += len(event.links) - len(links) + len(event.roles) - len(roles)
        self._orphans += event.parent is not None and parent is None
        length = len(event.text)
        references = tuple(r for r in event.references if r.start < r.end <= length)
        predicates = tuple(p for p in event.predicates if p.start < p.end <= length)
        marks = len(event.references) + len(event.predicates)
        self._beyond += marks - len(references) - len(predicates)
        return replace(
            event, parent=parent, links=links, roles=roles, references=references, predicates=predicates
        )


def _cut_rounds(parents: dict[str, str | None]) -> None:
    """Let no event be a part of itself."""
    done: set[str] = set()
    for start in parents:
        path: set[str] = set()
        here: str | None = start
        while here is not None and here not in done and here not in path:
            path.add(here)
            here = parents[here]
        if here in path:
            parents[here] = None
        done |= path


def _ids(keys: Sequence[str], prefix: str, taken: set[str], names: Container[str] = ()) -> dict[str, str]:
    """An id for each key: the key itself where that can be one, is free and not among ``names``."""
    found: dict[str, str] = {}
    for key in keys:
        if key not in found and key not in names and _ID.fullmatch(key) and key not in taken:
            found[key] = key
            taken.add(key)
    numbers = count(1)
    for key in keys:
        if key not in found:
            found[key] = next(made for n in numbers if (made := f"{prefix}{n}") not in taken)
            taken.add(found[key])
    return found


def _tell_apart(found: Found) -> None:
    """Give those that share a key with an earlier one another."""
    keys = {event.key for event in found.events} | {thing.record.id for thing in found.objects}
    fresh = (key for n in count(2) if (key := f"#{n}") not in keys)
    seen: set[str] = set()
    for event in found.events:
        event.key = next(fresh) if event.key in seen else event.key
        seen.add(event.key)
    seen.clear()
    for thing in found.objects:
        name = thing.record.id
        thing.record = replace(thing.record, id=next(fresh) if name in seen else name)
        seen.add(thing.record.id)


def _last_number(prefix: str, ids: Iterable[str]) -> int:
    """The highest number of ids such as ``a12``."""
    numbers = [int(name[1:]) for name in ids if re.fullmatch(rf"{prefix}\d{{1,9}}", name)]
    return max(numbers, default=0)
