"""One ECAT session folder: to a draft of a session, and back (ECAT 2018 file format §1.1)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path, PurePosixPath
from typing import cast

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ecat.errors import FormatError, InputError, one_line, os_error
from ecat.formats.ecat2018.body_scheme import KINECT_V2, read_body_scheme, write_body_scheme
from ecat.formats.ecat2018.depth_file import DepthFile
from ecat.formats.ecat2018.elements import PREFIX, small_number
from ecat.formats.ecat2018.fidelity import HASH_KEY, Hashed, first_difference, is_compared
from ecat.formats.ecat2018.files_param import SessionFile, read_files_param
from ecat.formats.ecat2018.files_param_write import file_name, files_param
from ecat.formats.ecat2018.mark_tables import mark_batches
from ecat.formats.ecat2018.rig import RIG_SCHEMA, read_rig, write_rig
from ecat.formats.episodes import chosen_layer
from ecat.formats.format import ImportOptions
from ecat.geometry.cameras import KINECT_V2_COLOR, KINECT_V2_DEPTH
from ecat.geometry.nearest import nearest_in_time
from ecat.geometry.records import camera_record
from ecat.model import Camera, Layer, Manifest, Provenance, Stream
from ecat.model.annotation import MACHINE
from ecat.store import Draft, Session, TableData, write_new_file
from ecat.store.files import sha256_of
from ecat.store.manifest import is_inside, is_utf8
from ecat.tables import FRAMES, JOINTS

SESSION_FILE = "files.param"
LEFTOVER = "~files.param"
_KINDS = {".avi": "color", ".mkv": "color", ".mp4": "color", ".dep": "depth"}
_MANY = 100  # findings kept of one session
_JOINTS_OUT = ("t_ns", "x", "y", "z", "u_px", "v_px", "state")


# ---------------------------------------------------------------------------------------------- reading


def draft_of(folder: Path, options: ImportOptions, findings: list[str]) -> Draft:
    """Read one session folder; one without ``files.param`` is a valid, empty session.

    Raises
    ------
    InputError : a file of the session cannot be read.
    StoreError : a file or the folder cannot be opened.
    """
    file = folder / SESSION_FILE
    if file.exists():
        said = read_files_param(file, skip_bad_markers=options.skip_bad_markers)
    else:
        said = SessionFile(name=folder.name, foreign={"file": "absent"})
    if (folder / LEFTOVER).exists():
        said.findings.append(f"{LEFTOVER} is left of an interrupted save; not imported")
    streams, sources = _streams(folder, said)
    joints = _joints(folder, said, streams)
    manifest = _manifest(folder, said, streams, is_kinect=bool(said.faces_3d or joints))
    if file.exists():
        manifest = _noted(file, said, manifest)
    notes = _few(said.findings)
    findings += [f"{folder.name}: {note}" for note in notes]
    tables = _mark_tables(said)
    if joints:
        tables["joints"] = joints
    if times := _frame_times(folder, streams):
        tables["frames"] = times
    manifest = replace(manifest, provenance=replace(manifest.provenance, notes=notes))
    return Draft(manifest=manifest, layers=(said.layer,), tables=tables, files=sources)


def _manifest(folder: Path, said: SessionFile, streams: tuple[Stream, ...], *, is_kinect: bool) -> Manifest:
    foreign = {PREFIX + key: value for key, value in said.foreign.items()}
    if said.name != folder.name:
        foreign[f"{PREFIX}name"] = said.name
    return Manifest(
        name=folder.name,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        n_frames=said.n_frames,
        clock=said.clock,
        cameras=kinect_cameras() if is_kinect or any(s.kind == "depth" for s in streams) else (),
        streams=streams,
        provenance=Provenance(format="ecat-2018", source=folder.name),
        foreign=foreign,
    )


def _noted(file: Path, said: SessionFile, manifest: Manifest) -> Manifest:
    """See to it that what export would not give back is told, now or then (:mod:`ecat.formats.ecat2018.fidelity`)."""
    if not is_compared(file):
        return replace(manifest, foreign=manifest.foreign | {HASH_KEY: sha256_of(file)})
    tables = {
        name: pa.Table.from_batches(cast("Iterable[pa.RecordBatch]", table.data))
        for name, table in _mark_tables(said).items()
    }
    if found := first_difference(file, manifest, said.layer, tables):
        said.findings.append(found)
    return manifest


def _few(findings: list[str]) -> tuple[str, ...]:
    rest = len(findings) - _MANY
    return (*findings[:_MANY], *([f"and {rest} more like these"] if rest > 0 else []))


@cache
def kinect_cameras() -> tuple[Camera, ...]:
    """The colour and the depth camera of a Kinect v2."""
    # the sensor's own calibration was never stored: these are fits over many recordings
    return camera_record(KINECT_V2_COLOR, "fitted"), camera_record(KINECT_V2_DEPTH, "fitted")


def _mark_tables(said: SessionFile) -> dict[str, TableData]:
    return {
        f"markers_{dimensions}d": TableData(data=mark_batches(groups, said.book, said.clock, said.n_frames))
        for dimensions, groups in ((2, said.faces_2d), (3, said.faces_3d))
        if groups
    }


def _inside(folder: Path, name: str) -> Path | None:
    """The file that a session names, if it is there and really inside the session's folder."""
    if "\\" in name or name == SESSION_FILE or not is_inside(name):
        return None
    path = folder / name
    try:
        return path if path.is_file() and path.resolve().is_relative_to(folder.resolve()) else None
    except OSError:  # a name that the file system cannot have
        return None


