"""Skeletons of a file become part of a session that is there: rows of ``joints``, a rig for each body, a stream.

The frames are those of the annotated video nearest in time; without times, the file's own count of frames.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.errors import FormatError, LimitError, NotFoundError
from ecat.formats.ecat2018.body_scheme import KINECT_V2, read_body_scheme
from ecat.formats.ecat2018.rig import read_rig
from ecat.formats.recordings import ntu
from ecat.geometry.nearest import nearest_in_time
from ecat.model import Stream
from ecat.store import Session, TableData, files
from ecat.store.media import annotated_stream
from ecat.store.times import image_times_s
from ecat.tables import JOINTS

SEMANTIC_TYPE = "bodyRig"
GREEN = "#008000ff"
_MOST_BODY = 127
_FROM_FILE = ("joint", "x", "y", "z", "u_px", "v_px", "state")


@dataclass(frozen=True)
class Skeletons:
    """What a file says: rows of ``joints`` without objects, by the file's own numbers of bodies; and remarks."""

    source: Path
    scheme: Path | None
    rows: pa.Table
    findings: tuple[str, ...] = ()

    @property
    def bodies(self) -> list[int]:
        """The numbers of the bodies in it."""
        return np.unique(np.asarray(self.rows["body"])).tolist()


def read_skeletons(path: Path, session: Session) -> Skeletons:
    """Skeletons of a file, or of a folder with one and perhaps a body scheme beside it.

    Raises
    ------
    FormatError : there is none, or it cannot be read.
    """
    inside = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
    for file in inside:
        if ntu.sniff(file):
            return _within(_of_ntu(file), session.manifest.n_frames)
    schemes = [file for file in inside if "scheme" in file.name.lower() and file.suffix.lower() == ".xml"]
    rigs = [file for file in inside if file.suffix.lower() == ".xml" and file not in schemes]
    if not rigs:
        names = ", ".join(file.name for file in inside[:5])
        raise FormatError(
            "cannot read the skeletons",
            where=f"{names}: neither a rig file (.xml) nor an NTU skeleton (.skeleton)",
            fix="choose the file of a recorder, and its body scheme if it has one",
        )
    return _within(_of_rig(rigs[0], schemes[0] if schemes else None, session), session.manifest.n_frames)


def _within(found: Skeletons, n_frames: int) -> Skeletons:
    """Without what lies behind the recording's end."""
    if not n_frames:
        return found
    rows = found.rows.filter(pc.less(found.rows["frame"], pa.scalar(n_frames, pa.int32())))
    lost = found.rows.num_rows - rows.num_rows
    note = (f"{lost} joints behind the last of {n_frames} frames were left out",) if lost else ()
    return replace(found, rows=rows, findings=(*found.findings, *note))


def _of_rig(file: Path, scheme: Path | None, session: Session) -> Skeletons:
    rig = read_rig(file, KINECT_V2 if scheme is None else read_body_scheme(scheme))
    rows, times = rig.joints, _image_times_ns(session)
    if times is not None and rows.num_rows and rows["t_ns"].null_count == 0:
        frames = nearest_in_time(times, np.asarray(rows["t_ns"]), later_on_tie=True)
    else:
        frames = np.maximum(np.asarray(rows["counter"]).astype(np.int64) - 1, 0)
    return Skeletons(file, scheme, _table(rows, {"frame": frames, "t_ns": rows["t_ns"]}), rig.findings)


def _of_ntu(file: Path) -> Skeletons:
    what = f"cannot read {file.name}"
    with files.typed_errors(what, file), files.open_regular(file) as opened:
        found = ntu.parse(opened, what)
    batches = list(ntu.joint_rows(found))
    rows = pa.Table.from_batches(batches, JOINTS.arrow) if batches else JOINTS.arrow.empty_table()
    return Skeletons(file, None, rows, tuple(found.notes))


def _image_times_ns(session: Session) -> NDArray[np.int64] | None:
    video = annotated_stream(session.manifest)
    if video is None:
        return None
    try:
        return np.rint(image_times_s(session, video) * 1e9).astype(np.int64)
    except NotFoundError:
        return None


def _table(rows: pa.Table, said: Mapping[str, Any]) -> pa.Table:
    columns: dict[str, Any] = {name: rows[name] for name in (*_FROM_FILE, "body")}
    columns |= {
        "frame": pa.array(np.asarray(said["frame"]).astype(np.int32)),
        "t_ns": said["t_ns"],
        "object_id": pa.nulls(rows.num_rows, JOINTS.arrow.field("object_id").type),
    }
    made = pa.table({name: columns[name] for name in JOINTS.arrow.names})
    return made.cast(JOINTS.arrow)


def add_operations(found: Skeletons) -> list[dict[str, Any]]:
    """The operations that add a rig for each body, in the order of ``found.bodies``, with what ECAT wrote of them."""
    name, scheme = found.source.stem, {} if found.scheme is None else {"sourceScheme": found.scheme.name}
    return [
        {
            "op": "add_object",
            "kind": "rig",
            "name": f"{name} {body}" if len(found.bodies) > 1 else name,
            "color": GREEN,
            "semantic_type": SEMANTIC_TYPE,
            "dimensions": 3,
            "origin": "provided",
            "properties": {"rigIndex": str(body), "source": found.source.name, **scheme},
        }
        for body in found.bodies
    ]


def put_skeletons(session: Session, found: Skeletons, objects: Mapping[int, str]) -> None:
    """Commit the rows, and the file as a stream.

    Raises
    ------
    LimitError : more bodies than the table can tell apart.
    """
    before = session.table("joints").to_arrow() if session.has_table("joints") else JOINTS.arrow.empty_table()
    first = 1 + int(np.asarray(before["body"]).max(initial=-1))
    if found.bodies and first + max(found.bodies) > _MOST_BODY:
        raise LimitError(
            "cannot add the skeletons",
            where=f"bodies up to number {first + max(found.bodies)}, at most {_MOST_BODY} can be told apart",
            consequence="nothing was changed",
        )
    bodies = np.asarray(found.rows["body"]).astype(np.int64)
    names = pa.array([objects[int(body)] for body in bodies], pa.string())
    rows = found.rows.set_column(
        found.rows.schema.get_field_index("object_id"),
        JOINTS.arrow.field("object_id"),
        names.dictionary_encode().cast(JOINTS.arrow.field("object_id").type),
    ).set_column(
        found.rows.schema.get_field_index("body"),
        JOINTS.arrow.field("body"),
        pa.array((bodies + first).astype(np.int8)),
    )
    together = pa.concat_tables([before, rows]).unify_dictionaries()
    order = together.sort_by([("frame", "ascending"), ("body", "ascending")])
    stream = _stream(session, found.source)
    with session.write() as commit:
        commit.update(streams=(*session.manifest.streams, stream))
        commit.copy_streams({stream.name: found.source})
        commit.put_table("joints", TableData(data=order))


def _stream(session: Session, source: Path) -> Stream:
    """A stream with a name and a file of its own."""
    names = {stream.name for stream in session.manifest.streams}
    taken = {stream.file.lower() for stream in session.manifest.streams}
    name, count = source.name, 1
    while name in names or f"media/{name}".lower() in taken:
        count += 1
        name = f"{source.stem}_{count}{source.suffix}"
    return replace(Stream(name=name, kind="skeleton"), file=f"media/{name}", present=True)
