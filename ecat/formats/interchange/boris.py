"""BORIS projects (``.boris``): an ethogram of state and point events, and observations coded with it.

The session is an observation, an event's type a behaviour, its text the comment.  A behaviour is a point event where
all its events last a single image.  Who acts (the role ``Agent``, or another: ``--option subject``) is the subject, all
other roles are sets of modifiers.  BORIS tells a state's start and stop by behaviour, subject and modifiers alone, so
that of two events that share these and overlap only one can be told; it has no place for a tree of events, for
shapes and relations, and an event of several stretches becomes several.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ecat.formats.format import Format
from ecat.formats.interchange.documents import Rate, Seconds, Text, read_json, tells, write_json
from ecat.formats.interchange.facts import ROLE, told
from ecat.formats.interchange.found import Found, FoundEvent, Times
from ecat.formats.interchange.reading import Reading
from ecat.formats.interchange.shapes import UNLABELLED
from ecat.formats.interchange.source import LayerOptions, Source, counted, source_of
from ecat.formats.interchange.times import HALF_MS_NS, MOST_SECONDS, from_seconds, to_seconds
from ecat.formats.options import option
from ecat.model import CodingScheme, Event, EventType, Tier
from ecat.progress import Progress
from ecat.store import Session, write_new_file

NAME = "boris"
CARRIES = frozenset({"event", "type", "text", "tier", "role"})
SUBJECT = "Agent"
_NO_FOCAL, _NONE = "No focal subject", "None"
_PARTING = re.compile(r"[|()~]")
_PLAYERS = tuple(str(n) for n in range(1, 9))


@dataclass(frozen=True, slots=True, kw_only=True)
class BorisOptions(LayerOptions):
    """What the writer can be told, too."""

    subject: str = option(SUBJECT, "the role that is the subject; the others are modifiers")


# ---------------------------------------------------------------------------------------------- writing


@dataclass(slots=True)
class _Behaviour:
    """A type of event: its tier, the names of its roles, what fills them, and whether it takes longer than an image."""

    tier: str
    modifiers: dict[str, dict[str, None]] = field(default_factory=dict[str, dict[str, None]])
    is_point: bool = True


def part(
    session: Session, label: str, dest: Path, options: BorisOptions, progress: Progress
) -> tuple[str, ...]:
    """Write the events of one session."""
    del progress
    source = source_of(session, label, options)
    said = {event.id: _said(source, event) for event in source.events}
    behaviours = _behaviours(source.events, said, f"{ROLE}{options.subject}")
    rows, overlapping = _rows(source, behaviours, said, f"{ROLE}{options.subject}")
    write_new_file(dest, [write_json(_project(source, behaviours, rows))])
    elsewhere = sum(event.tier != behaviours[event.type].tier for event in source.events)
    untimed = len(source.layer.events) - len(source.events)
    unsaid = sum(len(_unsayable(source, event)) for event in source.events)
    return source.findings(
        CARRIES,
        "BORIS",
        f"{counted(overlapping, 'stretch', 'stretches')} left out: BORIS cannot tell them from another of the same "
        "behaviour, subject and modifiers that they overlap"
        if overlapping
        else "",
        f"{counted(elsewhere, 'event')} on another tier than others of the type" if elsewhere else "",
        f"{counted(untimed, 'event')} without a time left out" if untimed else "",
        f"{counted(unsaid, 'role')} with a name or value that BORIS has not left out" if unsaid else "",
        source.made_up(),
    )


def _unsayable(source: Source, event: Event) -> list[str]:
    """Roles that BORIS would read as something else."""
    roles = told(event, source.labels).items()
    return [
        n for n, text in roles if n.startswith(ROLE) and (_PARTING.search(text) or text in {_NONE, _NO_FOCAL})
    ]


def _said(source: Source, event: Event) -> dict[str, str]:
    """The text and the roles of an event."""
    unsayable = _unsayable(source, event)
    said = told(event, source.labels).items()
    return {n: text for n, text in said if n == "text" or (n.startswith(ROLE) and n not in unsayable)}


def _behaviours(
    events: Iterable[Event], said: Mapping[str, Mapping[str, str]], subject: str
) -> dict[str, _Behaviour]:
    found: dict[str, _Behaviour] = {}
    for event in events:
        behaviour = found.setdefault(event.type, _Behaviour(event.tier))
        behaviour.is_point &= all(s.end_frame - s.start_frame == 1 for s in event.segments)
        for name, text in said[event.id].items():
            if name.startswith(ROLE) and name != subject:
                behaviour.modifiers.setdefault(name, {})[text] = None
    return found


def _rows(
    source: Source,
    behaviours: Mapping[str, _Behaviour],
    said: Mapping[str, Mapping[str, str]],
    subject: str,
) -> tuple[list[list[object]], int]:
    """The rows of the observation in the order of time, and how many stretches were left out."""
    found: list[tuple[float, int, list[object]]] = []
    until: dict[tuple[str, str, str], int] = {}
    left_out = 0
    stretches = [(segment, event) for event in source.events for segment in event.segments]
    for segment, event in sorted(stretches, key=lambda pair: source.times.edges_ns(pair[0])):
        behaviour, mine = behaviours[event.type], said[event.id]
        modifiers = "|".join(mine.get(name, _NONE) for name in behaviour.modifiers)
        key = (event.type, mine.get(subject, ""), modifiers)
        start, end = source.times.edges_ns(segment)
        if not behaviour.is_point:
            if start < until.get(key, 0):
                left_out += 1
                continue
            until[key] = end
        edges = [(start, segment.start_frame, mine.get("text", ""))]
        edges += [] if behaviour.is_point else [(end, segment.end_frame, "")]
        for t_ns, frame, comment in edges:
            row: list[object] = [
                to_seconds(t_ns),
                key[1],
                event.type or UNLABELLED,
                modifiers,
                comment,
                max(frame, 0),
            ]
            found.append((to_seconds(t_ns), len(found), row))
    return [row for _, _, row in sorted(found, key=lambda item: item[:2])], left_out


def _project(source: Source, behaviours: Mapping[str, _Behaviour], rows: list[list[object]]) -> object:
    media = source.media[:1]
    length = to_seconds(source.times.ns(source.end))
    scheme = source.scheme
    keys = {kind.name: (kind.key, kind.color) for kind in scheme.event_types} if scheme is not None else {}
    created = source.manifest.created[:19]
    subjects = dict.fromkeys(row[1] for row in rows if row[1])
    return {
        "time_format": "hh:mm:ss",
        "project_date": created,
        "project_name": source.name,
        "project_description": "",
        "project_format_version": "7.0",
        "subjects_conf": {
            str(n): {"key": "", "name": name, "description": ""} for n, name in enumerate(subjects)
        },
        "behaviors_conf": {
            str(n): _configured(name, behaviour, *keys.get(name, ("", "")))
            for n, (name, behaviour) in enumerate(behaviours.items())
        },
        "behavioral_categories": list(dict.fromkeys(b.tier for b in behaviours.values() if b.tier)),
        "independent_variables": {},
        "coding_map": {},
        "behaviors_coding_map": [],
        "converters": {},
        "observations": {
            source.name: {
                "file": {player: list(media) if player == "1" else [] for player in _PLAYERS}
                if media
                else [],
                "type": "MEDIA" if media else "LIVE",
                "date": (source.manifest.clock.start or created)[:19],
                "description": "",
                "time offset": 0.0,
                "events": rows,
                "observation time interval": [0, 0],
                "independent_variables": {},
                "visualize_spectrogram": False,
                "visualize_waveform": False,
                "close_behaviors_between_videos": False,
                "scan_sampling_time": 0,
                "media_info": {
                    "length": dict.fromkeys(media, length),
                    "fps": dict.fromkeys(media, source.times.rate_hz),
                    "hasVideo": dict.fromkeys(media, True),
                    "hasAudio": dict.fromkeys(media, False),
                    "offset": {"1": 0.0},
                },
            }
        },
    }


def _configured(name: str, behaviour: _Behaviour, key: str, color: str) -> dict[str, object]:
    return {
        "type": "Point event" if behaviour.is_point else "State event",
        "key": key,
        "code": name or UNLABELLED,
        "description": "",
        "color": color,
        "category": behaviour.tier,
        "modifiers": {
            str(n): {"name": role.removeprefix(ROLE), "description": "", "type": 0, "values": list(values)}
            for n, (role, values) in enumerate(behaviour.modifiers.items())
        },
        "excluded": "",
        "coding map": "",
    }


# ---------------------------------------------------------------------------------------------- reading


@dataclass
class _Modifiers:
    name: Text = ""


@dataclass
class _Code:
    code: Text = ""
    type: Text = ""
    key: Text = ""
    category: Text = ""
    modifiers: dict[str, _Modifiers] | list[object] | str = ""


@dataclass
class _MediaInfo:
    length: dict[str, Seconds] = field(default_factory=dict[str, float])
    fps: dict[str, Rate] = field(default_factory=dict[str, float])


@dataclass
class _Observation:
    events: list[list[Any]] = field(default_factory=list[list[Any]])
    file: dict[str, list[str]] | list[str] | str = ""
    media_info: _MediaInfo = field(default_factory=_MediaInfo)


@dataclass
class _Project:
    observations: dict[str, _Observation]
    behaviors_conf: dict[str, _Code] = field(default_factory=dict[str, _Code])


def sniff(path: Path) -> bool:
    """Whether it is a project of BORIS."""
    return tells(path, (".boris", ".json"), "behaviors_conf")


def parse(source: Path) -> Sequence[Found]:
    """Read a project: what it says in each observation.

    Raises
    ------
    FormatError, LimitError : it is no project of BORIS.
    """
    project = read_json(source, _Project, f"cannot import {source.name}")
    codes = {code.code: code for code in project.behaviors_conf.values()}
    scheme = _scheme(source.stem, codes.values())
    found = [_found(name, observation, codes, scheme) for name, observation in project.observations.items()]
    return found or [Found(name=source.stem)]


def _found(name: str, said: _Observation, codes: Mapping[str, _Code], scheme: CodingScheme | None) -> Found:
    players = said.file if isinstance(said.file, dict) else {}
    media = tuple(dict.fromkeys(file for files in players.values() for file in files))
    length = next((said.media_info.length[m] for m in media if m in said.media_info.length), None)
    found = Found(name=name, media=media, scheme=scheme)
    found.rate_hz = next((said.media_info.fps[m] for m in media if m in said.media_info.fps), None)
    found.duration_ns = from_seconds(length) if length and length > 0 else None
    rows = [row for row in map(_row, said.events) if row is not None]
    if len(rows) < len(said.events):
        found.findings.append(f"{counted(len(said.events) - len(rows), 'row')} without a time left out")
    starts: dict[tuple[str, str, str], FoundEvent] = {}
    for number, (t_ns, subject, code, modifiers, comment) in enumerate(
        sorted(rows, key=lambda row: row[0]), 1
    ):
        key = (subject, code, modifiers)
        known = codes.get(code, _Code(code=code))
        if (begun := starts.pop(key, None)) is not None:
            first = begun.stretches[0]
            assert isinstance(first, Times)
            begun.stretches = [Times(start_ns=first.start_ns, end_ns=t_ns, within_ns=HALF_MS_NS)]
            continue
        event = FoundEvent(key=f"row {number}", type="" if code == UNLABELLED else code, tier=known.category)
        event.stretches = [Times(start_ns=t_ns, end_ns=None, within_ns=HALF_MS_NS)]
        event.said = {"text": comment} if comment else {}
        event.said |= dict(_roles(subject, modifiers, known))
        found.events.append(event)
        if known.type.lower().startswith("state"):
            starts[key] = event
    open_ends = len(starts)
    for event in starts.values():
        first = event.stretches[0]
        if isinstance(first, Times) and found.duration_ns is not None and found.duration_ns > first.start_ns:
            event.stretches = [Times(start_ns=first.start_ns, end_ns=found.duration_ns, within_ns=HALF_MS_NS)]
    if open_ends:
        found.findings.append(
            f"{counted(open_ends, 'state')} without a stop: to the end of the recording, if that is told"
        )
    return found


def _row(row: Sequence[Any]) -> tuple[int, str, str, str, str] | None:
    """Time, subject, behaviour, modifiers and comment; ``None`` where there is no time."""
    if len(row) < 3 or isinstance(row[0], bool) or not isinstance(row[0], int | float):
        return None
    if not math.isfinite(row[0]) or abs(row[0]) > MOST_SECONDS:
        return None
    subject, code, modifiers, comment = ("" if v is None else str(v) for v in [*row[1:5], "", ""][:4])
    return from_seconds(row[0]), "" if subject == _NO_FOCAL else subject, code, modifiers, comment


def _roles(subject: str, modifiers: str, code: _Code) -> Iterator[tuple[str, str]]:
    if subject:
        yield f"{ROLE}{SUBJECT}", subject
    sets = [s.name for s in code.modifiers.values()] if isinstance(code.modifiers, dict) else []
    for number, value in enumerate(modifiers.split("|") if modifiers else ()):
        name = sets[number] if number < len(sets) and sets[number] else f"modifier {number + 1}"
        if value and value != _NONE:
            yield f"{ROLE}{name}", value


def _scheme(name: str, codes: Iterable[_Code]) -> CodingScheme | None:
    codes = [code for code in codes if code.code and code.code != UNLABELLED]
    if not codes:
        return None
    tiers = dict.fromkeys(code.category for code in codes if code.category)
    return CodingScheme(
        name=name,
        tiers=tuple(Tier(name=tier) for tier in tiers),
        event_types=tuple(EventType(name=code.code, tier=code.category, key=code.key[:1]) for code in codes),
    )


_READING = Reading(NAME, parse)
FORMAT = Format(
    name=NAME,
    description="BORIS projects: state and point events, subjects, modifiers",
    sniff=sniff,
    read=_READING.read,
    read_layer=_READING.read_layer,
    part=part,
    suffix=".boris",
    options=BorisOptions,
)
