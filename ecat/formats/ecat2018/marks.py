"""Marker faces of glyph boxes: from the texts of ``files.param`` to numbers.

A session has tens of thousands of faces, so texts are turned into numbers by Arrow, a run at a time.  Corners
keep the order of the file (ECAT 2018 file format §1.2.4: the 2-D and the 3-D list of a face start at
different corners, and the code is oriented by a third rule); codes are as read from the mirrored image.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.errors import FormatError
from ecat.formats.ecat2018.face_markup import Run, join_runs
from ecat.formats.ecat2018.lexical import (
    USUAL_LINES,
    USUAL_NUMBERS,
    format_code,
    missing_corners,
    parse_code,
)
from ecat.formats.ecat2018.number_text import parse_float_lines, parse_floats

KINECT_TO_CAMERA = np.array([-1.0, -1.0, 1.0])
"""Kinect camera space (x to the sensor's left, y up) to ``camera/depth``; its own inverse."""
_BATCH_FACES = 8192  # each batch costs Arrow a millisecond to begin with

Place = Callable[[int], str]
"""Where face ``i`` of a run stands, for errors."""


class CodeBook:
    """The codes met in a session; a few dozen texts stand for tens of thousands of faces."""

    def __init__(self) -> None:
        self.codes: list[str | None] = []
        self.texts: list[str | None] = []
        self._known: dict[int, dict[bytes, int]] = {}

    def of_size(self, size: int) -> dict[bytes, int]:
        """The positions of the texts with ``size`` times ``size`` cells."""
        return self._known.setdefault(size, {})

    def learn(self, text: bytes, size: int) -> int:
        """The position of a code text, or -1 if it is not ``size`` times ``size`` cells."""
        plain = plain_text(text)
        code = parse_code(plain)
        if code is None or len(code) != size * size:
            return -1
        number = self.of_size(size)[text] = len(self.codes)
        self.codes.append(code)
        self.texts.append(None if plain == format_code(code) else plain)
        return number

    def keep(self, text: bytes) -> int:
        """The position of a text that is no code: kept as it is."""
        self.codes.append(None)
        self.texts.append(plain_text(text))
        return len(self.codes) - 1


def plain_text(text: bytes) -> str:
    """Text of the document as a parser gives it: with line feeds only."""
    return text.decode("utf-8", "replace").replace("\r\n", "\n").replace("\r", "\n")


@dataclass(slots=True)
class FaceColumns:
    """Faces in file order, a row each; a marker without faces is a row without order, code and corners (-1, -1, NaN).

    ``codes`` are positions in the session's `CodeBook`; ``corners`` is (n, 4 * dimensions), pixels or metres in
    ``camera/depth``, NaN where missing.
    """

    frames: NDArray[np.int32]
    orders: NDArray[np.int32]
    sizes: NDArray[np.int32]
    codes: NDArray[np.int32]
    corners: NDArray[np.float64]

    def take(self, rows: NDArray[np.intp]) -> FaceColumns:
        """The rows at these positions."""
        return FaceColumns(
            self.frames[rows], self.orders[rows], self.sizes[rows], self.codes[rows], self.corners[rows]
        )


@dataclass(frozen=True, slots=True)
class _Texts:
    """Texts of which many are alike: the ``distinct`` ones, and for each text its position among them."""

    distinct: list[bytes]
    index: NDArray[np.int32]

    @classmethod
    def of(cls, texts: Any) -> _Texts:
        return cls(texts.dictionary.to_pylist(), texts.indices.to_numpy())

    def __getitem__(self, i: int) -> bytes:
        return self.distinct[self.index[i]]


@dataclass
class Faces:
    """The faces of one object in one of its two lists, as they come.

    ``what`` is an error's first line; ``skip_bad`` keeps a face that cannot be read without what cannot be
    read, and says so in ``findings``.  ``object_id`` is set when the object's end is met.  By position of the
    row: ``absent``, and the ``corner_texts`` that are not as their numbers would be written.
    """

    dimensions: int
    what: str
    book: CodeBook
    skip_bad: bool = False
    findings: list[str] = field(default_factory=list[str])
    object_id: str = ""
    absent: set[int] = field(default_factory=set[int])
    corner_texts: dict[int, str] = field(default_factory=dict[int, str])
    _waiting: list[Run] = field(default_factory=list[Run])
    _n_waiting: int = 0
    _parts: list[FaceColumns] = field(default_factory=list[FaceColumns])
    _n_done: int = 0

    def __len__(self) -> int:
        return self._n_done + self._n_waiting

    @property
    def width(self) -> int:
        """Numbers in one face's corner list."""
        return 4 * self.dimensions

    def columns(self) -> FaceColumns:
        """All faces.

        Raises
        ------
        FormatError : a face cannot be read, and is not to be skipped.
        """
        self._convert()
        if len(self._parts) != 1:
            parts = self._parts

            def joined(name: str) -> NDArray[np.int32]:
                return np.concatenate([np.empty(0, np.int32), *(getattr(part, name) for part in parts)])

            corners = np.concatenate([np.empty((0, self.width)), *(part.corners for part in parts)])
            integers = joined("frames"), joined("orders"), joined("sizes"), joined("codes")
            self._parts = [FaceColumns(*integers, corners)]
        return self._parts[0]

    def add(self, run: Run) -> None:
        """Add a run of markers.  Runs are turned into numbers many at a time; errors as in `columns`."""
        self._waiting.append(run)
        self._n_waiting += len(run.corners)
        if self._n_waiting >= _BATCH_FACES:
            self._convert()

    def _convert(self) -> None:
        if not self._waiting:
            return
        run = join_runs(self._waiting)
        self._waiting, self._n_waiting = [], 0
        rows = np.maximum(run.counts, 1)
        starts = np.cumsum(rows) - rows
        orders = np.arange(rows.sum(), dtype=np.int32) - np.repeat(starts, rows).astype(np.int32)
        orders[starts[run.counts == 0]] = -1
        frames, sizes = np.repeat(run.frames, rows), np.repeat(run.sizes, rows)

        def place(i: int) -> str:
            marker = int(np.searchsorted(starts, i, side="right")) - 1
            return f"line {run.line(i)}, <face> {orders[i] + 1} of frame {run.frames[marker]}"

        codes = self._codes(_Texts.of(run.codes), sizes, orders, place)
        corners = self._corners(_Texts.of(run.corners), orders, place)
        self._parts.append(FaceColumns(frames, orders, sizes, codes, corners))
        self._n_done += len(orders)

    def _codes(
        self, texts: _Texts, sizes: NDArray[np.int32], orders: NDArray[np.int32], place: Place
    ) -> NDArray[np.int32]:
        numbers = np.full(len(sizes), -1, np.int32)
        for size in np.unique(sizes).tolist():  # one, in every real file
            known = self.book.of_size(size)
            for text in texts.distinct:
                if text not in known:
                    self.book.learn(text, size)
            of_text = np.array([known.get(text, -1) for text in texts.distinct], np.int32)
            numbers = np.where(sizes == size, of_text[texts.index], numbers)
        for i in np.flatnonzero((numbers < 0) & (orders >= 0)).tolist():
            numbers[i] = self._code(texts[i], int(sizes[i]), i, place)
        return np.where(orders >= 0, numbers, -1).astype(np.int32)

    def _code(self, text: bytes, size: int, i: int, place: Place) -> int:
        known = self.book.of_size(size).get(text)
        if known is not None:
            return known
        number = self.book.learn(text, size)
        if number < 0:
            found = text.count(b",") + bool(text)
            self.bad(f"{place(i)}: expected {size * size} cells of 0 or 1 in <code>, found {found}")
            number = self.book.keep(text)
        return number

    def _corners(self, texts: _Texts, orders: NDArray[np.int32], place: Place) -> NDArray[np.float64]:
        lines, index = b"\n".join(texts.distinct), texts.index
        values = parse_float_lines(lines, self.width)
        if values is not None and len(values) == len(texts.distinct):
            unusual = _unusual([lines], USUAL_LINES).repeat(len(values))
            if unusual.any():
                unusual = _unusual(texts.distinct, USUAL_NUMBERS)
        else:
            rows = [
                self._row(texts[i], i, place) if orders[i] >= 0 else self._missing()
                for i in range(len(orders))
            ]
            values = np.array(rows).reshape(len(rows), self.width)
            unusual, index = _unusual(texts.distinct, USUAL_NUMBERS)[index], np.arange(len(rows))
        if self.dimensions == 2:
            missing = ~np.isfinite(values)
            unusual |= missing.any(axis=1)
        else:
            points, otherwise = missing_corners(values.reshape(-1, 4, 3))
            missing, unusual = points.repeat(3, axis=1), unusual | otherwise
            values *= np.tile(KINECT_TO_CAMERA, 4)
        values[missing] = np.nan
        for i in np.flatnonzero(unusual[index] & (orders >= 0)).tolist():
            self.corner_texts[self._n_done + i] = plain_text(texts[i])
        return values[index]

    def _missing(self) -> NDArray[np.float64]:
        return np.full(self.width, np.nan)

    def _row(self, text: bytes, i: int, place: Place) -> NDArray[np.float64]:
        try:
            return parse_floats(plain_text(text), self.width)
        except FormatError as error:
            self.bad(f"{place(i)}: {error.where}")
            return self._missing()

    def put_in_order(self) -> bool:
        """Sort markers by frame and keep the last of each frame, as ECAT does; whether anything had to change."""
        now = self.columns()
        starts = np.flatnonzero(now.orders <= 0)
        frames = now.frames[starts].astype(np.int64)
        if (np.diff(frames) > 0).all():
            return False
        marker = np.cumsum(now.orders <= 0) - 1
        _, first_from_end = np.unique(frames[::-1], return_index=True)
        last = np.zeros(len(frames), bool)
        last[len(frames) - 1 - first_from_end] = True
        rows = np.flatnonzero(last[marker])
        rows = rows[np.argsort(now.frames[rows], kind="stable")]
        new = {int(old): i for i, old in enumerate(rows)}
        self.absent = {new[i] for i in self.absent if i in new}
        self.corner_texts = {new[i]: text for i, text in self.corner_texts.items() if i in new}
        self._parts, self._n_done = [now.take(rows)], len(rows)
        return True

    def bad(self, where: str) -> None:
        """Refuse a bad face, or note it if bad faces are to be skipped."""
        refuse_marker(self.what, where, skip=self.skip_bad, findings=self.findings)


def _unusual(texts: Sequence[bytes], usual: str) -> NDArray[np.bool_]:
    """Which of the texts do not match the pattern."""
    return ~np.asarray(pc.match_substring_regex(pa.array(texts, pa.binary()), usual))


def refuse_marker(what: str, where: str, *, skip: bool, findings: list[str]) -> None:
    """Refuse a marker that cannot be read, or note it if such markers are to be skipped.

    Raises
    ------
    FormatError : they are not to be skipped.
    """
    if not skip:
        raise FormatError(
            what,
            where=where,
            consequence="the rest of the session was not imported; nothing was written",
            fix="ecat import --skip-bad-markers ...",
        )
    findings.append(f"{where}; the marker was kept without the bad values")
