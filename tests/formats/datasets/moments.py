"""Sessions whose poses, parts and images say which moment they are of."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import pyarrow as pa

from ecat.model import AnnotatedObject, Clock, Event, Layer, Manifest, Role, Segment, Stream
from ecat.store import Draft, TableData, create_session
from ecat.store.media import ColorWriter
from ecat.tables import POSES

FPS = 30


@dataclass(frozen=True)
class Span:
    """An event to make: frames, type, and parts as (type, start, end)."""

    start: int
    end: int
    type: str = "slide"
    parts: tuple[tuple[str, int, int], ...] = ()


def _event(number: int, span: Span) -> list[Event]:
    name = f"e{number}"
    parts = [
        Event(id=f"{name}{i}", type=kind, parent=name, segments=(Segment(start_frame=a, end_frame=b),))
        for i, (kind, a, b) in enumerate(span.parts)
    ]
    segments = (Segment(start_frame=span.start, end_frame=span.end),)
    roles = (Role(name="Theme", target="o1"),)
    return [
        Event(id=name, type=span.type, text=f"{span.type} {number}", segments=segments, roles=roles),
        *parts,
    ]


def _poses(boxes: tuple[str, ...], frames: int, number: int) -> pa.Table:
    """``x`` is the session's number and the frame: 2.015 is frame 15 of session 2."""
    rows = {
        "frame": np.repeat(np.arange(frames), len(boxes)),
        "object_id": np.tile([f"o{i + 1}" for i in range(len(boxes))], frames),
    }
    n = len(rows["frame"])
    known = {
        **rows,
        "t_ns": rows["frame"] * 1_000_000_000 // FPS,
        "x": number + rows["frame"] / 1000,
        **{name: np.zeros(n) for name in ("y", "z", "qx", "qy", "qz")},
        "qw": np.ones(n),
        "source": np.full(n, "observed", object),
        "support": np.full(n, "table", object),
    }
    columns = [pa.array(known[f.name]) if f.name in known else pa.nulls(n) for f in POSES.arrow]
    return pa.table([c.cast(f.type) for c, f in zip(columns, POSES.arrow, strict=True)], schema=POSES.arrow)


def _stream(name: str, frames: int) -> Stream:
    file = f"media/{name.replace('/', '~')}.mp4"
    return Stream(name=name, kind="color", file=file, present=True, n_frames=frames)


def _film(path: Path, frames: int) -> None:
    """Image i is grey of brightness 4 i."""
    with ColorWriter(path, 64, 48) as film:
        for i in range(frames):
            film.write(np.full((48, 64, 3), 4 * i, np.uint8), i * 1_000_000_000 // FPS)


class Make(Protocol):
    """Makes ``project/<name>`` with events of these spans, and with ``film`` the streams; its path."""

    def __call__(
        self,
        name: str,
        *spans: Span,
        number: int = 1,
        boxes: tuple[str, ...] = ("red", "blue"),
        frames: int = 61,
        film: bool = False,
        streams: tuple[str, ...] = ("color",),
    ) -> Path: ...


def maker(project: Path) -> Make:
    """Makes sessions in the folder ``project``."""

    def session(
        name: str,
        *spans: Span,
        number: int = 1,
        boxes: tuple[str, ...] = ("red", "blue"),
        frames: int = 61,
        film: bool = False,
        streams: tuple[str, ...] = ("color",),
    ) -> Path:
        things = tuple(
            AnnotatedObject(id=f"o{i + 1}", name=box, kind="marker_box") for i, box in enumerate(boxes)
        )
        events = tuple(event for i, span in enumerate(spans) for event in _event(i, span))
        films = tuple(_stream(stream, frames) for stream in streams) if film else ()
        manifest = Manifest(
            name=name,
            created="2026",
            n_frames=frames,
            clock=Clock(rule="uniform", duration_ns=(frames - 1) * 1_000_000_000 // FPS),
            streams=films,
        )
        draft = Draft(
            manifest=manifest,
            layers=(Layer(objects=things, events=events),),
            tables={"poses": TableData(data=_poses(boxes, frames, number))},
            media={stream.name: lambda path: _film(path, frames) for stream in films},
        )
        return create_session(project / name, draft).path

    return session
