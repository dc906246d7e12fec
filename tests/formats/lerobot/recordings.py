"""Small recordings whose numbers and images say which frame they are of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.model import AnnotatedObject, Clock, Event, Layer, Manifest, Property, Role, Segment, Stream
from ecat.store import Draft, Session, TableData, create_session
from ecat.store.media import ColorWriter, DepthWriter
from ecat.tables import TABLES

NS = 1_000_000_000
SIZE = (64, 48)
DEPTH_SIZE = (40, 30)


@dataclass(frozen=True, kw_only=True)
class Action:
    """An event over frames ``[start, end)``; ``parts`` are sub-events (type, start, end)."""

    start: int
    end: int
    text: str = "Slide red past blue"
    theme: str = "o1"
    parts: tuple[tuple[str, int, int], ...] = ()


@dataclass(frozen=True, kw_only=True)
class Recording:
    """What to make; by default two seconds of two boxes and one event of one second that begins with a key frame."""

    name: str = "one"
    n_frames: int = 60
    rate_hz: float = 30.0
    boxes: tuple[str, ...] = ("red", "blue")
    actions: tuple[Action, ...] = (Action(start=15, end=45, parts=(("hold", 20, 30), ("move", 22, 26))),)
    views: tuple[str, ...] = ("color",)
    size: tuple[int, int] = SIZE
    joints: bool = False
    performer: str = ""
    unknown: tuple[int, ...] = ()
    """Frames at which no box was seen."""
    late_s: float = 0.0
    """How much later than colour images those of depth are taken."""
    tables: tuple[str, ...] = ("poses",)
    clock: bool = True
    status: str = "confirmed"

    @property
    def t_ns(self) -> NDArray[np.int64]:
        """When each frame was taken (n,)."""
        return np.rint(np.arange(self.n_frames) * (NS / self.rate_hz)).astype(np.int64) // 1000 * 1000


def make(folder: Path, recording: Recording) -> Session:
    """The recording as a session ``folder/<name>``."""
    manifest = Manifest(
        name=recording.name,
        created="2026",
        n_frames=recording.n_frames,
        clock=Clock(rule="recorded" if recording.clock else "unknown"),
        streams=tuple(_stream(recording, view) for view in recording.views),
    )
    tables = {name: TableData(data=_poses(recording)) for name in recording.tables}
    if recording.clock and recording.views:
        tables["frames"] = TableData(data=_frames(recording))
    if recording.clock and not recording.views:
        manifest = Manifest(
            name=recording.name,
            created="2026",
            n_frames=recording.n_frames,
            clock=Clock(rule="uniform", duration_ns=int(recording.t_ns[-1])),
        )
    if recording.joints:
        tables |= {"joints": TableData(data=_joints(recording)), "table_plane": TableData(data=_plane())}
    draft = Draft(
        manifest=manifest,
        layers=(_layer(recording),),
        tables=tables,
        media={view: lambda path, view=view: film(path, recording, view) for view in recording.views},
    )
    return create_session(folder / recording.name, draft)


def grey(frame: int) -> int:
    """How bright image ``frame`` is."""
    return 16 + 3 * frame % 210


def depth_mm(frame: int) -> NDArray[np.uint16]:
    """Depth image ``frame``; its first pixel is unknown."""
    width, height = DEPTH_SIZE
    image = (500 + 10 * frame + np.arange(height * width).reshape(height, width)).astype(np.uint16)
    image[0, 0] = 0
    return image


def _is_depth(view: str) -> bool:
    return view.startswith(("depth", "infrared"))


def _stream(recording: Recording, view: str) -> Stream:
    kind = "depth" if view.startswith("depth") else "infrared" if view.startswith("infrared") else "color"
    return Stream(
        name=view,
        kind=kind,
        file=f"media/{view}.{'mkv' if _is_depth(view) else 'mp4'}",
        n_frames=recording.n_frames,
        depth_unit_m=0.001 if kind == "depth" else None,
    )


def film(path: Path, recording: Recording, view: str) -> None:
    """Write the images of a stream."""
    times = _times(recording, view).tolist()
    if _is_depth(view):
        with DepthWriter(path, *DEPTH_SIZE) as depth:
            for i, t in enumerate(times):
                depth.write(depth_mm(i), t)
        return
    width, height = recording.size
    with ColorWriter(path, width, height) as color:
        for i, t in enumerate(times):
            image = np.full((height, width, 3), grey(i), np.uint8)
            image[: height // 4, : width // 4] = (255, 0, 0)  # blue first
            color.write(image, t)


def _times(recording: Recording, view: str) -> NDArray[np.int64]:
    return recording.t_ns + (round(recording.late_s * NS) if _is_depth(view) else 0)


def _frames(recording: Recording) -> pa.Table:
    rows = [
        {"t_ns": int(t), "frame": i, "stream": view}
        for view in recording.views
        for i, t in enumerate(_times(recording, view))
    ]
    rows.sort(key=lambda row: (row["t_ns"], row["stream"]))
    return pa.Table.from_pylist(rows, schema=TABLES["frames"].arrow)


def pose(frame: int, box: int) -> tuple[float, ...]:
    """Where box ``box`` is at a frame: the first one moves a millimetre a frame along x."""
    return (
        0.001 * frame if box == 0 else 0.5,
        0.1 * box,
        0.02,
        0.0,
        0.0,
        np.sin(0.01 * frame),
        np.cos(0.01 * frame),
    )


def _poses(recording: Recording) -> pa.Table:
    names = ("x", "y", "z", "qx", "qy", "qz", "qw")
    rows = [
        {
            "t_ns": int(t) if recording.clock else None,
            "frame": i,
            "object_id": f"o{box + 1}",
            **(
                dict.fromkeys(names)
                if i in recording.unknown
                else dict(zip(names, pose(i, box), strict=True))
            ),
        }
        for i, t in enumerate(recording.t_ns)
        for box in range(len(recording.boxes))
    ]
    return pa.Table.from_pylist(rows, schema=TABLES["poses"].arrow)


def _joints(recording: Recording) -> pa.Table:
    rows = [
        {
            "t_ns": int(t),
            "frame": i,
            "object_id": "rig",
            "body": 0,
            "joint": joint,
            "x": 0.01 * i,
            "y": 0.1,
            "z": 1.0,
            "u_px": 0.0,
            "v_px": 0.0,
            "state": "not_tracked" if joint == "Head" and i % 2 else "tracked",
        }
        for i, t in enumerate(recording.t_ns)
        for joint in ("HandRight", "Head")
    ]
    return pa.Table.from_pylist(rows, schema=TABLES["joints"].arrow)


def _plane() -> pa.Table:
    """The table is a metre in front of the camera; its axes are the camera's."""
    row = {
        "frame": 0,
        "nx": 0.0,
        "ny": 0.0,
        "nz": -1.0,
        "d": 1.0,
        "origin_x": 0.0,
        "origin_y": 0.0,
        "origin_z": 1.0,
    }
    row |= {
        "qx": 0.0,
        "qy": 0.0,
        "qz": 0.0,
        "qw": 1.0,
        "rms_m": 0.0,
        "max_m": 0.0,
        "n_points": 3,
        "n_inliers": 3,
    }
    return pa.Table.from_pylist([row | {"t_ns": 0, "evidence": "depth"}], schema=TABLES["table_plane"].arrow)


