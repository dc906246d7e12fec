"""EPIC-KITCHENS-100's CSV: a row for each action, with its narration, verb and nouns.

The verb is the event's type, the narration its text, and the nouns are what takes part.  Times are told as
``HH:MM:SS.mmm``, and as images counted from 1, the last included; the time counts where both are told.
``verb_class`` and ``noun_class`` number the types and objects of the session, those of the coding scheme first: they
are not the classes of EPIC-KITCHENS.  There is no place for tiers, sub-events, names of roles, shapes and relations;
an event of several stretches becomes a row for each.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from ecat.errors import FormatError
from ecat.formats.format import Format
from ecat.formats.interchange.documents import head_of
from ecat.formats.interchange.facts import PROPERTY, ROLE, joined
from ecat.formats.interchange.found import Found, FoundEvent, Frames, Times
from ecat.formats.interchange.plain_csv import frame_number, header_of, rate_of, read_table, table, too_long
from ecat.formats.interchange.reading import Reading
from ecat.formats.interchange.source import LayerOptions, Source, counted, source_of
from ecat.formats.interchange.times import (
    HALF_MS_NS,
    from_counted,
    from_timestamp,
    to_counted,
    to_timestamp,
)
from ecat.formats.options import option
from ecat.model import Event
from ecat.model.document import owner_of
from ecat.progress import Progress
from ecat.store import Session, write_new_file

NAME = "epic-kitchens"
CARRIES = frozenset({"event", "type", "text"})
PARTLY = frozenset({"role"})
COLUMNS = (
    *(
        "narration_id",
        "participant_id",
        "video_id",
        "narration_timestamp",
        "start_timestamp",
        "stop_timestamp",
    ),
    *("start_frame", "stop_frame", "narration", "verb", "verb_class", "noun", "noun_class"),
    *("all_nouns", "all_noun_classes"),
)
_NOUN = f"{ROLE}noun"
_ID = re.compile(r"[A-Za-z][\w.-]*", re.ASCII)
_QUOTED = re.compile(r"'((?:[^'\\]|\\.)*)'|\"((?:[^\"\\]|\\.)*)\"", re.DOTALL)


@dataclass(frozen=True, slots=True, kw_only=True)
class EpicOptions(LayerOptions):
    """What the writer can be told, too."""

    participant: str = option("", "participant_id; nothing: what fills the role Agent of an event")


# ---------------------------------------------------------------------------------------------- writing


def part(
    session: Session, label: str, dest: Path, options: EpicOptions, progress: Progress
) -> tuple[str, ...]:
    """Write the events of one session."""
    del progress
    source = source_of(session, label, options)
    types = [kind.name for kind in source.scheme.event_types] if source.scheme is not None else []
    types += sorted({event.type for event in source.events} - {*types, ""})
    write_new_file(dest, table(COLUMNS, _rows(source, types, options.participant)))
    untimed = len(source.layer.events) - len(source.events)
    names = sum(len(event.roles) for event in source.events)
    return source.findings(
        CARRIES | PARTLY,
        "EPIC-KITCHENS' CSV",
        f"the names of {counted(names, 'role')}: their objects are nouns" if names else "",
        f"{counted(untimed, 'event')} without a time left out" if untimed else "",
        too_long(event.text for event in source.events),
        source.made_up(),
    )


def _rows(source: Source, types: Sequence[str], participant: str) -> Iterator[Mapping[str, object]]:
    verbs = {name: number for number, name in enumerate(types)}
    nouns = {thing.id: number for number, thing in enumerate(source.layer.objects)}
    for event in source.events:
        agents, things = _takes_part(event)
        mine = [thing for thing in things if thing in nouns]
        names = [source.labels[thing] for thing in mine]
        for number, segment in enumerate(event.segments, 1):
            start, end = source.times.edges_ns(segment)
            first, last = to_counted(segment.start_frame, segment.end_frame)
            suffix = f"_{number}" if number > 1 else ""
            yield {
                "narration_id": f"{source.name}_{event.id}{suffix}",
                "participant_id": participant or "".join(source.labels.get(a, a) for a in agents[:1]),
                "video_id": source.name,
                "narration_timestamp": to_timestamp(start),
                "start_timestamp": to_timestamp(start),
                "stop_timestamp": to_timestamp(end),
                "start_frame": first,
                "stop_frame": last,
                "narration": event.text,
                "verb": event.type,
                "verb_class": verbs.get(event.type, ""),
                "noun": names[0] if names else "",
                "noun_class": nouns[mine[0]] if mine else "",
                "all_nouns": repr(names),
                "all_noun_classes": repr([nouns[thing] for thing in mine]),
            }


def _takes_part(event: Event) -> tuple[list[str], list[str]]:
    """Who acts, and the objects that take part otherwise."""
    roles = [role for role in event.roles if role.kind != "event"]
    agents = [owner_of(role.target, role.kind) for role in roles if role.name == "Agent"]
    others = [owner_of(role.target, role.kind) for role in roles if role.name != "Agent"]
    return agents, list(dict.fromkeys(others))


# ---------------------------------------------------------------------------------------------- reading


def sniff(path: Path) -> bool:
    """Whether the first line names EPIC-KITCHENS' columns."""
    return header_of(head_of(path, (".csv",))) >= {"start_timestamp", "stop_timestamp", "narration_id"}


