"""Poses of marked boxes in the ``table`` frame, frame by frame, without looking at any other frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.errors import InputError
from ecat.geometry.boxfit import RESTING, Noise
from ecat.geometry.boxpose import BoxPoses, Doubt, box_poses, moved_to, scene_of
from ecat.geometry.cameras import KINECT_V2_COLOR, Camera
from ecat.geometry.contact import parted
from ecat.geometry.poseerror import SteadyErrors
from ecat.geometry.transforms import Floats, Rigid
from ecat.geometry.transforms import known as known_numbers
from ecat.model.prototype import NOMINAL_BOXES, BoxPrototype
from ecat.stages.images import ImagesByKind
from ecat.stages.rows import Given, InMemory, rows_of
from ecat.stages.sightings import BoxSightings, box_sightings, object_prototypes, read_faces
from ecat.stages.stage import Stage, Tables
from ecat.tables import POSES, TableSchema

NUMBERS = ("x", "y", "z", "qx", "qy", "qz", "qw", "residual_px", "sigma_m", "sigma_rad")
LISTS = {"covariance": 21, "alternative": 7}
UPPER = np.triu_indices(6)
"""Rows and columns of the 21 numbers of a covariance (6, 6)."""


_FRAMES_AT_ONCE = 2048


@dataclass(frozen=True)
class PoseParameters:
    """``prototypes`` should be calibrated ones; the nominal boxes are a rough default.  ``noise`` is that of the
    detector which made the marks: :data:`ecat.geometry.boxfit.OUTERMOST` or ``SUBPIXEL``.

    ``overlap_m``: resting boxes that stand in each other by more are moved apart to that; as much may be the
    error of both places.
    """

    prototypes: tuple[BoxPrototype, ...] = NOMINAL_BOXES
    camera: Camera = KINECT_V2_COLOR
    noise: Noise = field(default_factory=Noise)
    doubt: Doubt = field(default_factory=Doubt)
    steady: SteadyErrors = field(default_factory=SteadyErrors)
    overlap_m: float = 0.002


def table_frame(table_plane: pa.Table) -> Rigid:
    """camera-from-table of the last row of a ``table_plane`` table; errors as for :func:`table_frames`."""
    return table_frames(table_plane)[-1][1]


def table_frames(table_plane: pa.Table) -> list[tuple[int, Rigid]]:
    """camera-from-table of every row of a ``table_plane`` table, with the frame from which on it holds, ascending.

    Raises
    ------
    InputError : the table has no rows.
    """
    if not table_plane.num_rows:
        raise InputError(
            "cannot place boxes on the table", where="table_plane has no rows", fix="fit the plane first"
        )
    found: list[tuple[int, Rigid]] = []
    for row in sorted(table_plane.to_pylist(), key=lambda row: int(row["frame"])):
        quaternion = np.array([row[name] for name in ("qx", "qy", "qz", "qw")])
        origin = np.array([row[f"origin_{axis}"] for axis in "xyz"])
        found.append((int(row["frame"]), Rigid.from_quaternion(quaternion, origin)))
    return found


def estimate_poses(
    clock: pa.Table,
    markers_2d: Given | None,
    markers_3d: Given | None,
    table_plane: pa.Table,
    parameters: PoseParameters | None = None,
    *,
    face_planes: Given | None = None,
) -> pa.Table:
    """The table ``poses``: a row for every frame of ``clock`` (frame, t_ns) and every box seen in the
    session.

    Frames in which no face of a box is seen, or none agrees with a pose, have nulls.  3-D corners (metres,
    ``camera/depth``) help where the 2-D corners leave the distance open, and stand alone where those are
    missing; ``face_planes`` decide which of two ways a single face leans.  Each frame's pose is in the ``table`` frame
    of the last row of ``table_plane`` that is not later, the first row's before that.
    """
    parts = _parts(clock, (markers_2d, markers_3d), table_plane, parameters or PoseParameters(), face_planes)
    return pa.concat_tables([POSES.arrow.empty_table(), *parts])


def _parts(
    clock: pa.Table,
    markers: tuple[Given | None, Given | None],
    table_plane: pa.Table,
    parameters: PoseParameters,
    face_planes: Given | None,
) -> Iterator[pa.Table]:
    """The rows of some frames at a time."""
    read = [None if given is None else rows_of(given) for given in (*markers, face_planes)]
    codes = [None if rows is None else rows.select(("object_id", "code")) for rows in read[:2]]
    prototypes = object_prototypes(codes, parameters.prototypes, mirrored=parameters.camera.mirrored)
    seen: set[str] = set()
    waiting: list[pa.Table] = []
    for table, first, end in _stretches(table_frames(table_plane), clock):
        flat, solid, planes = (None if rows is None else rows.between(first, end) for rows in read)
        faces = read_faces(flat, solid, parameters.camera, planes)
        boxes = box_sightings(faces, parameters.prototypes, parameters.camera, parameters.noise, prototypes)
        seen |= {box.object_id for box in boxes}
        found = _solid(boxes, [_placed(box, parameters, table) for box in boxes], parameters, table)
        now = InMemory(clock).between(first, end)
        known = {box.object_id: _filled(now, box, poses) for box, poses in zip(boxes, found, strict=True)}
        waiting.append(pose_table(now, [known.get(name) or _unknown(now, name) for name in prototypes]))
        if len(seen) == len(prototypes):
            yield from waiting
            waiting.clear()
    for poses in waiting:  # of some objects there was not one face that can be one
        known_ids = pa.array(sorted(seen), pa.string())
        yield poses.filter(pc.is_in(poses["object_id"].cast(pa.string()), known_ids))


def _stretches(tables: Sequence[tuple[int, Rigid]], clock: pa.Table) -> Iterator[tuple[Rigid, int, int]]:
    """The frames from first to end, each with its table, in pieces whose equations fit into little memory."""
    end = int(clock["frame"][-1].as_py()) + 1 if clock.num_rows else 0
    starts = [0, *(first for first, _ in tables[1:] if first < end), end]
    for (_, table), start, stop in zip(tables, starts, starts[1:], strict=False):
        for first in range(start, stop, _FRAMES_AT_ONCE):
            yield table, first, min(first + _FRAMES_AT_ONCE, stop)


def _placed(box: BoxSightings, parameters: PoseParameters, table: Rigid) -> BoxPoses:
    return box_poses(
        box.seen,
        parameters.prototypes[box.prototype],
        parameters.camera,
        table,
        noise=parameters.noise,
        doubt=parameters.doubt,
        steady=parameters.steady,
    )


def _solid(
    boxes: Sequence[BoxSightings], found: Sequence[BoxPoses], parameters: PoseParameters, table: Rigid
) -> list[BoxPoses]:
    """The poses with resting boxes moved out of each other, frame by frame."""
    apart = list(found)
    for i, j in combinations(range(len(boxes)), 2):
        if boxes[i].prototype == boxes[j].prototype:
            continue  # one box that was recorded under two names
        _, a, b = np.intersect1d(boxes[i].frame, boxes[j].frame, return_indices=True)
        resting = [(p.n_faces > 0) & ~p.free for p in (apart[i], apart[j])]
        both = resting[0][a] & resting[1][b]
        rows = {i: a[both], j: b[both]}
        before = {k: Rigid(apart[k].pose.rotation[r], apart[k].pose.translation[r]) for k, r in rows.items()}
        sizes = [np.array(parameters.prototypes[boxes[k].prototype].size_m) for k in rows]
        spread = [apart[k].covariance[r][:, RESTING][:, :, RESTING] for k, r in rows.items()]
        after = parted(
            before[i], before[j], (sizes[0], sizes[1]), (spread[0], spread[1]), parameters.overlap_m
        )
        for k, pose in zip(rows, after, strict=True):
            if np.abs(pose.translation - before[k].translation).max(initial=0.0) > 0:
                prototype = parameters.prototypes[boxes[k].prototype]
                scene = scene_of(prototype, parameters.camera, table)
                there = Rigid(apart[k].pose.rotation.copy(), apart[k].pose.translation.copy())
                there.rotation[rows[k]], there.translation[rows[k]] = pose.rotation, pose.translation
                apart[k] = moved_to(apart[k], there, boxes[k].seen, scene, noise=parameters.noise)
    return apart


@dataclass(frozen=True)
class ObjectPoses:
    """The poses of one object over all frames (n,), NaN where unknown; ``numbers`` has the columns NUMBERS, ``lists``
    (n, k) those of LISTS.

    ``source`` 0 unknown, 1 observed, 2 interpolated; ``free`` only counts where it is known.
    """

    object_id: str
    numbers: dict[str, Floats]
    lists: dict[str, Floats]
    source: NDArray[np.int64]
    free: NDArray[np.bool_]
    n_faces: NDArray[np.int64]


def _filled(clock: pa.Table, box: BoxSightings, poses: BoxPoses) -> ObjectPoses:
    frames = clock["frame"].to_numpy()
    kept = (poses.n_faces > 0) & np.isin(box.frame, frames)
    rows = np.searchsorted(frames, box.frame[kept])
    values = np.concatenate([poses.pose.translation, poses.pose.quaternion], 1).T
    columns = dict(zip(NUMBERS[:7], values, strict=True))
    columns |= {"residual_px": poses.residual_px, "sigma_m": poses.sigma_m, "sigma_rad": poses.sigma_rad}
    filled = _unknown(clock, box.object_id)
    for name, column in columns.items():
        filled.numbers[name][rows] = column[kept]
    other = np.concatenate([poses.other.translation, poses.other.quaternion], 1)
    filled.lists["covariance"][rows] = poses.covariance[:, UPPER[0], UPPER[1]][kept]
    filled.lists["alternative"][rows] = other[kept]
    filled.source[rows], filled.free[rows], filled.n_faces[rows] = 1, poses.free[kept], poses.n_faces[kept]
    return filled


def _unknown(clock: pa.Table, object_id: str) -> ObjectPoses:
    """An object of which nothing is seen."""
    n = clock.num_rows
    return ObjectPoses(
        object_id,
        {name: np.full(n, np.nan) for name in NUMBERS},
        {name: np.full((n, k), np.nan) for name, k in LISTS.items()},
        np.zeros(n, np.int64),
        np.zeros(n, bool),
        np.zeros(n, np.int64),
    )


def pose_table(clock: pa.Table, objects: Sequence[ObjectPoses], schema: TableSchema = POSES) -> pa.Table:
    """The objects' poses as one table, sorted by frame and object; ``clock`` has a row (frame, t_ns) per
    frame.
    """
    if not objects:
        return schema.arrow.empty_table()
    n, m = clock.num_rows, len(objects)
    # frame by frame, the objects in order: the transpose of object by object
    known = np.array([o.source for o in objects], np.int64).reshape(m, n).T.ravel() > 0
    columns: dict[str, Any] = {}
    for name in ("t_ns", "frame"):
        columns[name] = clock[name].combine_chunks().take(np.repeat(np.arange(n), m))
    columns["object_id"] = pa.array([o.object_id for o in objects] * n, pa.string())
    for name in NUMBERS:
        values = np.array([o.numbers[name] for o in objects]).reshape(m, n).T.ravel()
        columns[name] = pa.array(values, mask=~np.isfinite(values))
    for name, k in LISTS.items():
        lists = np.array([o.lists[name] for o in objects]).reshape(m, n, k).transpose(1, 0, 2).reshape(-1, k)
        missing = pa.array(~known_numbers(lists))
        columns[name] = pa.FixedSizeListArray.from_arrays(pa.array(lists.ravel()), k, mask=missing)
    columns["source"] = _words([o.source for o in objects], [None, "observed", "interpolated"], known)
    columns["support"] = _words([o.free.astype(np.int64) for o in objects], ["table", "free"], known)
    n_faces = np.array([o.n_faces for o in objects], np.int16).reshape(m, n).T.ravel()
    columns["n_faces"] = pa.array(n_faces, mask=n_faces == 0)
    arrays = [columns[column.name].cast(column.type) for column in schema.arrow]
    return pa.Table.from_arrays(arrays, schema=schema.arrow)


def _words(codes: Sequence[NDArray[np.int64]], words: list[str | None], known: NDArray[np.bool_]) -> Any:
    flat = np.array(codes, np.int64).reshape(len(codes), -1).T.ravel()
    return pa.array(np.array(words, dtype=object)[flat], pa.string(), mask=~known)


def _run(tables: Tables, images: ImagesByKind, parameters: PoseParameters) -> dict[str, pa.Table]:
    del images
    found = estimate_poses(
        tables["clock"],
        tables.get("markers_2d"),
        tables.get("markers_3d"),
        tables["table_plane"],
        parameters,
        face_planes=tables.get("face_planes"),
    )
    return {"poses": found}


def _run_parts(tables: Tables, images: ImagesByKind, parameters: PoseParameters) -> Iterator[pa.Table]:
    del images
    markers = tables.get("markers_2d"), tables.get("markers_3d")
    return _parts(tables["clock"], markers, tables["table_plane"], parameters, tables.get("face_planes"))


POSE = Stage(
    name="pose",
    version=4,
    inputs=("clock", "table_plane", "markers_2d", "markers_3d", "face_planes"),
    partly=("markers_2d", "markers_3d", "face_planes"),
    outputs=("poses",),
    parameters=PoseParameters,
    run=_run,
    parts=_run_parts,
    optional=("markers_2d", "markers_3d", "face_planes"),
)