def _streams(folder: Path, said: SessionFile) -> tuple[tuple[Stream, ...], dict[str, Path]]:
    """The files that the session lists, and others that lie in its folder."""
    listed = list(dict.fromkeys(said.files))
    if listed != said.files:
        said.findings.append("a file is listed twice")
        said.foreign["files"] = "\n".join(said.files)
    there, known = _files_in(folder, said), {*listed, SESSION_FILE, LEFTOVER}
    others = [name for name in there if name not in known]
    if others:
        said.foreign["unlisted"] = "\n".join(others)
    streams: list[Stream] = []
    sources: dict[str, Path] = {}
    taken: dict[str, int] = {}
    for name in (*listed, *others):
        path = _inside(folder, name)
        target = _target(name, taken)
        video = _KINDS.get(PurePosixPath(name.lower()).suffix, "other")
        kind = "skeleton" if re.fullmatch(r"rig_.*\.xml", name) else video
        streams.append(
            Stream(
                name=name,
                kind=kind,  # pyright: ignore[reportArgumentType]
                file=f"media/{target}" if path is not None else "",
                present=path is not None,
                camera=kind if kind in ("color", "depth") else "",
                n_frames=said.n_frames if kind == "color" else None,
            )
        )
        if path is not None:
            sources[name] = path
            if kind == "depth":
                streams[-1] = _depth_stream(streams[-1], path, said)
    return tuple(streams), sources


def _depth_stream(stream: Stream, path: Path, said: SessionFile) -> Stream:
    """The stream with its number of frames; what is wrong with the file becomes a finding."""
    try:
        with DepthFile(path) as depth:
            said.findings += [f"{path.name}: {finding}" for finding in depth.findings]
            return replace(stream, n_frames=len(depth), codec=f"uint16 mm, {depth.width} x {depth.height}")
    except FormatError as error:
        said.findings.append(f"{path.name}: {error.where}; copied as it is")
        return stream


def _frame_times(folder: Path, streams: Sequence[Stream]) -> TableData | None:
    """The recorded times of the depth frames."""
    parts: list[pa.Table] = []
    for stream in streams:
        path = _inside(folder, stream.name)
        if stream.kind != "depth" or path is None or not stream.n_frames:
            continue
        with DepthFile(path) as depth:
            if depth.times_ms is not None and len(depth.times_ms):
                times = depth.times_ms.astype(np.int64) * 1_000_000
                frames = np.arange(len(times), dtype=np.int32)
                names = (
                    pa.array([stream.name] * len(times))
                    .dictionary_encode()
                    .cast(FRAMES.arrow.field("stream").type)
                )
                parts.append(pa.table([pa.array(times), pa.array(frames), names], schema=FRAMES.arrow))
    if not parts:
        return None
    rows = pa.concat_tables(parts)
    return TableData(data=rows.take(np.argsort(np.asarray(rows["t_ns"]), kind="stable")))


