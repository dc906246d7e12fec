"""Skeletons of NTU RGB+D (``.skeleton``): 25 joints of a Kinect v2 per body and frame, as text.

Source: Shahroudy et al., NTU RGB+D: A large scale dataset for 3D human activity analysis, CVPR 2016, and the reader
published with it.  The number of frames; for each frame the number of bodies; for each body a line of ten values (the
first is its tracking id), the number of joints, and a line of twelve for each joint: x, y, z (metres, Kinect camera
space), place in the depth image, place in the colour image, orientation w, x, y, z, tracking state.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NoReturn

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.errors import FormatError, LimitError
from ecat.formats.ecat2018.body_scheme import KINECT_V2
from ecat.formats.format import Format, ImportOptions, ImportReport
from ecat.formats.recordings.rows import numbers_of
from ecat.formats.recordings.untimed import create_untimed
from ecat.progress import Progress
from ecat.store import TableData, files
from ecat.tables import JOINTS

NAME = "ntu-skeleton"
_JOINTS = [joint.name for joint in KINECT_V2.joints]
_NUMBERS = 12
_KEPT = (0, 1, 2, 5, 6, 11)  # x, y, z, colour u, v, state
_STATES = ("not_tracked", "inferred", "tracked")
_MAX_LINE_BYTES = 4096
_MAX_BYTES = 256 << 20
_MAX_BODIES = 128
_MAX_FRAMES = 1 << 24
_PARSED_TOGETHER = 256
_BATCH_BODIES = 1024


@dataclass
class Skeletons:
    """What a file holds.

    Attributes
    ----------
    n_frames : as the file says. frame, body : of each body seen, from zero; bodies are numbered as they first appear.
    values : (n, 25, 6): x, y, z in metres (OpenCV axes), u, v in pixels, state (0, 1, 2); NaN where unknown.
    """

    n_frames: int = 0
    frame: array[int] = field(default_factory=lambda: array("i"))
    body: array[int] = field(default_factory=lambda: array("b"))
    parts: list[NDArray[np.float64]] = field(default_factory=list[NDArray[np.float64]])
    notes: list[str] = field(default_factory=list[str])

    @property
    def values(self) -> NDArray[np.float64]:
        """All bodies together."""
        return np.concatenate([*self.parts, np.zeros((0, len(_JOINTS), len(_KEPT)))])


class _Ended(Exception):  # noqa: N818  (not an error: the file is shorter than it says)
    """The file ends."""


class _Lines:
    """Lines of a file, with their numbers for errors."""

    def __init__(self, file: BinaryIO, what: str) -> None:
        self._file, self._what, self.number, self._is_cut = file, what, 0, False

    def next(self) -> bytes:
        """The next line that is not empty."""
        while True:
            line = self._file.readline(_MAX_LINE_BYTES)
            self.number += 1
            if not line:
                raise _Ended
            if len(line) == _MAX_LINE_BYTES:
                raise self.error(f"a line of {_MAX_LINE_BYTES} bytes or more")
            self._is_cut = not line.endswith(b"\n")
            if stripped := line.strip():
                return stripped

    def count(self, of: str, most: int) -> int:
        """The next line, a whole number from 0 to ``most``."""
        line = self.next()
        if not line.isdigit() or len(line) > 9 or int(line) > most:
            self.refuse(f"expected the number of {of}, found {line[:40]!r}")
        return int(line)

    def refuse(self, problem: str) -> NoReturn:
        """Raise the error for the line read last; where the file breaks off in it, that is the end of the file."""
        if self._is_cut:
            raise _Ended
        raise self.error(problem)

    def error(self, problem: str) -> FormatError:
        """The error for the line read last."""
        return FormatError(self._what, where=f"line {self.number}: {problem}")


def sniff(path: Path) -> bool:
    """Whether the file is named as the data set's are."""
    return path.suffix.lower() == ".skeleton" and path.is_file()


def parse(source: bytes | BinaryIO, what: str = "cannot read the skeletons") -> Skeletons:
    """The skeletons of a file; one that ends early keeps the bodies that are whole.

    Raises
    ------
    FormatError : a line is not what the format has there, or there is not even the number of frames.
    LimitError : more bodies than can be told apart.
    """
    lines = _Lines(BytesIO(source) if isinstance(source, bytes) else source, what)
    found = Skeletons()
    try:
        found.n_frames = lines.count("frames", _MAX_FRAMES)
    except _Ended:
        raise FormatError(what, where="the file is empty") from None
    pending: list[bytes] = []
    frame = 0
    try:
        slots: dict[bytes, int] = {}
        for frame in range(found.n_frames):
            for _ in range(lines.count("bodies", _MAX_BODIES)):
                slot, joints = _body(lines, slots, what)
                pending += joints
                found.frame.append(frame)
                found.body.append(slot)
                if len(pending) == _PARSED_TOGETHER * len(_JOINTS):
                    found.parts.append(_numbers(pending, lines))
                    pending.clear()
    except _Ended:
        n = len(found.frame)
        found.notes.append(
            f"the file ends in frame {frame} of {found.n_frames}; {n} skeletons before were kept"
        )
    found.parts.append(_numbers(pending, lines))
    return found


