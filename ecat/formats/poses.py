"""The poses of a session or a whole project as one Parquet file.

One row per frame and box; every column says its meaning, unit and frame of reference in its metadata.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from ecat.errors import NotFoundError
from ecat.formats.format import ExportReport, Format
from ecat.formats.options import NoOptions
from ecat.geometry.transforms import euler_from_quaternion
from ecat.progress import Progress
from ecat.store import Session, find_sessions, open_session, staged_file
from ecat.tables import Column, TableSchema


def _number(name: str, meaning: str, unit: str, reference: str = "") -> Column:
    return Column(
        name, pa.float64(), f"{meaning}; null where nothing is known", unit, reference, nullable=True
    )


SCHEMA = TableSchema(
    "exported_poses",
    "Pose of every box at every frame of every session.",
    (
        Column("action", pa.string(), "the folder that the session lies in"),
        Column("session", pa.string(), "the session"),
        Column("t_ns", pa.int64(), "time since the session's start; null without a clock", "ns", "", True),
        Column("frame", pa.int32(), "image of the annotated video, from zero"),
        Column("object", pa.string(), "name of the box"),
        *(_number(axis, f"centre of the box: {axis}", "m", "table") for axis in "xyz"),
        _number("rotation", "turn about the table's normal", "rad", "table"),
        _number("roll", "turn about the table's x axis, before the others", "rad", "table"),
        _number("pitch", "turn about the table's y axis, after roll and before rotation", "rad", "table"),
        Column("observed", pa.bool_(), "whether markers of the box were seen in this frame"),
        _number("residual", "root mean square reprojection error of the corners", "px", "colour image"),
        Column("source", pa.string(), "observed, interpolated, or null where nothing is known", "", "", True),
    ),
).arrow
_FRAMES_AT_ONCE = 1 << 16


def write_smooth(path: Path, dest: Path, options: NoOptions, progress: Progress) -> ExportReport:
    """Write the smoothed poses of every session at ``path``; errors as in :func:`write`."""
    del options
    return _write(path, dest, progress, "poses_smooth", "poses-smooth")


def write(path: Path, dest: Path, options: NoOptions, progress: Progress) -> ExportReport:
    """Write the poses of every session at ``path``, each solved from its frame alone.

    Raises
    ------
    NotFoundError : no session has poses yet.
    """
    del options
    return _write(path, dest, progress, "poses", "poses")


def _write(path: Path, dest: Path, progress: Progress, table: str, name: str) -> ExportReport:
    sessions = find_sessions(path)
    findings: list[str] = []
    written = 0
    with (
        staged_file(dest, replaces=b"PAR1") as staging,
        pq.ParquetWriter(staging, SCHEMA, compression="zstd") as out,
    ):
        for done, folder in enumerate(sessions):
            progress(folder.name, done, len(sessions))
            session = open_session(folder)
            if not session.has_table(table):
                findings.append(f"{folder.name}: no table {table} yet; left out")
                continue
            for rows in _rows(session, table):
                out.write_table(rows)
            written += 1
        if not written:
            raise NotFoundError(
                f"cannot export the poses of {path}",
                where=f"none of its {len(sessions)} sessions has a table {table}",
                consequence="nothing was written",
                fix=f"ecat process {path}" + (" --smooth" if table == "poses_smooth" else ""),
            )
    progress(path.name, len(sessions), len(sessions))
    return ExportReport(path=dest, format=name, sessions=written, findings=tuple(findings))


def _rows(session: Session, table: str) -> Iterator[pa.Table]:
    """The rows to write, some frames at a time: a recording may be longer than memory allows."""
    names: dict[str, str] = {}
    for row in session.objects.to_arrow().to_pylist():
        # the first layer's name counts; an object without one goes by its id
        names.setdefault(row["object_id"], row["name"] or row["object_id"])
    left, start = session.table(table).num_rows, 0
    while left > 0 and start < 1 << 31:
        poses = session.table(table, start_frame=start, end_frame=start + _FRAMES_AT_ONCE).to_arrow()
        if poses.num_rows:
            yield _exported(poses, session, names)
        left, start = left - poses.num_rows, start + _FRAMES_AT_ONCE


def _exported(poses: pa.Table, session: Session, names: dict[str, str]) -> pa.Table:
    quaternions = np.column_stack([np.asarray(poses[q]) for q in ("qx", "qy", "qz", "qw")])
    roll, pitch, yaw = euler_from_quaternion(quaternions)
    objects: Any = poses["object_id"].cast(pa.string()).combine_chunks().dictionary_encode()
    labels = pa.array([names.get(known, known) for known in objects.dictionary.to_pylist()], pa.string())
    source = poses["source"].cast(pa.string())
    angles = {"rotation": yaw, "roll": roll, "pitch": pitch}
    columns: dict[str, Any] = {
        "action": pa.repeat(session.path.resolve().parent.name, poses.num_rows),
        "session": pa.repeat(session.name, poses.num_rows),
        "object": labels.take(objects.indices),
        **{name: poses[name] for name in ("t_ns", "frame", "x", "y", "z")},
        **{name: pa.array(values, from_pandas=True) for name, values in angles.items()},
        "observed": pc.equal(source, pa.scalar("observed")).fill_null(False),
        "residual": poses["residual_px"],
        "source": source,
    }
    return pa.table([columns[field.name] for field in SCHEMA], schema=SCHEMA)


FORMAT = Format(
    name="poses", description="block poses, each from its frame alone, as one Parquet file", write=write
)
SMOOTH = Format(
    name="poses-smooth", description="block poses smoothed in time, as one Parquet file", write=write_smooth
)
