"""Poses and joints of a session as arrays, some frames at a time: a recording may be longer than memory allows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BufferedWriter, TextIOWrapper
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.formats.ecat2018.body_scheme import KINECT_V2
from ecat.geometry.transforms import Floats, Rigid, known
from ecat.store import Session, files

FRAMES_AT_ONCE = 4096
JOINTS: tuple[str, ...] = tuple(joint.name for joint in KINECT_V2.joints)
"""The joints of a body, in the order of :class:`Bodies`."""
NOT_TRACKED, INFERRED, TRACKED = range(3)
_STATES = {"not_tracked": NOT_TRACKED, "inferred": INFERRED, "tracked": TRACKED}
_FAR = 1 << 31


@dataclass(frozen=True)
class Poses:
    """Poses of boxes at some frames, NaN where unknown.

    Parameters
    ----------
    frame : (f,). t_ns : (f,), None without a clock. centre : (f, k, 3) metres, ``table``.
    quaternion : (f, k, 4), x, y, z, w. observed : (f, k), false where it was interpolated.
    """

    frame: NDArray[np.int64]
    t_ns: NDArray[np.int64] | None
    centre: Floats
    quaternion: Floats
    observed: NDArray[np.bool_]

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which (f, k) are known."""
        return known(self.centre) & known(self.quaternion)


@dataclass(frozen=True)
class Bodies:
    """Joints of bodies at some frames, NaN where unknown; joints in the order of :data:`JOINTS`.

    Parameters
    ----------
    frame : (f,). t_ns : (f,), None without a clock. seen : (f, b), whether there is a row of the body.
    position : (f, b, 25, 3) metres, ``camera/depth``. pixel : (f, b, 25, 2) in the colour image.
    state : (f, b, 25) 0 not tracked, 1 inferred, 2 tracked, -1 unknown.
    """

    frame: NDArray[np.int64]
    t_ns: NDArray[np.int64] | None
    seen: NDArray[np.bool_]
    position: Floats
    pixel: Floats
    state: NDArray[np.int8]


def when(stretch: Poses | Bodies, times: NDArray[np.int64]) -> NDArray[np.int64]:
    """The time (f,) of each frame; those without one of their own have that of the session's frame in ``times``."""
    return stretch.t_ns if stretch.t_ns is not None else times[np.minimum(stretch.frame, len(times) - 1)]


def stretches(
    session: Session,
    table: str,
    columns: Sequence[str] | None = None,
    *,
    within: tuple[int, int] | None = None,
) -> Iterator[pa.Table]:
    """The rows of a table that has frames, in their order, some frames at a time; or all ``within`` some frames."""
    if within is not None:
        only = session.table(table, start_frame=within[0], end_frame=within[1], columns=columns).to_arrow()
        yield from [only] * bool(only.num_rows)
        return
    left, start, width = session.table(table).num_rows, 0, FRAMES_AT_ONCE
    while left > 0 and start < _FAR:
        view = session.table(table, start_frame=start, end_frame=start + width, columns=columns)
        rows = view.to_arrow()
        left, start = left - rows.num_rows, start + width
        # a gap is soon passed, however long it is
        width = FRAMES_AT_ONCE if rows.num_rows else 2 * width
        if rows.num_rows:
            yield rows


def best_poses(session: Session) -> str | None:
    """The table of poses to show: smoothed ones if they are there."""
    return next((name for name in ("poses_smooth", "poses") if session.has_table(name)), None)


def box_ids(session: Session, table: str) -> tuple[str, ...]:
    """The objects that a table of poses is about."""
    return tuple(sorted(_words(session, table, "object_id")))


def poses(
    session: Session, table: str, boxes: Sequence[str], *, within: tuple[int, int] | None = None
) -> Iterator[Poses]:
    """The poses of ``boxes``, which are all that the table is about, in the order of time."""
    columns = ("t_ns", "frame", "object_id", "x", "y", "z", "qx", "qy", "qz", "qw", "source")
    for rows in stretches(session, table, columns, within=within):
        frames, at = np.unique(_integers(rows, "frame"), return_inverse=True)
        which = _positions(rows, "object_id", boxes)
        centre = np.full((len(frames), len(boxes), 3), np.nan)
        quaternion = np.full((len(frames), len(boxes), 4), np.nan)
        observed = np.zeros((len(frames), len(boxes)), np.bool_)
        centre[at, which] = numbers(rows, "x y z")
        quaternion[at, which] = numbers(rows, "qx qy qz qw")
        observed[at, which] = _positions(rows, "source", ("observed",)) == 0
        yield Poses(frames, _times(rows, at, len(frames)), centre, quaternion, observed)


