"""Markers with faces in ECAT's layout, from bytes to arrays.

A marker is a row of tags with fixed texts between them, so the tags of a whole list are found, told apart and
compared at once, in NumPy; only the first of each kind is matched against a pattern.  What differs from that
first one by a single byte is not taken.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import accumulate
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.formats.ecat2018.spans import spans, values_of

_WS = rb"\r?\n *"
_BLANK = re.compile(rb"(?:" + _WS + rb")?")
_HEAD = {
    2: re.compile(rb'<marker type="LOCATION" frame="([0-9]{1,9})" glyphSize="([0-9]{1,2})">' + _WS),
    3: re.compile(rb'<marker frame="([0-9]{1,9})" glyphSize="([0-9]{1,2})">' + _WS),
}
_FIRST = re.compile(rb"[^<]*<marker [^<]*<face>" + _WS + b"<bounding>")
_TAGS = (
    b"<marker",
    b"<face>",
    b"<bounding>",
    b"</bounding>",
    b"<code>",
    b"</code>",
    b"</face>",
    b"</marker>",
)
_MARKER, _FACE, _BOUNDING, _BOUNDING_END, _CODE, _CODE_END, _FACE_END, _MARKER_END = range(len(_TAGS))
_NEXT = [_FACE, _BOUNDING, _BOUNDING_END, _CODE, _CODE_END, _FACE_END, _FACE, _MARKER]
_MOST_DIGITS = 9
_PADDING = b"\0" * 256
_UNKNOWN = 15
_WORD = 8


def _in_turn(*kinds: int) -> re.Pattern[bytes]:
    return re.compile(_WS.join(_TAGS[kind] for kind in kinds))


_TO_CODE = _in_turn(_BOUNDING_END, _CODE)
_TO_NEXT_FACE = _in_turn(_CODE_END, _FACE_END, _FACE, _BOUNDING)
_TO_END = _in_turn(_CODE_END, _FACE_END, _MARKER_END)


@dataclass
class Run:
    """Markers that follow each other.

    Per marker its ``frames``, ``sizes`` (cells along a side, 0 if unknown) and ``counts`` (number of faces),
    int32; per face the texts of its ``corners`` and its ``codes``, dictionaries of binary, where a
    marker without faces has one empty text in each. ``line(i)`` is the line of face ``i`` of the run, found only
    when an error needs it.
    """

    line: Callable[[int], int]
    frames: NDArray[np.int32]
    sizes: NDArray[np.int32]
    counts: NDArray[np.int32]
    corners: pa.Array[Any]
    codes: pa.Array[Any]


def join_runs(runs: Sequence[Run]) -> Run:
    """Runs that follow each other as one."""
    if len(runs) == 1:
        return runs[0]
    starts = [0, *accumulate(len(run.corners) for run in runs)]

    def line(i: int) -> int:
        k = bisect_right(starts, i) - 1
        return runs[k].line(i - starts[k])

    return Run(
        line,
        np.concatenate([run.frames for run in runs]),
        np.concatenate([run.sizes for run in runs]),
        np.concatenate([run.counts for run in runs]),
        pa.concat_arrays([run.corners for run in runs]),
        pa.concat_arrays([run.codes for run in runs]),
    )


def read_markers(markup: bytes, dimensions: int, first_line: int) -> Run | int:
    """The markers that ``markup`` consists of, the last tag of which is ``</marker>``.

    Where one is laid out in another way, only the number of markers before it.
    """
    if not _FIRST.match(markup):
        return 0
    tags = _Tags(markup)
    head = _HEAD[dimensions].match(markup, int(tags.at[0]))
    if head is None or not _BLANK.fullmatch(markup, 0, head.start()):
        return 0
    tags.compare()
    heads = np.flatnonzero(tags.kinds == _MARKER)
    frames = tags.numbers(heads, head)
    if not tags.good.all():
        first_bad = int(np.argmin(tags.good))
        return int(np.count_nonzero(tags.kinds[:first_bad] == _MARKER_END))
    sizes = np.full(len(heads), int(head.group(2)), np.int32)
    counts = ((np.diff(heads, append=len(tags.at)) - 2) // 6).astype(np.int32)
    lines = _lines_of_faces(markup)
    corners, codes = tags.contents(_BOUNDING), tags.contents(_CODE)
    return Run(lambda i: first_line + lines(i), frames, sizes, counts, corners, codes)


class _Tags:
    """The tags of some markup: where each is, of which kind, and whether it and what follows it are good."""

    def __init__(self, markup: bytes) -> None:
        self._markup = markup
        self._padded = markup + _PADDING
        data = np.frombuffer(self._padded, np.uint8)
        self.at = np.flatnonzero(data[: len(markup)] == ord("<"))
        letter, second = data[self.at + 1], data[self.at + 2]
        closing = letter == ord("/")
        self.kinds = _KIND_OF[np.where(closing, second | 0x80, letter)]
        following = np.append(self.kinds[1:], np.uint8(_MARKER))
        self._is_last = (self.kinds == _FACE_END) & (following == _MARKER_END)
        self.good = (_FOLLOWS[self.kinds] == following) | self._is_last

    def compare(self) -> None:
        """Compare what stands between two texts with the layout, and with the first of its kind."""
        codes = np.flatnonzero(self.kinds == _CODE_END)
        last = self._is_last[np.minimum(codes + 1, len(self.at) - 1)]
        self._compare(np.flatnonzero(self.kinds == _BOUNDING_END), _TO_CODE)
        self._compare(codes[~last], _TO_NEXT_FACE)
        self._compare(codes[last], _TO_END)
        # a code has to be there, corners are missed when they are read
        self.good[codes] &= self.at[codes] - self.at[codes - 1] > len(_TAGS[_CODE])

    def _compare(self, tags: NDArray[np.intp], layout: re.Pattern[bytes]) -> None:
        if len(tags):
            first = layout.match(self._markup, int(self.at[tags[0]]))
            self.good[tags] &= first is not None and self._same(self.at[tags], first.group())

    def numbers(self, heads: NDArray[np.intp], first: re.Match[bytes]) -> NDArray[np.int32]:
        """The frame numbers in ``heads``, which have to be like the ``first`` but for the number."""
        markup, at = self._markup, self.at
        before = markup[first.start() : first.start(1)]
        if len(heads) > 1:
            blank = markup[int(at[heads[1] - 1]) + len(_TAGS[_MARKER_END]) : int(at[heads[1]])]
            gap = _TAGS[_MARKER_END] + blank
            self.good[heads[1:]] &= _BLANK.fullmatch(blank) is not None and self._same(
                at[heads[1:]] - len(gap), gap
            )
        after = markup[first.end(1) : int(at[heads[0] + 2]) + len(_TAGS[_BOUNDING])]
        tail = int(at[heads[0] + 1]) - first.end(1)
        starts, ends = at[heads] + len(before), at[np.minimum(heads + 1, len(at) - 1)] - tail
        n_digits = ends - starts
        self.good[heads] &= (n_digits >= 1) & (n_digits <= _MOST_DIGITS)
        self.good[heads] &= self._same(at[heads], before) & self._same(ends, after)
        numbers = np.zeros(len(heads), np.int32)
        for n in range(1, _MOST_DIGITS + 1):
            rows = np.flatnonzero(n_digits == n)
            if len(rows):
                digits = self._windows(n)[starts[rows]].view(np.uint8).reshape(-1, n) - np.uint8(ord("0"))
                self.good[heads[rows]] &= (digits < 10).all(axis=1)
                numbers[rows] = digits @ (10 ** np.arange(n - 1, -1, -1, dtype=np.int32))
        return numbers

    def contents(self, kind: int) -> pa.Array[Any]:
        """The text behind each tag of a kind."""
        found = np.flatnonzero(self.kinds == kind)
        starts, ends = self.at[found] + len(_TAGS[kind]), self.at[found + 1]
        texts: Any = spans(self._markup, starts, ends, pa.binary()).dictionary_encode()
        index: Any = pa.array(values_of(texts.indices, np.int32))
        return pa.DictionaryArray.from_arrays(index, texts.dictionary)

    def _same(self, places: NDArray[np.intp], text: bytes) -> NDArray[np.bool_]:
        """Whether ``text`` stands at each of these places; eight bytes are compared at a time."""
        n_words = -(-len(text) // _WORD)
        size = n_words * _WORD
        if size > len(_PADDING):
            return np.zeros(len(places), bool)
        found = self._windows(size)[places].view(np.uint64).reshape(-1, n_words)
        wanted = np.frombuffer(text.ljust(size, b"\0"), np.uint64)
        mask = np.frombuffer((b"\xff" * len(text)).ljust(size, b"\0"), np.uint64)
        good = found[:, -1] & mask[-1] == wanted[-1]
        for i in range(n_words - 1):
            good &= found[:, i] == wanted[i]
        return good

    def _windows(self, size: int) -> NDArray[np.void]:
        """The bytes from each place on, ``size`` of them."""
        return np.ndarray(len(self._padded) - size + 1, f"V{size}", self._padded, strides=(1,))


def _kind_of() -> NDArray[np.uint8]:
    """The kind of a tag by its first letter, that of an end tag by the letter with its highest bit set."""
    kinds = np.full(256, _UNKNOWN, np.uint8)
    for kind, tag in enumerate(_TAGS):
        kinds[tag[2] | 0x80 if tag[1:2] == b"/" else tag[1]] = kind
    return kinds


_KIND_OF = _kind_of()
_FOLLOWS = np.array([*_NEXT, *[_UNKNOWN + 1] * (_UNKNOWN + 1 - len(_NEXT))], np.uint8)
"""The kind that has to follow a kind."""


def _lines_of_faces(markup: bytes) -> Callable[[int], int]:
    """Line ends before each face, counted when the first is asked for."""

    @cache
    def lines() -> list[int]:
        ends = np.flatnonzero(np.frombuffer(markup, np.uint8) == ord("\n"))
        return np.searchsorted(ends, [face.start() for face in re.finditer(b"<face>", markup)]).tolist()

    return lambda i: lines()[i]
