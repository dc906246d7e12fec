"""Marker faces of glyph boxes: from the text of ``files.param`` to the tables ``markers_2d`` and ``markers_3d``.

A session has tens of thousands of faces, so texts are gathered in chunks and turned into numbers by Arrow.  Corners keep the
order of the file (ECAT 2018 file format §1.2.4: the 2-D and the 3-D list of a face start at different corners, and the
code is oriented by a third rule); codes are as read from the mirrored image.
"""

from __future__ import annotations

import io
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
from numpy.typing import NDArray

from ecat.errors import FormatError
from ecat.formats.ecat2018.face_scanner import Run
from ecat.formats.ecat2018.lexical import USUAL_NUMBERS, format_code, missing_corners, parse_code
from ecat.formats.ecat2018.xml_input import parse_floats
from ecat.model import Clock
from ecat.tables import MARKERS_2D, MARKERS_3D, ROW_GROUP_ROWS, TableSchema

KINECT_TO_CAMERA = np.array([-1.0, -1.0, 1.0])
"""Kinect camera space (x to the sensor's left, y up) to ``camera/depth``; its own inverse."""
_CSV_READ = pa.csv.ReadOptions(column_names=["x"], use_threads=False, block_size=1 << 24)
_CSV_CONVERT = pa.csv.ConvertOptions(column_types={"x": pa.float64()}, null_values=[])


class CodeBook:
    """The codes met in a session; a few dozen texts stand for tens of thousands of faces."""

    def __init__(self) -> None:
        self.codes: list[str | None] = []
        self.texts: list[str | None] = []
        self.known: dict[tuple[bytes, int], int] = {}

    def learn(self, text: bytes, size: int) -> int:
        """The position of a code text, or -1 if it is not ``size`` times ``size`` cells."""
        plain = text.decode("utf-8", "replace")
        code = parse_code(plain)
        if code is None or len(code) != size * size:
            return -1
        number = self.known[text, size] = len(self.codes)
        self.codes.append(code)
        self.texts.append(None if plain == format_code(code) else plain)
        return number

    def keep(self, text: bytes) -> int:
        """The position of a text that is no code: kept as it is."""
        self.codes.append(None)
        self.texts.append(text.decode("utf-8", "replace"))
        return len(self.codes) - 1


def _integers() -> array[int]:
    return array("i")  # a quarter of a list's memory: long sessions have millions of faces