def body_slots(session: Session) -> dict[int, str]:
    """The bodies of table ``joints`` by their slot, each with its annotated object, if any."""
    found: dict[int, str] = {}
    if session.has_table("joints"):
        for rows in stretches(session, "joints", ("body", "object_id")):
            pairs: list[dict[str, Any]] = rows.group_by(["body", "object_id"]).aggregate([]).to_pylist()
            for row in pairs:
                found[row["body"]] = found.get(row["body"]) or row["object_id"] or ""
    return dict(sorted(found.items()))


def joint_names(session: Session) -> set[str]:
    """The names of all joints that occur."""
    return _words(session, "joints", "joint") if session.has_table("joints") else set()


def bodies(
    session: Session, slots: Sequence[int], *, within: tuple[int, int] | None = None
) -> Iterator[Bodies]:
    """The joints of the bodies in ``slots``, which are all there are, in the order of time."""
    for stretch in stretches(session, "joints", within=within):
        which = _positions(stretch, "joint", JOINTS)
        rows, which = stretch.filter(pa.array(which >= 0)), which[which >= 0]
        frames, at = np.unique(_integers(rows, "frame"), return_inverse=True)
        body = np.searchsorted(np.asarray(slots), _integers(rows, "body"))
        shape = (len(frames), len(slots), len(JOINTS))
        position, pixel = np.full((*shape, 3), np.nan), np.full((*shape, 2), np.nan)
        state = np.full(shape, -1, np.int8)
        seen = np.zeros(shape[:2], np.bool_)
        seen[at, body] = True
        position[at, body, which] = numbers(rows, "x y z")
        pixel[at, body, which] = numbers(rows, "u_px v_px")
        state[at, body, which] = _positions(rows, "state", list(_STATES))
        yield Bodies(frames, _times(rows, at, len(frames)), seen, position, pixel, state)


@dataclass(frozen=True)
class CameraPath:
    """Where a camera (or its stream) was in ``world`` at ``t_ns`` (n,); ``n_unknown`` rows say nothing."""

    name: str
    t_ns: NDArray[np.int64]
    place: Rigid
    n_unknown: int


def camera_paths(session: Session, times: NDArray[np.int64]) -> Iterator[CameraPath]:
    """The paths of moving cameras; what has no time of its own has that of the session's frame in ``times``."""
    rows: pa.Table = session.table("camera_poses").to_arrow()
    cameras = rows["camera"].cast(pa.string())
    names: list[Any] = cameras.unique().to_pylist()
    which = _positions(rows, "camera", names)
    by_frame = times[np.clip(np.nan_to_num(numbers(rows, "frame")[:, 0]), 0, len(times) - 1).astype(np.int64)]
    t_ns = rows["t_ns"].combine_chunks()
    timed = np.asarray(t_ns.is_valid())
    when = np.where(timed, np.asarray(t_ns.fill_null(pa.scalar(0, pa.int64()))), by_frame)
    values = numbers(rows, "x y z qx qy qz qw")
    kept = known(values)
    for k in sorted(range(len(names)), key=lambda k: names[k]):
        mine = kept & (which == k)
        place = Rigid.from_quaternion(values[mine, 3:], values[mine, :3])
        yield CameraPath(names[k], when[mine], place, int((~kept & (which == k)).sum()))


def new_text(path: Path) -> TextIOWrapper:
    """A text file to be written: UTF-8, lines end as on Unix."""
    return TextIOWrapper(BufferedWriter(files.NewFile(path)), "utf-8", newline="\n")


def numbers(rows: pa.Table, names: str) -> Floats:
    """The named columns as (rows, columns), NaN where null."""
    columns = [np.asarray(rows[name].to_numpy(), np.float64) for name in names.split()]
    return np.stack(columns, -1).reshape(rows.num_rows, len(columns))


def _words(session: Session, table: str, name: str) -> set[str]:
    """Every word that occurs in a column."""
    found: set[Any] = set()
    for rows in stretches(session, table, (name,)):
        found |= set(rows[name].unique().to_pylist())
    return found - {None}


def _integers(rows: pa.Table, name: str) -> NDArray[np.int64]:
    return np.asarray(rows[name].to_numpy(), np.int64)


def _times(rows: pa.Table, at: NDArray[np.intp], n: int) -> NDArray[np.int64] | None:
    """The time of each frame; None where there is one without."""
    if not rows.num_rows or rows["t_ns"].null_count:
        return None
    found = np.zeros(n, np.int64)
    found[at] = _integers(rows, "t_ns")
    return found


def _positions(rows: pa.Table, name: str, words: Sequence[str]) -> NDArray[np.intp]:
    """Where each row's word is among ``words``; -1 for others and for null."""
    if not rows.num_rows:
        return np.zeros(0, np.intp)
    column = rows[name].cast(pa.string()).combine_chunks().dictionary_encode()
    places = {word: place for place, word in enumerate(words)}
    words_there: list[Any] = column.dictionary.to_pylist()
    place = np.array([*(places.get(word, -1) for word in words_there), -1], np.intp)
    return place[np.asarray(column.indices.fill_null(-1), np.intp)]
