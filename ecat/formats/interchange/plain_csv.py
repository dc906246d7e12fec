"""Plain CSV: a row for each stretch of each event.

==============================  ===========================================================================
column                          meaning
==============================  ===========================================================================
``event``                       id; rows with the same are one event, a row without one is an event by itself
``segment``                     number of the stretch, from 0; empty for an event without a time
``type``, ``tier``              of the event, in each of its rows
``start_frame``, ``end_frame``  images from 0, end excluded
``start_s``, ``end_s``          seconds, exact to the nanosecond, end excluded; empty without a clock
everything else                 in the event's first row, under the names of :mod:`ecat.formats.interchange.facts`
==============================  ===========================================================================

To be read, a table needs frames or seconds; all other columns may be missing, and unknown ones become properties.
Commas, semicolons or tabs part the columns; cells hold up to 131,072 characters.  CSV has no place for shapes,
relations, and properties without a value.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path

from ecat.errors import FormatError, LimitError
from ecat.formats.ecat2018.xml_input import read_input
from ecat.formats.format import Format
from ecat.formats.interchange.documents import head_of
from ecat.formats.interchange.facts import FIELDS, told
from ecat.formats.interchange.found import Found, FoundEvent, Frames, Times
from ecat.formats.interchange.reading import Reading
from ecat.formats.interchange.source import LayerOptions, counted, source_of
from ecat.formats.interchange.times import MOST_FRAMES, SECOND_NS, from_decimal, to_decimal
from ecat.progress import Progress
from ecat.store import Session, write_new_file

NAME = "csv"
CARRIES = frozenset(
    {
        *(
            "event",
            "type",
            "text",
            "tier",
            "stretches",
            "parent",
            "status",
            "unsure",
            "author",
            "role",
            "link",
        ),
        *("reference", "predicate", "property"),
    }
)
MAX_BYTES = 128 << 20
_FRAMES = ("start_frame", "end_frame")
_SECONDS = ("start_s", "end_s")
_OWN = ("event", "segment", "type", "tier", *_FRAMES, *_SECONDS)
_SUFFIXES = (".csv", ".tsv", ".txt")


# ---------------------------------------------------------------------------------------------- writing


def part(
    session: Session, label: str, dest: Path, options: LayerOptions, progress: Progress
) -> tuple[str, ...]:
    """Write the events of one session."""
    del progress
    source = source_of(session, label, options)
    said = {event.id: told(event, source.labels) for event in source.layer.events}
    used = dict.fromkeys(chain.from_iterable(said.values()))
    columns = [*_OWN, *(name for name in FIELDS if name in used), *(n for n in used if n not in FIELDS)]

    def rows() -> Iterator[Mapping[str, object]]:
        untimed = (event for event in source.layer.events if not event.segments)
        for event in chain(source.events, untimed):
            first: Mapping[str, object] = {"event": event.id, "type": event.type, "tier": event.tier}
            about = said[event.id]
            if not event.segments:
                yield {**first, **about}
            for number, segment in enumerate(event.segments):
                times = source.times.edges_ns(segment) if source.times.known else ()
                edges = (segment.start_frame, segment.end_frame)
                yield {
                    **first,
                    "segment": number,
                    **dict(zip(_FRAMES, edges, strict=True)),
                    **dict(zip(_SECONDS, map(to_decimal, times), strict=False)),
                    **(about if number == 0 else {}),
                }

    write_new_file(dest, table(columns, rows()))
    return source.findings(
        CARRIES, "CSV", too_long(chain.from_iterable(map(dict.values, said.values()))), own=NAME
    )


def too_long(texts: Iterable[str]) -> str:
    """What to say where texts are longer than a cell that can be read again; else nothing."""
    n = sum(len(text) > csv.field_size_limit() for text in texts)
    return f"{counted(n, 'text')} too long for a cell: this table cannot be imported again" if n else ""


def table(columns: Sequence[str], rows: Iterator[Mapping[str, object]]) -> Iterator[bytes]:
    """A CSV table, row by row."""
    text = io.StringIO()
    # what ends lines is quoted in cells: that has to be both characters which readers may take for an end
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\r\n")
    for row in chain([{name: name for name in columns}], rows):
        writer.writerow(row)
        yield text.getvalue().removesuffix("\r\n").encode() + b"\n"
        text.seek(0)
        text.truncate()


# ---------------------------------------------------------------------------------------------- reading


def sniff(path: Path) -> bool:
    """Whether the first line names the columns that are needed."""
    names = header_of(head_of(path, _SUFFIXES))
    return names >= {*_FRAMES} or names >= {*_SECONDS}


def header_of(head: bytes) -> set[str]:
    """The names of the columns."""
    line = head.removeprefix(b"\xef\xbb\xbf").partition(b"\n")[0].decode("utf-8", "replace")
    return {name.strip().strip('"') for name in line.split(_delimiter(line))}


def _delimiter(header: str) -> str:
    return max(",;\t", key=header.count)


def read_table(source: Path, what: str) -> Iterator[tuple[int, dict[str, str]]]:
    """The rows of a CSV table as texts by column, each with the number of its line.

    Raises
    ------
    FormatError : not UTF-8, or a row with more cells than columns.
    LimitError : too long, or with too long a cell.
    """
    data = read_input(source, what, MAX_BYTES).removeprefix(b"\xef\xbb\xbf")
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise FormatError(what, where=f"line {line}: not UTF-8", fix="save the table as UTF-8") from None
    rows = csv.reader(io.StringIO(text, newline=""), delimiter=_delimiter(text.partition("\n")[0]))
    try:
        names = [name.strip() for name in next(rows, [])]
        for row in rows:
            if len(row) > len(names):
                where = f"line {rows.line_num}: {len(row)} cells, the first line names {len(names)} columns"
                raise FormatError(what, where=where)
            if any(row):
                yield rows.line_num, dict(zip(names, row, strict=False))
    except csv.Error as error:
        kind = LimitError if "limit" in str(error) else FormatError
        raise kind(what, where=f"line {rows.line_num}: {error}") from None


def parse(source: Path) -> Sequence[Found]:
    """Read a table of events.

    Raises
    ------
    FormatError : a cell is no number; or as of :func:`read_table`.
    """
    what = f"cannot import {source.name}"
    events: dict[str, FoundEvent] = {}
    for line, row in read_table(source, what):
        key = row.get("event", "").strip() or f"line {line}"
        event = events.setdefault(key, FoundEvent(key=key))
        event.type = event.type or row.get("type", "")
        event.tier = event.tier or row.get("tier", "")
        stretch = _stretch(row, what, line)
        if stretch is not None:
            event.stretches.append(stretch)
        event.said |= {name: text for name, text in row.items() if text and name and name not in _OWN}
    found = Found(name=source.stem, events=list(events.values()))
    found.rate_hz = rate_of(found.events)
    return (found,)


def rate_of(events: Sequence[FoundEvent]) -> float | None:
    """Images a second, where a file tells stretches both ways: by the latest of them."""
    both = (s for e in events for s in e.stretches if isinstance(s, Times) and s.frames is not None)
    last = max(both, key=lambda stretch: stretch.last_ns, default=None)
    if last is None or last.frames is None or last.last_ns <= 0 or last.frames.end <= 0:
        return None
    return last.frames.end * SECOND_NS / last.last_ns


def _stretch(row: Mapping[str, str], what: str, line: int) -> Times | Frames | None:
    try:
        seconds = [from_decimal(row[name]) for name in _SECONDS if row.get(name, "").strip()]
        frames = [frame_number(row[name]) for name in _FRAMES if row.get(name, "").strip()]
    except ValueError as error:
        raise FormatError(what, where=f"line {line}: {error}") from None
    images = Frames(start=frames[0], end=frames[1]) if len(frames) == 2 else None
    if len(seconds) == 2:
        return Times(start_ns=seconds[0], end_ns=seconds[1], within_ns=1, frames=images)
    if images is None and (seconds or frames):
        raise FormatError(what, where=f"line {line}: a start without an end, or an end without a start")
    return images


def frame_number(text: str) -> int:
    """The number of an image.

    Raises
    ------
    ValueError : it is none.
    """
    number = text.strip().removesuffix(".0")
    if not number.isascii() or not number.isdigit() or int(number[:12]) > MOST_FRAMES:
        raise ValueError(f"expected the number of an image, found {text[:40]!r}")
    return int(number)


_READING = Reading(NAME, parse)
FORMAT = Format(
    name=NAME,
    description="events as a plain CSV table, a row for each stretch",
    sniff=sniff,
    read=_READING.read,
    read_layer=_READING.read_layer,
    part=part,
    suffix=".csv",
    options=LayerOptions,
)