@dataclass
class Faces:
    """The faces of one object in one of its two lists, in file order.

    A marker without faces (an absence, or an empty location) is a face without order, code and corners.  ``object_id`` is
    set when the object's end is met.
    """

    dimensions: int
    what: str
    book: CodeBook
    skip_bad: bool = False
    findings: list[str] = field(default_factory=list[str])
    object_id: str = ""
    frames: array[int] = field(default_factory=_integers)
    orders: array[int] = field(default_factory=_integers)
    sizes: array[int] = field(default_factory=_integers)
    codes: array[int] = field(default_factory=_integers)
    absent: set[int] = field(default_factory=set[int])
    corner_texts: dict[int, str] = field(default_factory=dict[int, str])
    _corners: list[NDArray[np.float64]] = field(default_factory=list[NDArray[np.float64]])

    @property
    def width(self) -> int:
        """Numbers in one face's corner list."""
        return 4 * self.dimensions

    def add(self, run: Run) -> None:
        """Add a run of markers; one without faces counts none."""
        first = len(self.frames)
        counts = [max(count, 1) for count in run.counts]
        self.frames.extend(np.repeat(np.array(run.frames, np.int32), counts).tolist())
        self.sizes.extend(np.repeat(np.array(run.sizes, np.int32), counts).tolist())
        self.orders.extend(order for count in run.counts for order in (range(count) if count else (-1,)))
        marker = np.repeat(np.arange(len(counts)), counts)

        def place(i: int) -> str:
            order = self.orders[first + i]
            return f"line {run.line(int(marker[i]))}, <face> {order + 1} of frame {self.frames[first + i]}"

        codes, corners = run.codes, run.corners
        if 0 in run.counts:
            faces = iter(zip(codes, corners, strict=True))
            filled = [next(faces) if self.orders[first + i] >= 0 else (b"", b"") for i in range(len(marker))]
            codes, corners = [code for code, _ in filled], [corner for _, corner in filled]
        self._add_codes(codes, first, place)
        self._add_corners(corners, first, place)

    def _add_codes(self, codes: list[bytes], first: int, place: Callable[[int], str]) -> None:
        known = self.book.known
        for i, code in enumerate(codes):
            number = known.get((code, self.sizes[first + i]))
            if number is None:
                number = -1 if self.orders[first + i] < 0 else self._code(code, self.sizes[first + i], place(i))
            self.codes.append(number)

    def _code(self, text: bytes, size: int, where: str) -> int:
        number = self.book.learn(text, size)
        if number < 0:
            found = text.count(b",") + bool(text)
            self.bad(f"{where}: expected {size * size} cells of 0 or 1 in <code>, found {found}")
            number = self.book.keep(text)
        return number

    def _add_corners(self, texts: list[bytes], first: int, place: Callable[[int], str]) -> None:
        values = self._parsed(texts, first, place)
        if self.dimensions == 2:  # noqa: PLR2004
            unusual = ~np.isfinite(values).all(axis=1)
            values = np.where(np.isfinite(values), values, np.nan)
        else:
            points = values.reshape(-1, 4, 3)
            missing, unusual = missing_corners(points)
            values = np.where(missing[..., None], np.nan, points * KINECT_TO_CAMERA).reshape(-1, 12)
        usual = pc.match_substring_regex(pa.array(texts).cast(pa.string(), safe=False), USUAL_NUMBERS)
        for i in np.flatnonzero(unusual | ~np.array(usual)).tolist():
            if self.orders[first + i] >= 0:
                self.corner_texts[first + i] = texts[i].decode("utf-8", "replace")
        self._corners.append(values)

    def _parsed(self, texts: list[bytes], first: int, place: Callable[[int], str]) -> NDArray[np.float64]:
        """The texts as (n, width) numbers; by Arrow when all are well-formed, else one by one."""
        if all(text.count(b",") == self.width - 1 for text in texts):
            column = b",".join(texts).replace(b"\xe2\x88\x9e", b"inf").replace(b",", b"\n")
            try:
                table = pa.csv.read_csv(io.BytesIO(column), _CSV_READ, convert_options=_CSV_CONVERT)
                if table.num_rows == len(texts) * self.width:
                    return table.column(0).to_numpy().reshape(len(texts), self.width)
            except pa.ArrowInvalid:
                pass
        return np.array([self._row(text, first, i, place) for i, text in enumerate(texts)])

    def _row(self, text: bytes, first: int, i: int, place: Callable[[int], str]) -> NDArray[np.float64]:
        if self.orders[first + i] < 0:
            return np.full(self.width, np.nan)
        try:
            return parse_floats(text.decode("utf-8", "replace"), self.width, what=self.what, where=place(i))
        except FormatError as error:
            self.bad(error.where)
            return np.full(self.width, np.nan)

    def put_in_order(self) -> bool:
        """Sort markers by frame and keep the last of each frame, as ECAT does; whether anything had to change."""
        frames, orders = np.array(self.frames, np.int64), np.array(self.orders, np.int64)
        marker = np.cumsum(orders <= 0)
        starts = np.flatnonzero(orders <= 0)
        if not len(frames) or (np.diff(frames[starts]) > 0).all():
            return False
        last = {frame: marker[row] for frame, row in zip(frames[starts].tolist(), starts.tolist(), strict=True)}
        keep = np.array([last[frame] == m for frame, m in zip(frames.tolist(), marker.tolist(), strict=True)])
        rows = np.flatnonzero(keep)
        rows = rows[np.argsort(frames[rows], kind="stable")]
        for name in ("frames", "orders", "sizes", "codes"):
            setattr(self, name, array("i", np.array(getattr(self, name))[rows].tolist()))
        new = {int(old): i for i, old in enumerate(rows)}
        self.absent = {new[i] for i in self.absent if i in new}
        self.corner_texts = {new[i]: text for i, text in self.corner_texts.items() if i in new}
        self._corners = [np.concatenate(self._corners)[rows]]
        return True

    def bad(self, where: str) -> None:
        """Refuse a bad face, or note it if bad faces are to be skipped."""
        if not self.skip_bad:
            raise bad_marker(self.what, where)
        self.findings.append(f"{where}; the marker was kept without the bad values")

    def corners(self) -> NDArray[np.float64]:
        """All corners, (n, width), NaN where missing; metres in ``camera/depth`` or pixels."""
        return np.concatenate(self._corners) if self._corners else np.empty((0, self.width))


