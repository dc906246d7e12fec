"""Which episodes a session has, and how each is read: what :mod:`ecat.formats.episodes` promises."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ecat.errors import InputError, NotFoundError, UsageError
from ecat.formats.episode_state import PARTS, Sampling, States, box_action, furthest, moved_box
from ecat.formats.episodes import (
    Episode,
    EpisodeOptions,
    Subtask,
    chosen_layer,
    image_streams,
    performer_of,
)
from ecat.geometry.nearest import nearest_in_time
from ecat.model import Event, Stream
from ecat.model.annotation import MACHINE
from ecat.stages.resample import NS, regular_times
from ecat.store import Session
from ecat.store.media import annotated_stream
from ecat.store.times import image_times_s

_MOST_TEXTS = 5


@dataclass(frozen=True)
class _Span:
    event: Event | None
    start_ns: int
    end_ns: int


class Plan:
    """Which episodes a session has, before any of them is read; ``findings`` says what is not among them, and why.

    Raises
    ------
    InputError, UsageError : as of :func:`episodes_of`.
    """

    def __init__(self, session: Session, label: str, options: EpisodeOptions) -> None:
        self._session, self._label, self._options = session, label, options
        self.layer = chosen_layer(session, options.layer)
        self.frame_ns = frame_times(session, options)
        self.streams = image_streams(session)
        self._within_ns = round(options.gap_s * NS)
        self._states = States(
            session,
            self.layer,
            self.frame_ns,
            parts=_words(options.state, PARTS, "state"),
            joints=_words(options.joints),
            smooth=options.poses == "smooth",
            sampling=Sampling(linear=options.clock == "linear", within_ns=self._within_ns),
        )
        self._stream_ns = {name: self._times_of(stream) for name, stream in self.streams.items()}
        self._children = _children(self.layer.events)
        self.findings: tuple[str, ...] = ()
        self._spans = self._chosen()

    def __len__(self) -> int:
        return len(self._spans)

    @property
    def spans_ns(self) -> tuple[tuple[int, int], ...]:
        """Start and end of each episode."""
        return tuple((span.start_ns, span.end_ns) for span in self._spans)

    def shows(self, stream: str) -> bool:
        """Whether every episode has an image of this stream."""
        known = self._stream_ns[stream]
        return all((self._shown(known, self._moments(*span)) >= 0).any() for span in self.spans_ns)

    def episodes(self) -> Iterator[Episode]:
        """Read one episode after the other."""
        for index, span in enumerate(self._spans):
            yield self._episode(index, span)

    # -------------------------------------------------------------------------------------- which

    def _chosen(self) -> list[_Span]:
        step = int(np.median(np.diff(self.frame_ns))) if len(self.frame_ns) > 1 else NS // self._options.fps
        if self._options.episodes == "session":
            return [_Span(None, int(self.frame_ns[0]), int(self.frame_ns[-1]) + step)]
        spans: list[_Span] = []
        odd = [f"event {event.id}: it has no time" for event in self._wanted() if not event.segments]
        wanted, proposed = self._events()
        for event in wanted:
            start, end = self._interval(event, step)
            if len(self._moments(start, end)):
                spans.append(_Span(event, start, end))
            else:
                odd.append(f"event {event.id}: there is no moment in it")
        if proposed:
            odd.append(f"{proposed} proposed events: nobody has confirmed them")
        self.findings = tuple(odd)
        if not spans:
            raise InputError(
                f"cannot make episodes of {self._label}",
                where=f"{self._label}: layer {self.layer.name} has no event to make one of"
                + "".join(f"; {line}" for line in odd),
                fix="annotate it, name another layer, tier or type, or take whole sessions (episodes=session)",
            )
        return sorted(
            spans, key=lambda span: (span.start_ns, span.end_ns, span.event.id if span.event else "")
        )

    def _wanted(self) -> list[Event]:
        """The events that the options choose, also those without a time."""
        tier, kind = self._options.tier, self._options.type
        known = {event.id for event in self.layer.events}
        return [
            event
            for event in self.layer.events
            if (not tier or event.tier == tier)
            and (not kind or event.type == kind)
            and (tier or kind or event.parent not in known)
        ]

    def _events(self) -> tuple[list[Event], int]:
        """The events that become episodes, and how many others are only proposed."""
        timed = [event for event in self._wanted() if event.segments]
        counts = [e for e in timed if e.status == "confirmed" or self.layer.name == MACHINE]
        return counts, len(timed) - len(counts)

    def _interval(self, event: Event, step: int) -> tuple[int, int]:
        starts = [
            s.start_ns if s.start_ns is not None else self._at(s.start_frame, step) for s in event.segments
        ]
        ends = [s.end_ns if s.end_ns is not None else self._at(s.end_frame, step) for s in event.segments]
        if self._options.clock == "images":  # also of a recording whose times are not known
            starts = [self._at(s.start_frame, step) for s in event.segments]
            ends = [self._at(s.end_frame, step) for s in event.segments]
        last = int(self.frame_ns[-1]) + step
        return max(min(starts), int(self.frame_ns[0])), min(max(ends), last)

    def _at(self, frame: int, step: int) -> int:
        n = len(self.frame_ns)
        beyond = max(frame - (n - 1), 0)
        return int(self.frame_ns[min(max(frame, 0), n - 1)]) + beyond * step

    def _moments(self, start: int, end: int) -> NDArray[np.int64]:
        if self._options.clock == "images":
            first, last = np.searchsorted(self.frame_ns, (start, end))
            return self.frame_ns[first:last]
        return regular_times(start, end, self._options.fps)

    # --------------------------------------------------------------------------------------- what

    def _episode(self, index: int, span: _Span) -> Episode:
        times = self._moments(span.start_ns, span.end_ns)
        following = np.append(times, self._after(times))
        state, state_names = self._states.state(following)
        action, action_names, moved = self._action(span, following, (state, state_names))
        images = {name: self._shown(known, times) for name, known in self._stream_ns.items()}
        event = span.event
        return Episode(
            session=self._label,
            index=index,
            event=event.id if event else "",
            task=_said(event) if event else self._session_task(),
            type=event.type if event else "",
            performer=performer_of(self._session, self.layer, event),
            start_ns=span.start_ns,
            end_ns=span.end_ns,
            times_ns=times,
            state=state[:-1].astype(np.float32),
            state_names=state_names,
            action=action.astype(np.float32),
            action_names=action_names,
            moved=moved,
            images=images,
            subtasks=tuple(self._subtasks(span)),
            off_ns={name: _off(self._stream_ns[name], times, shown) for name, shown in images.items()},
        )

    def _shown(self, known: NDArray[np.int64], times: NDArray[np.int64]) -> NDArray[np.int64]:
        return nearest_in_time(known, times, within=max(self._within_ns, 1))

    def _session_task(self) -> str:
        """What its events say, if that is few enough to be one task; else the session's name."""
        texts = list(dict.fromkeys(_said(event) for event in self._events()[0]))
        return "; ".join(texts) if 0 < len(texts) <= _MOST_TEXTS else self._session.name

    def _after(self, times: NDArray[np.int64]) -> int:
        """The moment after the last one."""
        if self._options.clock == "images":
            later = np.searchsorted(self.frame_ns, times[-1], side="right")
            if later < len(self.frame_ns):
                return int(self.frame_ns[later])
        return int(times[-1]) + NS // self._options.fps

    def _action(
        self, span: _Span, times: NDArray[np.int64], state: tuple[NDArray[np.float64], tuple[str, ...]]
    ) -> tuple[NDArray[np.float64], tuple[str, ...], str]:
        kind = self._options.action
        poses, _ = self._states.box_state(times)
        moved = self._moved(span, times[:-1], poses)
        boxes = list(self._states.boxes.values())
        alone = set(moved.tolist())
        name = boxes[moved[0]] if len(alone) == 1 and moved[0] >= 0 else ""
        if kind == "none" or (not boxes and kind != "next_state"):
            return np.empty((len(moved), 0)), (), name
        if kind == "next_state":
            return state[0][1:], state[1], name
        return *box_action(kind, poses, moved), name

    def _moved(self, span: _Span, times: NDArray[np.int64], poses: NDArray[np.float64]) -> NDArray[np.int64]:
        """Which box is moved at each moment; before an event it is already the one that is going to be."""
        ids, role = list(self._states.boxes), self._options.moved
        default = furthest(poses)
        if span.event is not None:
            said = moved_box(span.event, ids, role)
            return np.full(len(times), said if said >= 0 else default)
        found = np.full(len(times), default)
        top = [(self._interval(event, 1), moved_box(event, ids, role)) for event in self._events()[0]]
        for (_, end), box in sorted(top, key=lambda item: -item[0][1]):
            if box >= 0:
                found[times < end] = box
        return found

    def _subtasks(self, span: _Span) -> Iterator[Subtask]:
        if span.event is not None:
            yield from self._below(span.event.id, 1)
            return
        known = {event.id for event in self.layer.events}
        for event in self.layer.events:
            if event.parent not in known:
                yield from self._parts(event, 0)
                yield from self._below(event.id, 1)

    def _below(self, parent: str, level: int) -> Iterator[Subtask]:
        for event in self._children.get(parent, ()):
            yield from self._parts(event, level)
            yield from self._below(event.id, level + 1)

    def _parts(self, event: Event, level: int) -> Iterator[Subtask]:
        if event.status != "confirmed" and self.layer.name != MACHINE:
            return
        for segment in event.segments:
            start, end = self._interval_of(segment.start_frame, segment.end_frame)
            if (
                self._options.clock != "images"
                and segment.start_ns is not None
                and segment.end_ns is not None
            ):
                start, end = segment.start_ns, segment.end_ns
            yield Subtask(start, end, _said(event), event.type, event.tier, level)

    def _interval_of(self, start_frame: int, end_frame: int) -> tuple[int, int]:
        step = int(np.median(np.diff(self.frame_ns))) if len(self.frame_ns) > 1 else NS // self._options.fps
        return self._at(start_frame, step), self._at(end_frame, step)

    def _times_of(self, stream: Stream) -> NDArray[np.int64]:
        """When each image of a stream was taken; spread evenly over the session where that is not known."""
        video = annotated_stream(self._session.manifest)
        if video is not None and video.name == stream.name:
            return self.frame_ns
        known = _stream_times(self._session, stream)
        if known is not None:
            return known
        n = stream.n_frames or 0
        return self.frame_ns[np.arange(n) * len(self.frame_ns) // max(n, 1)]


def _said(event: Event) -> str:
    return event.text.strip() or event.type or event.id


def _off(known: NDArray[np.int64], times: NDArray[np.int64], shown: NDArray[np.int64]) -> int:
    there = shown >= 0
    return int(np.abs(known[shown[there]] - times[there]).max(initial=0)) if len(known) else 0


def _children(events: Sequence[Event]) -> dict[str, list[Event]]:
    found: dict[str, list[Event]] = {}
    for event in events:
        if event.parent is not None:
            found.setdefault(event.parent, []).append(event)
    return found


def _words(said: str, known: Sequence[str] = (), name: str = "") -> tuple[str, ...]:
    words = tuple(word.strip() for word in said.split(",") if word.strip())
    if known and (unknown := [word for word in words if word not in known]):
        raise UsageError(
            f"cannot make a {name} of {', '.join(unknown)}",
            where=f"it may consist of: {', '.join(known)}",
            fix=f"{name}={','.join(known)}",
        )
    return words


def frame_times(session: Session, options: EpisodeOptions) -> NDArray[np.int64]:
    """When each frame of the session was taken (n,); evenly at ``fps`` if the clock is ``images`` and none is known.

    Raises
    ------
    InputError : the recording has no clock, or no frames.
    """
    video = annotated_stream(session.manifest)
    n, clock = session.manifest.n_frames, session.manifest.clock
    known = _stream_times(session, video) if video is not None else None
    if known is None and video is None and None not in (times := clock.times_ns(range(n), n)):
        known = np.array(times, np.int64)
    if known is not None and len(known):
        return known
    if options.clock == "images" and n:
        return regular_times(0, -(-n * NS // options.fps), options.fps)[:n]
    raise InputError(
        f"cannot make episodes of {session.name}",
        where=f"{session.name}: the recording has no {'clock' if n else 'frames'}",
        fix="clock=images takes its images as evenly spaced" if n else "import a recording that has images",
    )


def _stream_times(session: Session, stream: Stream) -> NDArray[np.int64] | None:
    """When each image of a stream was taken (n,); None where that is not known."""
    try:
        return np.rint(image_times_s(session, stream) * NS).astype(np.int64)
    except NotFoundError:
        return None