def _files_in(folder: Path, said: SessionFile) -> list[str]:
    """Names of the files in a session's folder."""
    try:
        there = sorted(folder.iterdir())
    except OSError as error:
        raise os_error(error, f"cannot import {folder.name}", folder, "nothing was written") from error
    said.findings += [f"the folder {path.name} was not imported" for path in there if path.is_dir()]
    names = [path.name for path in there if path.is_file()]
    said.findings += [
        f"{one_line(name)} was not imported: its name is not UTF-8" for name in names if not is_utf8(name)
    ]
    return [name for name in names if is_utf8(name)]


def _target(name: str, taken: dict[str, int]) -> str:
    """The name of a file in ``media/``: its own last part, as any file system can have it, told apart from others.

    ``taken`` has the names given out, and the number that the last file of the same name got.
    """
    base = re.sub(r"[^\w .@+()~-]", "_", re.split(r"[\\/]", name)[-1]) or "file"
    target, count = base, taken.get(base.lower(), 1)
    while target.lower() in taken:
        count += 1
        target = f"{count}_{base}"
    taken[base.lower()] = count
    taken.setdefault(target.lower(), 1)
    return target


def _joints(folder: Path, said: SessionFile, streams: Sequence[Stream]) -> TableData | None:
    """The skeletons of the session's rig files, on the video's frames (nearest in time)."""
    parts: list[pa.Table] = []
    rigs: dict[str, pa.Table] = {}
    for thing in said.layer.objects:
        if thing.kind != "rig":
            continue
        values = {p.name: p.value for p in thing.properties}
        source = _inside(folder, re.split(r"[\\/]", values.get("source", ""))[-1])
        if source is None:
            continue
        if source.name not in rigs:
            scheme_file = _inside(folder, re.split(r"[\\/]", values.get("sourceScheme", ""))[-1])
            rigs[source.name] = _rig(source, scheme_file, said)
        body = small_number(values.get("rigIndex"))
        rows = rigs[source.name]
        if body is not None:
            rows = rows.filter(pc.equal(rows["body"], pa.scalar(body, pa.int32())))
        parts.append(_on_frames(rows, thing.id, said))
    for stream in streams:
        source = _inside(folder, PurePosixPath(stream.name).name)
        if stream.kind == "skeleton" and stream.present and source is not None and source.name not in rigs:
            # recorded, but nobody made objects of it
            try:
                rigs[source.name] = _rig(source, None, said)
            except InputError as error:
                said.findings.append(f"{source.name}: copied, but not read: {error.where}")
            else:
                parts.append(_on_frames(rigs[source.name], None, said))
    parts = [part for part in parts if part.num_rows]
    if not parts:
        return None
    return TableData(data=pa.concat_tables(parts).sort_by([("frame", "ascending"), ("body", "ascending")]))


def _rig(source: Path, scheme_file: Path | None, said: SessionFile) -> pa.Table:
    rig = read_rig(source, read_body_scheme(scheme_file) if scheme_file is not None else KINECT_V2)
    said.findings += [f"{source.name}: {finding}" for finding in rig.findings]
    return rig.joints


def _on_frames(rows: pa.Table, object_id: str | None, said: SessionFile) -> pa.Table:
    clock, n_frames = said.clock, said.n_frames
    if clock.duration_ns and n_frames > 1 and rows["t_ns"].null_count == 0:
        times = np.asarray(rows["t_ns"])
        # the frames around each time: a video may claim to have more frames than memory can hold
        about = np.clip(times / clock.duration_ns, -1, 2) * (n_frames - 1)
        near = np.unique(
            np.clip(np.add.outer(np.rint(about), [-2, -1, 0, 1, 2]), 0, n_frames - 1).astype(np.int64)
        )
        moments = np.array(clock.times_ns(near.tolist(), n_frames), np.int64)
        frames = near[nearest_in_time(moments, times, later_on_tie=True)]
    else:
        frames = np.asarray(rows["counter"]).astype(np.int32) - 1
    n = rows.num_rows
    columns = {
        "frame": pa.array(frames, pa.int32()),
        "object_id": pa.array([object_id] * n, pa.string()).dictionary_encode(),
        "body": rows["body"],
        "joint": rows["joint"],
    } | {name: rows[name] for name in _JOINTS_OUT}
    return pa.table([columns[name] for name in JOINTS.arrow.names], schema=JOINTS.arrow)


# ---------------------------------------------------------------------------------------------- writing