def bad_marker(what: str, where: str) -> FormatError:
    """The error for a face that cannot be read."""
    return FormatError(
        what,
        where=where,
        consequence="the rest of the session was not imported; nothing was written",
        fix="ecat import --skip-bad-markers ...",
    )


def mark_batches(
    groups: Sequence[Faces], book: CodeBook, clock: Clock, n_frames: int
) -> Iterator[pa.RecordBatch]:
    """The rows of ``markers_2d`` or ``markers_3d``, sorted by frame, object and order, a row group at a time."""
    schema = MARKERS_2D if groups[0].dimensions == 2 else MARKERS_3D
    corners = [group.corners() for group in groups]
    frames = np.concatenate([np.frombuffer(group.frames, np.int32) if group.frames else np.empty(0, np.int32) for group in groups])
    owner = np.repeat(np.arange(len(groups), dtype=np.int32), [len(group.frames) for group in groups])
    start = np.concatenate([[0], np.cumsum([len(group.frames) for group in groups])])
    # within an object the file's order is by frame and face already: a stable sort keeps it
    rows = np.lexsort((owner, frames))
    for begin in range(0, len(rows), ROW_GROUP_ROWS):
        chosen = rows[begin : begin + ROW_GROUP_ROWS]
        yield _batch(
            schema, groups, book, corners, chosen, owner[chosen], start, frames[chosen], (clock, n_frames)
        )


def _batch(
    schema: TableSchema,
    groups: Sequence[Faces],
    book: CodeBook,
    corners: Sequence[NDArray[np.float64]],
    rows: NDArray[np.int64],
    owner: NDArray[np.int32],
    start: NDArray[np.int64],
    frames: NDArray[np.int32],
    time: tuple[Clock, int],
) -> pa.RecordBatch:
    local = rows - start[owner]
    orders, sizes, codes = (np.empty(len(rows), np.int32) for _ in range(3))
    values = np.empty((len(rows), groups[0].width))
    present = np.ones(len(rows), bool)
    texts: list[str | None] = [None] * len(rows)
    for i, group in enumerate(groups):
        mine = np.flatnonzero(owner == i)
        at = local[mine]
        span = slice(int(at.min()), int(at.max()) + 1) if len(at) else slice(0)
        orders[mine] = np.array(group.orders[span], np.int32)[at - span.start]
        sizes[mine] = np.array(group.sizes[span], np.int32)[at - span.start]
        codes[mine] = np.array(group.codes[span], np.int32)[at - span.start]
        values[mine] = corners[i][at]
        if group.absent or group.corner_texts:
            for row, index in zip(mine.tolist(), at.tolist(), strict=True):
                present[row] = index not in group.absent
                texts[row] = group.corner_texts.get(index)
    columns: list[pa.Array] = [
        _times(frames, *time),
        pa.array(frames),
        _dictionary(owner, [group.object_id for group in groups]),
        pa.array(orders.astype(np.int16), mask=orders < 0),
        pa.array(present),
        pa.array(sizes.astype(np.int16), mask=sizes <= 0),
        _dictionary(codes, book.codes),
        _dictionary(codes, book.texts).dictionary_decode()
        if any(book.texts)
        else pa.nulls(len(rows), pa.string()),
        pa.array(texts, pa.string()),
        *(pa.array(np.ascontiguousarray(values[:, i]), from_pandas=True) for i in range(values.shape[1])),
    ]
    return pa.RecordBatch.from_arrays(columns, schema=schema.arrow)


def _dictionary(numbers: NDArray[np.int32], values: Sequence[str | None]) -> pa.DictionaryArray:
    return pa.DictionaryArray.from_arrays(
        pa.array(numbers, pa.int32(), mask=numbers < 0), pa.array(values, pa.string())
    )


def _times(frames: NDArray[np.int32], clock: Clock, n_frames: int) -> pa.Array:
    if clock.t_ns(0, n_frames) is None:
        return pa.nulls(len(frames), pa.int64())
    distinct, back = np.unique(frames, return_inverse=True)
    return pa.array(np.array([clock.t_ns(frame, n_frames) for frame in distinct.tolist()], np.int64)[back])