def parse(source: Path) -> Sequence[Found]:
    """Read a table of actions: what it says about each video.

    Raises
    ------
    FormatError : not such a table, or a cell that is no time.
    """
    what = f"cannot import {source.name}"
    videos: dict[str, Found] = {}
    for line, row in read_table(source, what):
        video = row.get("video_id", "").strip() or source.stem
        names = (f"{video}.MP4", f"{video}.mp4")
        found = videos.setdefault(video, Found(name=PurePosixPath(video).name, media=names))
        found.events.append(_event(row, video, line, what))
    for found in videos.values():
        found.rate_hz = rate_of(found.events)
    return list(videos.values()) or [Found(name=source.stem)]


def _event(row: Mapping[str, str], video: str, line: int, what: str) -> FoundEvent:
    told = row.get("narration_id", "")
    short = told.removeprefix(f"{video}_")
    event = FoundEvent(
        key=(short if _ID.fullmatch(short) else told) or f"line {line}", type=row.get("verb", "")
    )
    try:
        stretch = _stretch(row)
    except ValueError as error:
        raise FormatError(what, where=f"line {line}: {error}") from None
    if stretch is not None:
        event.stretches.append(stretch)
    nouns = [a or b for a, b in _QUOTED.findall(row.get("all_nouns", ""))] or [row.get("noun", "")]
    plain = [re.sub(r"\\(.)", r"\1", noun, flags=re.DOTALL) for noun in nouns if noun.strip()]
    said = {
        "text": row.get("narration", ""),
        _NOUN: joined(noun.replace("/", " ") for noun in plain),
        f"{PROPERTY}participant_id": row.get("participant_id", ""),
    }
    event.said = {name: text for name, text in said.items() if text}
    return event


def _stretch(row: Mapping[str, str]) -> Times | Frames | None:
    """When an action happens.

    Raises
    ------
    ValueError : a cell is no time or no image.
    """
    frames = [frame_number(row[n]) for n in ("start_frame", "stop_frame") if row.get(n, "").strip()]
    images = None
    if len(frames) == 2:
        start, end = from_counted(*frames)
        images = Frames(start=start, end=end)
    times = [from_timestamp(row[n]) for n in ("start_timestamp", "stop_timestamp") if row.get(n, "").strip()]
    if len(times) == 2:
        return Times(start_ns=times[0], end_ns=times[1], within_ns=HALF_MS_NS, frames=images)
    return images


_READING = Reading(NAME, parse)
FORMAT = Format(
    name=NAME,
    description="EPIC-KITCHENS' CSV of actions: narration, verb, nouns",
    sniff=sniff,
    read=_READING.read,
    read_layer=_READING.read_layer,
    part=part,
    suffix=".csv",
    options=EpicOptions,
)