def _body(lines: _Lines, slots: dict[bytes, int], what: str) -> tuple[int, list[bytes]]:
    identifier = lines.next().split()[0]
    if lines.count("joints", 1000) != len(_JOINTS):
        lines.refuse(f"expected {len(_JOINTS)} joints")
    joints = [lines.next() for _ in _JOINTS]
    if len(joints[-1].split()) != _NUMBERS:
        lines.refuse(f"a joint is not {_NUMBERS} numbers")
    slot = slots.setdefault(identifier, len(slots))
    if slot >= _MAX_BODIES:
        raise LimitError(what, where=f"line {lines.number}: more than {_MAX_BODIES} bodies")
    return slot, joints


def _numbers(joints: list[bytes], lines: _Lines) -> NDArray[np.float64]:
    """Joint lines as (n, 25, 6); the axes turned from Kinect camera space, what is not finite to NaN."""
    if not joints:
        return np.zeros((0, len(_JOINTS), len(_KEPT)))
    if any(len(line.split()) != _NUMBERS for line in joints):
        raise lines.error(f"a joint here or before is not {_NUMBERS} numbers")
    values = numbers_of(b" ".join(joints))
    if values is None:
        raise lines.error(f"a joint here or before is not {_NUMBERS} numbers")
    kept = values.reshape(-1, len(_JOINTS), _NUMBERS)[..., _KEPT]
    kept[..., :2] *= -1.0
    kept[~np.isfinite(kept)] = np.nan
    return kept


def read(source: Path, dest: Path, options: ImportOptions, progress: Progress) -> ImportReport:
    """Read the skeletons of a file into a session without images; the data set gives no times.

    Raises
    ------
    FormatError, LimitError : as of :func:`parse`; also a file that is too large.
    """
    del options
    what = f"cannot import {source.name}"
    with files.typed_errors(what, source), files.open_regular(source) as file:
        if file.seek(0, 2) > _MAX_BYTES:
            raise LimitError(what, where=f"{source.name}: more than {_MAX_BYTES:,} bytes")
        file.seek(0)
        found = parse(file, what)
    progress(f"reading {source.name}", 1, 1)
    return create_untimed(
        dest,
        (),
        format_name=NAME,
        source=source.name,
        n_frames=found.n_frames,
        tables={"joints": TableData(data=joint_rows(found))} if len(found.frame) else {},
        notes=found.notes,
        progress=progress,
    )


def joint_rows(found: Skeletons) -> Iterator[pa.RecordBatch]:
    """Rows of the table ``joints``."""
    frame, body = np.frombuffer(found.frame, np.int32), np.frombuffer(found.body, np.int8)
    values, order, n_joints = found.values, np.lexsort((body, frame)), len(_JOINTS)
    for start in range(0, len(order), _BATCH_BODIES):
        rows = order[start : start + _BATCH_BODIES]
        flat = values[rows].reshape(-1, len(_KEPT))
        n = len(flat)
        state = np.select([flat[:, 5] == code for code in range(3)], [0, 1, 2], -1).astype(np.int32)
        names = pa.array(np.tile(np.arange(n_joints, dtype=np.int32), len(rows)), pa.int32())
        columns = {
            "t_ns": pa.nulls(n, pa.int64()),
            "frame": pa.array(np.repeat(frame[rows], n_joints)),
            "object_id": pa.nulls(n, JOINTS.arrow.field("object_id").type),
            "body": pa.array(np.repeat(body[rows], n_joints)),
            "joint": pa.DictionaryArray.from_arrays(names, pa.array(_JOINTS)),
            "state": pa.DictionaryArray.from_arrays(
                pa.array(state, pa.int32(), mask=state < 0), pa.array(_STATES)
            ),
        } | {
            name: pa.array(flat[:, i], from_pandas=True)
            for i, name in enumerate(("x", "y", "z", "u_px", "v_px"))
        }
        yield pa.record_batch([columns[name] for name in JOINTS.arrow.names], schema=JOINTS.arrow)


FORMAT = Format(
    name=NAME,
    description="skeletons of NTU RGB+D (.skeleton): 25 joints per body and frame",
    sniff=sniff,
    read=read,
)
