"""A session as a Rerun recording: everything sent column by column, with its blueprint."""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from ecat.geometry.transforms import Floats
from ecat.model import Manifest
from ecat.progress import Progress, silent
from ecat.store import Session, staged_file
from ecat.tables import PUBLISHED
from ecat.view.about import about
from ecat.view.lanes import event_log, events, relations, supports
from ecat.view.layout import Overview, layout
from ecat.view.marks import hulls, markers_2d, markers_3d, shapes, tracks
from ecat.view.media import media
from ecat.view.plots import inertial, quality, speeds
from ecat.view.scene import Scene, integers, numbers, scene, static
from ecat.view.sink import written_to
from ecat.view.skeleton import skeletons
from ecat.view.space import (
    UPRIGHT,
    border,
    boxes,
    camera_path,
    cameras,
    color_camera,
    depth_outlines,
    first_table_from_camera,
    table_outline,
    table_surface,
    travels,
    world,
)
from ecat.view.streams import shown_streams

if TYPE_CHECKING:
    from rerun import RecordingStream
    from rerun.blueprint import Blueprint
    from rerun.chunk import Chunk

APPLICATION = "ecat"
_TABLES = (
    "objects",
    "keyframes",
    "events",
    "event_segments",
    "event_links",
    "relations",
    "markers_2d",
    "markers_3d",
    "tracks_2d",
    "hulls",
    "table_plane",
    "table_outline",
    "camera_poses",
    "imu",
    "joints",
    "poses",
    "poses_smooth",
)


def recording(
    session: Session, *, application: str = APPLICATION, recording_id: str | None = None
) -> RecordingStream:
    """An empty recording that carries the session's name.

    Its id follows from the manifest: the same state of a session is the same recording, sessions that merely
    share a name are not.
    """
    import rerun as rr

    made = rr.RecordingStream(
        application, recording_id=recording_id or str(uuid.uuid5(uuid.NAMESPACE_OID, repr(session.manifest)))
    )
    made.send_recording_name(session.name)
    return made


def log_session(session: Session, stream: RecordingStream, *, progress: Progress = silent) -> tuple[str, ...]:
    """Send a session to ``stream``: its blueprint first, then every table that is there, then the images.

    Returns
    -------
    A line for each stream of which not all images can be shown.
    """
    import rerun as rr

    damage: list[str] = []
    strict = rr.strict_mode()
    # Rerun would turn a wrong column into a warning and an empty view
    rr.set_strict_mode(True)
    try:
        shown, tables = scene(session), _tables(session)
        chunks = list(session_chunks(session.manifest, tables, shown))
        views = _blueprint(session.manifest, tables, shown, chunks)
        stream.send_blueprint(views, make_active=True, make_default=True)
        stream.send_chunks(chunks)
        for chunk in media(session, shown, progress, damage):
            stream.send_chunks(chunk)
    finally:
        rr.set_strict_mode(strict)
    return tuple(damage)


def blueprint(session: Session) -> Blueprint:
    """The views for what the session holds."""
    shown, tables = scene(session), _tables(session)
    return _blueprint(session.manifest, tables, shown, list(session_chunks(session.manifest, tables, shown)))


def _tables(session: Session) -> dict[str, pa.Table]:
    """The tables to show: the published ones, empty if need be, and of the others those with rows."""
    found = {name: session.table(name).to_arrow() for name in _TABLES if session.has_table(name)}
    empty = {schema.name: schema.arrow.empty_table() for schema in PUBLISHED}
    return empty | {name: table for name, table in found.items() if table.num_rows}


def save_rrd(session: Session, file: Path, *, progress: Progress = silent) -> tuple[str, ...]:
    """Write the session as a ``.rrd`` file, complete or not at all.

    Returns
    -------
    As of :func:`log_session`.

    Raises
    ------
    StoreError : the folder is read-only or full.
    """
    stream = recording(session)
    with staged_file(file, replaces=b"RRF") as staging, staging.open("wb") as out, written_to(out, stream):
        return log_session(session, stream, progress=progress)


def session_chunks(manifest: Manifest, tables: Mapping[str, pa.Table], shown: Scene) -> Iterator[Chunk]:
    """Everything of a session but its images, from the published tables and those others that have rows."""
    import rerun as rr

    yield from _places(manifest, tables, shown)
    size = _image_size(manifest)
    if size is not None:
        yield border(*size)
    for dimensions in (2, 3):
        yield from shapes(tables["keyframes"], tables["objects"], shown, dimensions=dimensions)
    senders = {
        "markers_2d": markers_2d,
        "markers_3d": markers_3d,
        "tracks_2d": tracks,
        "hulls": hulls,
        "joints": skeletons,
        "imu": inertial,
    }
    for name, send in senders.items():
        if name in tables:
            yield from send(tables[name], shown)
    best = tables.get("poses_smooth", tables.get("poses"))
    if best is not None:
        yield from boxes(best, shown)
        yield from supports(best, shown)
        yield from speeds(best, shown)
    if "poses" in tables:
        yield from quality(tables["poses"], shown)
    yield from events(tables, shown)
    yield from event_log(tables["events"], shown)
    yield from relations(tables["relations"], shown)
    yield static("/about", rr.TextDocument(about(manifest, tables, shown), media_type=rr.MediaType.MARKDOWN))


def _places(manifest: Manifest, tables: Mapping[str, pa.Table], shown: Scene) -> Iterator[Chunk]:
    """The cameras and the table."""
    plane, poses = tables.get("table_plane"), tables.get("camera_poses")
    travelled = travels(poses, manifest, shown.timebase) if poses is not None else None
    yield from world(plane, shown.timebase, travelled)
    yield from cameras(manifest)
    if travelled is not None:
        yield camera_path(UPRIGHT if plane is None else first_table_from_camera(plane), travelled[1])
    if plane is not None:
        yield from table_surface(_table_edge(tables))
    if "table_outline" in tables:
        yield from depth_outlines(tables["table_outline"], shown.timebase)


def _blueprint(
    manifest: Manifest, tables: Mapping[str, pa.Table], shown: Scene, chunks: list[Chunk]
) -> Blueprint:
    paths = sorted({chunk.entity_path for chunk in chunks if chunk.num_rows})
    overview = None
    if "table_plane" in tables:
        camera_at = first_table_from_camera(tables["table_plane"]).translation
        overview = Overview(_table_edge(tables), camera_at)
    streams = shown_streams(manifest)
    return layout(paths, shown, image_size=_image_size(manifest), overview=overview, streams=streams)


def _image_size(manifest: Manifest) -> tuple[int, int] | None:
    camera = color_camera(manifest)
    return (camera.width_px, camera.height_px) if camera is not None else None


def _table_edge(tables: Mapping[str, pa.Table]) -> Floats:
    """The table's edge (n, 2) in the ``table`` frame: as it was drawn or found first, else around the boxes."""
    drawn = np.zeros((0, 3))
    keyframes = tables["keyframes"]
    solid = keyframes.filter(pa.array(integers(keyframes, "dimensions") == 3))
    if not solid.num_rows:
        solid = tables.get("table_outline", solid)
    if solid.num_rows:
        first = solid.filter(pa.array(integers(solid, "frame") == integers(solid, "frame").min()))
        drawn = first_table_from_camera(tables["table_plane"]).apply(numbers(first, "x y z"))
    poses = numbers(tables["poses"], "x y z") if "poses" in tables else np.zeros((0, 3))
    return table_outline(drawn, poses)