def write_session(session: Session, folder: Path, findings: list[str], *, layer: str = "") -> None:
    """Write the session's files into ``folder``, an existing folder that is being made.

    Parameters
    ----------
    layer : whose annotation; without one ``main``, else the first person's.

    Raises
    ------
    NotFoundError : there is no such layer.
    """
    manifest = session.manifest
    names = [record.name for record in manifest.layers]
    people = [name for name in names if name != MACHINE]
    chosen = layer or ("main" if "main" in names else next(iter(people), ""))
    _write_layer(session, chosen_layer(session, chosen) if chosen else Layer(), folder, findings)


def _write_layer(session: Session, layer: Layer, folder: Path, findings: list[str]) -> None:
    manifest, chosen = session.manifest, layer.name
    names = [record.name for record in manifest.layers]
    extra = [name for name in names if name != chosen]
    findings += [f"{session.name}: ECAT has one layer; {name!r} was left out" for name in extra]

    def read(name: str) -> pa.Table | None:
        return session.table(name).to_arrow() if session.has_table(name) else None

    found: list[str] = []
    if manifest.foreign.get(f"{PREFIX}file") != "absent" or layer.objects or layer.events or layer.relations:
        pieces = Hashed(files_param(manifest, layer, read, found))
        write_new_file(folder / SESSION_FILE, pieces)
        unchanged = chosen == "main" and _is_unchanged(manifest)
        if unchanged and manifest.foreign.get(HASH_KEY, pieces.sha256) != pieces.sha256:
            found.append(
                f"{SESSION_FILE} is not the imported file byte for byte: comments or layout were not kept"
            )
    for stream in manifest.streams:
        _write_stream(session, stream, folder, found)
    findings += [f"{session.name}: {finding}" for finding in found]


def _is_unchanged(manifest: Manifest) -> bool:
    """Whether layer and marks are as they were imported."""
    record = manifest.layer("main")
    marks = (manifest.table(f"markers_{dimensions}d") for dimensions in (2, 3))
    return record is not None and record.revision == 1 and not any(table and table.stage for table in marks)


def _write_stream(session: Session, stream: Stream, folder: Path, found: list[str]) -> None:
    name = file_name(session.manifest, stream)
    target = folder / name
    if not is_inside(name) or name == SESSION_FILE:
        if stream.present:
            found.append(f"stream {stream.name}: {name!r} cannot name a file of a session; left out")
    elif stream.present:
        target.parent.mkdir(parents=True, exist_ok=True)
        write_new_file(target, _pieces(session.stream_path(stream.name)))
    elif session.manifest.provenance.format == "ecat-2018":
        return  # it was not there when the session was imported either
    elif stream.kind == "skeleton" and session.has_table("joints"):
        write_new_file(target, write_rig(_rig_rows(session.table("joints").to_arrow())))
    elif name.lower() == "bodyscheme.xml":
        write_new_file(target, [write_body_scheme(KINECT_V2)])


def _pieces(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        while piece := file.read(1 << 20):
            yield piece


def _rig_rows(joints: pa.Table) -> pa.Table:
    """The joints table as records of a rig file; what ECAT has and the table has not is left empty."""
    n_joints = len(KINECT_V2.joints)
    order = {joint.name: i for i, joint in enumerate(KINECT_V2.joints)}
    rank = pa.array([order.get(str(name), n_joints) for name in joints["joint"].to_pylist()], pa.int32())
    rows = joints.append_column("rank", rank).filter(pc.less(rank, pa.scalar(n_joints)))
    rows = rows.sort_by([("frame", "ascending"), ("body", "ascending"), ("rank", "ascending")])
    n = rows.num_rows
    states = {"tracked": 1.0, "inferred": 0.0}
    blank = pa.nulls(n, pa.float64())
    columns = {
        "record": pa.array(np.arange(n) // n_joints, pa.int32()),
        "t_ns": rows["t_ns"],
        "recorded_at": pa.nulls(n, pa.timestamp("us")),
        "counter": pc.add(rows["frame"], pa.scalar(1, pa.int32())),
        "body": rows["body"],
        "joint": rows["joint"],
        "depth_u_px": blank,
        "depth_v_px": blank,
        "confidence": pa.array([states.get(str(s), 0.5) for s in rows["state"].to_pylist()], pa.float64()),
        "state": rows["state"],
    } | {name: rows[name] for name in ("x", "y", "z", "u_px", "v_px")}
    return pa.table([columns[field.name] for field in RIG_SCHEMA], schema=RIG_SCHEMA)
