"""The poses of a session or a whole project as one Parquet file.

One row per frame and box: ``action`` (the project's folder), ``session``, ``frame``, ``object`` (its name),
``x``, ``y``, ``z`` (metres in the table frame), ``rotation`` (about the table's normal), ``roll``, ``pitch``
(radians), ``observed``, ``residual`` (pixels), ``source``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ecat.errors import NotFoundError
from ecat.formats.format import ExportReport, Format
from ecat.geometry.transforms import euler_from_quaternion
from ecat.progress import Progress
from ecat.store import Session, find_sessions, open_session, staged_file

SCHEMA = pa.schema(
    [
        ("action", pa.string()),
        ("session", pa.string()),
        ("frame", pa.int32()),
        ("object", pa.string()),
        *((name, pa.float64()) for name in ("x", "y", "z", "rotation", "roll", "pitch")),
        ("observed", pa.bool_()),
        ("residual", pa.float64()),
        ("source", pa.string()),
    ]
)


def write_smooth(path: Path, dest: Path, progress: Progress) -> ExportReport:
    """Write the smoothed poses of every session at ``path``; errors as in :func:`write`."""
    return _write(path, dest, progress, "poses_smooth", "poses-smooth")


def write(path: Path, dest: Path, progress: Progress) -> ExportReport:
    """Write the poses of every session at ``path``, each solved from its frame alone.

    Raises
    ------
    NotFoundError : no session has poses yet.
    """
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
            out.write_table(_rows(session, table))
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


def _rows(session: Session, table: str) -> pa.Table:
    poses = session.table(table).to_arrow()
    names: dict[str, str] = {}
    for row in session.objects.to_arrow().to_pylist():
        # the first layer's name counts; an object without one goes by its id
        names.setdefault(row["object_id"], row["name"] or row["object_id"])
    quaternions = np.column_stack([np.asarray(poses[q]) for q in ("qx", "qy", "qz", "qw")])
    roll, pitch, yaw = euler_from_quaternion(quaternions)
    n = poses.num_rows
    sources = poses["source"].to_pylist()
    angles = {"rotation": yaw, "roll": roll, "pitch": pitch}
    columns = {
        "action": pa.array([session.path.resolve().parent.name] * n),
        "session": pa.array([session.name] * n),
        "frame": poses["frame"],
        "object": pa.array([names.get(str(o), str(o)) for o in poses["object_id"].to_pylist()]),
        **{axis: poses[axis] for axis in ("x", "y", "z")},
        **{axis: pa.array(values, from_pandas=True) for axis, values in angles.items()},
        "observed": pa.array([source == "observed" for source in sources]),
        "residual": poses["residual_px"],
        "source": pa.array(sources, pa.string()),
    }
    return pa.table([columns[field.name] for field in SCHEMA], schema=SCHEMA)


FORMAT = Format(
    name="poses", description="block poses, each from its frame alone, as one Parquet file", write=write
)
SMOOTH = Format(
    name="poses-smooth", description="block poses smoothed in time, as one Parquet file", write=write_smooth
)