def _layer(recording: Recording) -> Layer:
    things = [
        AnnotatedObject(id=f"o{i + 1}", name=box, kind="marker_box") for i, box in enumerate(recording.boxes)
    ]
    said = (Property("performer", recording.performer),) if recording.performer else ()
    rig = AnnotatedObject(id="rig", name="Performer 1", kind="rig", properties=said)
    events = [
        event for i, action in enumerate(recording.actions) for event in _events(recording, f"a{i}", action)
    ]
    return Layer(objects=(*things, rig), events=tuple(events))


def _events(recording: Recording, name: str, action: Action) -> Sequence[Event]:
    hand = Role(name="Agent", target="rig/HandRight", kind="joint")
    parts = [
        Event(
            id=f"{name}p{i}",
            type=kind,
            parent=name,
            tier="sub",
            roles=(hand,),
            segments=(_span(recording, a, b),),
        )
        for i, (kind, a, b) in enumerate(action.parts)
    ]
    roles = (Role(name="Agent", target="rig"), Role(name="Theme", target=action.theme))
    whole = Event(
        id=name,
        type="slide",
        text=action.text,
        tier="event",
        roles=roles,
        segments=(_span(recording, action.start, action.end),),
        status="proposed" if recording.status == "proposed" else "confirmed",
    )
    return (whole, *parts)


def _span(recording: Recording, start: int, end: int) -> Segment:
    if not recording.clock:
        return Segment(start_frame=start, end_frame=end)
    step = round(NS / recording.rate_hz)
    last = int(recording.t_ns[-1])
    times = [int(recording.t_ns[f]) if f < recording.n_frames else last + step for f in (start, end)]
    return Segment(start_frame=start, end_frame=end, start_ns=times[0], end_ns=times[1])
