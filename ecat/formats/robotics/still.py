"""The scene of a session at one moment, as triangles and points: what PLY and GLB write."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ecat.errors import NotFoundError, UsageError
from ecat.formats.options import option
from ecat.formats.robotics import tracks
from ecat.formats.robotics.scene import (
    Rgb,
    TableFits,
    frame_times,
    stream_camera,
    table_fits,
    table_outlines,
    things_of,
)
from ecat.formats.robotics.tracks import JOINTS
from ecat.geometry.cameras import Camera
from ecat.geometry.nearest import nearest_in_time
from ecat.geometry.transforms import Floats, Rigid, known, skew
from ecat.model import Stream
from ecat.model.skeleton import BONES
from ecat.store import Session
from ecat.store.media import StreamImages, open_images

_TABLE_COLOR: Rgb = (120, 128, 140)
_UNCOLORED: Rgb = (170, 170, 170)
_BONE_M, _JOINT_M, _UNKNOWN_BOX_M = 0.012, 0.018, 0.02
_SINK_M = 0.001
"""The table is drawn this much lower, so that what stands on it is not half inside."""
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float) / 2
_BOX = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


@dataclass(frozen=True, slots=True, kw_only=True)
class StillOptions:
    """Which moment, and what of it."""

    frame: int | None = option(
        None, "the frame; nothing: the first that shows most blocks, unless time_s is given", least=0
    )
    time_s: float | None = option(None, "the moment, seconds since the session's start", least=0)
    points: int = option(250_000, "points from depth at most; 0: none", least=0, most=50_000_000)
    skeleton: bool = option(True, "bodies with their bones")


@dataclass(frozen=True)
class Solid:
    """Triangles of one colour.

    Parameters
    ----------
    place : from the solid's own frame to the scene's. vertices : (n, 3) metres, in its own frame.
    faces : (m, 3) indices, anticlockwise seen from outside.
    """

    name: str
    color: Rgb
    vertices: Floats
    faces: NDArray[np.int64]
    place: Rigid = field(default_factory=Rigid.identity)


@dataclass(frozen=True)
class Still:
    """A moment: solids, and points (n, 3) with their colours (n, 3) uint8, metres, in ``reference``."""

    frame: int
    t_ns: int | None
    reference: str
    solids: tuple[Solid, ...]
    points: Floats
    colors: NDArray[np.uint8]
    findings: tuple[str, ...]


def still(session: Session, label: str, options: StillOptions) -> Still:
    """The scene at the moment that the options say.

    Raises
    ------
    UsageError : the session has no such moment, or two are asked for.
    NotFoundError : nothing of the session has a place in space.
    """
    frame, t_ns = _moment(session, label, options)
    fits = table_fits(session)
    findings: list[str] = []
    solids = [*_table(session, fits, frame), *_blocks(session, frame, findings)]
    place = Rigid.identity() if fits is None else fits.at(frame)
    if options.skeleton:
        solids += _bodies(session, frame, place)
    points, colors = np.zeros((0, 3)), np.zeros((0, 3), np.uint8)
    if options.points:
        points, colors = _cloud(session, frame, t_ns, options.points, findings)
    if not solids and not len(points):
        raise NotFoundError(
            f"cannot write the scene of {label}",
            where=f"{session.name}: nothing is known to be anywhere in space at frame {frame}",
            consequence="this session was not written",
            fix=f"ecat process {session.path}",
        )
    reference = "camera/depth" if fits is None else "table"
    return Still(
        frame,
        t_ns,
        reference,
        tuple(solids),
        place.apply(points),
        colors,
        (*findings, _told(session, frame, t_ns)),
    )


def _told(session: Session, frame: int, t_ns: int | None) -> str:
    at = "" if t_ns is None else f" ({t_ns / 1e9:.3f} s)"
    return f"frame {frame}{at} of {session.manifest.n_frames:,}; all other moments, events and relations stay behind"


def _moment(session: Session, label: str, options: StillOptions) -> tuple[int, int | None]:
    times, n = frame_times(session), session.manifest.n_frames
    what = f"cannot write the scene of {label}"
    if options.frame is not None and options.time_s is not None:
        raise UsageError(what, where="both frame and time_s are given", fix="give one of them")
    if options.time_s is not None:
        if times is None:
            raise UsageError(what, where=f"{session.name} has no clock", fix="give frame instead of time_s")
        if options.time_s * 1e9 > times[-1]:
            raise UsageError(
                what,
                where=f"time_s={options.time_s:g}: {session.name} ends at {times[-1] / 1e9:.3f} s",
                fix="less",
            )
        frame = int(nearest_in_time(times[:-1], np.array([round(options.time_s * 1e9)]))[0])
    elif options.frame is not None:
        frame = options.frame
        if frame >= n:
            raise UsageError(what, where=f"frame={frame}: {session.name} has {n:,} frames", fix="less")
    else:
        frame = _fullest(session)
    return frame, None if times is None else int(times[min(frame, len(times) - 1)])


def _fullest(session: Session) -> int:
    """The first frame at which most blocks are known."""
    table = tracks.best_poses(session)
    best, most = 0, 0
    if table is not None:
        for stretch in tracks.poses(session, table, tracks.box_ids(session, table)):
            there = stretch.known.sum(1)
            if there.max() > most:
                best, most = int(stretch.frame[there.argmax()]), int(there.max())
    return best


def _table(session: Session, fits: TableFits | None, frame: int) -> Iterator[Solid]:
    rings = [] if fits is None else table_outlines(session, fits)
    if not rings:
        return
    ring = next((ring for at, ring in reversed(rings) if at <= frame), rings[0][1])
    fan = np.array([[0, k, k + 1] for k in range(1, len(ring) - 1)])
    yield Solid("table", _TABLE_COLOR, ring - [0.0, 0.0, _SINK_M], fan)


def _blocks(session: Session, frame: int, findings: list[str]) -> Iterator[Solid]:
    table = tracks.best_poses(session)
    if table is None:
        findings.append("no blocks: there are no poses (ecat process computes them)")
        return
    ids, things = tracks.box_ids(session, table), things_of(session)
    rows = next(tracks.poses(session, table, ids, within=(frame, frame + 1)), None)
    for k, thing in enumerate(things[key] for key in ids):
        if rows is None or not rows.known[0, k]:
            findings.append(f"{thing.name} is not there: its pose at this frame is not known")
            continue
        if thing.size_m is None:
            findings.append(f"{thing.name} is a small cube: its size is not known")
        size = np.array(thing.size_m or (_UNKNOWN_BOX_M,) * 3)
        place = Rigid.from_quaternion(rows.quaternion[0, k], rows.centre[0, k])
        yield Solid(thing.name, thing.color, _CORNERS * size, _BOX, place)


def _bodies(session: Session, frame: int, table_from_camera: Rigid) -> Iterator[Solid]:
    slots = tracks.body_slots(session)
    rows = next(tracks.bodies(session, list(slots), within=(frame, frame + 1)), None) if slots else None
    if rows is None:
        return
    things = things_of(session)
    for b, (slot, key) in enumerate(slots.items()):
        joints = table_from_camera.apply(rows.position[0, b])
        there = known(joints)
        if there.any():
            thing = things[key or f"body {slot}"]
            parts = [_prism(joints[i], joints[j]) for i, j in _bone_ends() if there[i] and there[j]]
            parts += [(joint + _CORNERS * _JOINT_M, _BOX) for joint in joints[there]]
            starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
            faces = np.concatenate([faces + start for start, (_, faces) in zip(starts, parts, strict=False)])
            yield Solid(thing.name, thing.color, np.concatenate([vertices for vertices, _ in parts]), faces)


def _bone_ends() -> list[tuple[int, int]]:
    return [(JOINTS.index(a), JOINTS.index(b)) for a, b in BONES]


def _prism(start: Floats, end: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """A thin bar (8, 3) between two places, and its faces."""
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length if length > 0 else np.array([0.0, 0.0, 1.0])
    side = skew(along) @ np.eye(3)[np.argmin(np.abs(along))]
    side /= np.linalg.norm(side)
    turn = np.stack([side, skew(along) @ side, along], -1)
    return (_CORNERS * np.array([_BONE_M, _BONE_M, length])) @ turn.T + (start + end) / 2, _BOX


def _cloud(
    session: Session, frame: int, t_ns: int | None, most: int, findings: list[str]
) -> tuple[Floats, NDArray[np.uint8]]:
    """Points (n, 3) of the depth image nearest in time, ``camera/depth``, and their colours (n, 3)."""
    nothing = np.zeros((0, 3)), np.zeros((0, 3), np.uint8)
    for stream in session.manifest.streams:
        camera = stream_camera(session.manifest, stream)
        if stream.kind == "depth" and stream.present and camera is not None:
            with open_images(session, stream.name) as images:
                image = _image(images, frame, t_ns)
                unit_m = images.unit_m
            if image is None or image.shape != (camera.height, camera.width):
                continue
            v, u = np.nonzero(image)
            step = max(-(-len(u) // most), 1)
            v, u = v[::step], u[::step]
            rays = camera.unproject(np.stack([u, v], -1).astype(float))
            points = camera.from_reference.inverse().apply(rays * (image[v, u, None] * unit_m))
            if step > 1:
                findings.append(f"one point of every {step} was kept, {len(u):,} in all")
            return points, _colors(session, points, frame, t_ns)
    findings.append("no points: there is no depth image with a known camera")
    return nothing


def _colors(session: Session, points: Floats, frame: int, t_ns: int | None) -> NDArray[np.uint8]:
    """What the colour image shows where each point is; grey outside of it."""
    found = np.full((len(points), 3), _UNCOLORED, np.uint8)
    for stream in session.manifest.streams:
        camera = _color_camera(session, stream)
        if camera is None:
            continue
        with open_images(session, stream.name) as images:
            image = _image(images, frame, t_ns)
        if image is None or image.shape[:2] != (camera.height, camera.width):
            continue
        pixels = np.nan_to_num(camera.project(points), nan=-1.0).round()
        inside = ((pixels >= 0) & (pixels < [camera.width, camera.height])).all(1)
        u, v = pixels[inside].astype(np.int64).T
        found[inside] = image[v, u, ::-1]
        break
    return found


def _color_camera(session: Session, stream: Stream) -> Camera | None:
    there = stream.kind == "color" and stream.present
    return stream_camera(session.manifest, stream) if there else None


def _image(images: StreamImages, frame: int, t_ns: int | None) -> NDArray[np.uint16] | None:
    """The image nearest in time, without a clock that of the same frame."""
    if not len(images):
        return None
    if images.t_ns is None or t_ns is None:
        index = int(np.abs(images.frame - frame).argmin())
    else:
        index = int(nearest_in_time(images.t_ns, np.array([t_ns]))[0])
    return next(images.read([index]))
