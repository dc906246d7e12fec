"""Runs of marker faces, taken out of the byte stream before the XML parser sees them.

Nine tenths of a Kinect session's file are faces in one fixed layout, and cutting that layout at its tags is
several times faster than parsing it.  Whatever stands between two numbers or two codes occurs again and
again, so that each such text is checked once and then looked up.  Only what has ECAT's layout exactly,
directly inside a marker list, is taken; everything else, and everything from the first comment, CDATA
section, processing instruction or entity on, goes to the parser.  It gets line ends in place of what was
taken, so that line numbers stay true.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import accumulate, chain, pairwise

import numpy as np

_WS = rb"\r?\n *"
_LIST = re.compile(
    rb"<markers(3d)?>" + _WS + rb'(?=<marker (?:type="LOCATION" )?frame="[0-9]{1,9}" glyphSize="[0-9]{1,2}">)'
)
_HEAD = {
    2: re.compile(rb"(?:" + _WS + rb')?<marker type="LOCATION"'),
    3: re.compile(rb"(?:" + _WS + rb")?<marker"),
}
_SIZE = re.compile(rb' glyphSize="([0-9]{1,2})">' + _WS + rb"<face>" + _WS)
_CODE = rb"/bounding>" + _WS + rb"<code>([^<]+)</code>" + _WS + rb"</face>" + _WS
_INNER = re.compile(_CODE + rb"<face>" + _WS)
_LAST = re.compile(_CODE)
_END = b"</marker>"
_LONGEST_LIST_START = 512
_LONGEST_MARKER = 1 << 16
_MOST_KNOWN = _LONGEST_KNOWN = 4096


@dataclass
class Run:
    """Markers that follow each other.

    Per marker its ``frames``, ``sizes`` (cells along a side, 0 if unknown) and ``counts`` (number of faces);
    per face the texts of its ``corners`` and its ``codes``, where a marker without faces has one empty text
    in each. ``line(i)`` is the line of face ``i`` of the run, found only when an error needs it.
    """

    line: Callable[[int], int]
    frames: Sequence[int]
    sizes: Sequence[int]
    counts: Sequence[int]
    corners: Sequence[bytes]
    codes: Sequence[bytes]


def join_runs(runs: Sequence[Run]) -> Run:
    """Runs that follow each other as one."""
    if len(runs) == 1:
        return runs[0]
    starts = [0, *accumulate(len(run.corners) for run in runs)]

    def line(i: int) -> int:
        k = bisect_right(starts, i) - 1
        return runs[k].line(i - starts[k])

    names = ("frames", "sizes", "counts", "corners", "codes")
    return Run(line, *(list(chain.from_iterable(getattr(run, name) for run in runs)) for name in names))


class _Known(dict[bytes, bytes | None]):
    """Texts met so far and what stands in them, or ``None`` for those that are not of the layout."""

    def __init__(self, layout: re.Pattern[bytes]) -> None:
        super().__init__()
        self._layout = layout

    def __missing__(self, text: bytes) -> bytes | None:
        found = self._layout.fullmatch(text)
        value = None if found is None else found.group(self._layout.groups)
        if len(self) < _MOST_KNOWN and len(text) < _LONGEST_KNOWN:
            self[text] = value
        return value


class FaceScanner:
    """Cuts markers with faces out of a document that comes in pieces.

    Parameters
    ----------
    take : called with the number of dimensions (2 or 3) and a run of markers, in file order, before the
    parser is fed what
        follows them.
    """

    def __init__(self, take: Callable[[int, Run], None]) -> None:
        self._take = take
        self._buffer = b""
        self._start = 0  # of what was not passed on yet
        self._line = 1
        self._dimensions = 0  # of the list that the buffer starts in; 0 outside of lists
        self._off = False
        self._heads = {dimensions: _Known(layout) for dimensions, layout in _HEAD.items()}
        self._sizes = _Known(_SIZE)
        self._inner = _Known(_INNER)
        self._last = _Known(_LAST)

    def cut(self, pieces: Iterable[bytes]) -> Iterator[bytes]:
        """The document without the faces that were taken."""
        before = b""
        for piece in pieces:
            # the document's own `<?xml` hides nothing
            start = 2 if not before and piece.startswith(b"<?xml") else 0
            self._off = self._off or _may_hide_faces(before, piece[start:] if start else piece)
            before = piece[-1:] or before
            rest = self._buffer[self._start :]
            self._buffer, self._start = rest + piece if rest else piece, 0
            while not self._off and (out := self._step()) is not None:
                self._line += out.count(b"\n")
                yield out
            if self._off:
                yield self._pass(len(self._buffer))
        self._off = True
        yield self._pass(len(self._buffer))

    def _pass(self, end: int) -> bytes:
        out = self._buffer[self._start : end]
        self._start = end
        return out

    def _step(self) -> bytes | None:
        """What the parser may have now; None when more of the document is needed first."""
        if self._dimensions:
            return self._inside()
        if start := _LIST.search(self._buffer, self._start):
            self._dimensions = 3 if start.group(1) else 2
            return self._pass(start.end())
        end = len(self._buffer) - _LONGEST_LIST_START
        return self._pass(end) if end > self._start else None

    def _inside(self) -> bytes | None:
        buffer, start = self._buffer, self._start
        stop = buffer.find(b"</markers", start)
        end = buffer.rfind(_END, start, stop if stop >= 0 else len(buffer))
        whole = buffer[start : end + len(_END)] if end >= 0 else b""
        ends_here = stop >= 0
        while (n_good := self._take_all(whole)) is not None:
            # the first marker that is laid out in another way ends what can be taken
            ends_here = True
            whole = b"".join(text + _END for text in whole.split(_END)[:n_good])
        self._start = start + len(whole)
        rest = buffer[self._start : self._start + _LONGEST_MARKER]
        if ends_here or len(rest) == _LONGEST_MARKER or not _may_start_marker(rest):
            self._dimensions = 0  # the list ends here, or goes on in another form
        elif not whole:
            return None
        return b"\n" * whole.count(b"\n")

    def _take_all(self, whole: bytes) -> int | None:
        """Hand over complete markers; or only say how many there are before one that is laid out in another way."""
        head, *faces = whole.split(b"<bounding>")
        inner, last = self._inner, self._last
        corners: list[bytes] = []
        codes: list[bytes] = []
        starts, ends = [head], [0]
        # loops, not comprehensions: tuples that live on would have the garbage collector look through everything
        for face in faces:
            points, _, after = face.partition(b"<")
            code, end, start = after.partition(_END)
            cells = last[code] if end else inner[code]
            if cells is None:
                return len(ends) - 1
            corners.append(points)
            codes.append(cells)
            if end:
                ends.append(len(corners))
                starts.append(start)
        rest = starts.pop()  # what follows the last end tag
        frames, sizes = self._heads_of(starts)
        if rest or len(frames) < len(starts):
            return len(frames)
        if frames:
            first_line, lines = self._line, _lines_of_faces(whole)
            counts = [b - a for a, b in pairwise(ends)]
            self._take(
                self._dimensions, Run(lambda i: first_line + lines(i), frames, sizes, counts, corners, codes)
            )
        return None

    def _heads_of(self, texts: list[bytes]) -> tuple[list[int], list[int]]:
        """Frames and sizes of the markers that start with ``texts``, up to one that is laid out in another way."""
        known, known_sizes = self._heads[self._dimensions], self._sizes
        frames: list[int] = []
        sizes: list[int] = []
        for text in texts:
            start, _, after = text.partition(b' frame="')
            frame, _, kind = after.partition(b'"')
            size = known_sizes[kind]
            if size is None or known[start] is None or not frame.isdigit() or len(frame) > 9:
                break
            frames.append(int(frame))
            sizes.append(int(size))
        return frames, sizes


def _may_hide_faces(before: bytes, piece: bytes) -> bool:
    """Whether markup starts in ``piece`` that could hide faces from a parser, or entities that stand for some."""
    if b"&" in piece:
        return True
    # one byte is found much faster than two
    return any(byte in piece and b"<" + byte in before + piece for byte in (b"!", b"?"))


def _may_start_marker(rest: bytes) -> bool:
    """Whether what follows an end tag may be, or become, another marker."""
    rest = rest.lstrip(b"\r\n ")
    return rest.startswith(b"<marker ") or b"<marker ".startswith(rest)


def _lines_of_faces(markers: bytes) -> Callable[[int], int]:
    """Line ends before each face, counted when the first is asked for."""

    @cache
    def lines() -> list[int]:
        ends = np.flatnonzero(np.frombuffer(markers, np.uint8) == ord("\n"))
        return np.searchsorted(ends, [face.start() for face in re.finditer(b"<face>", markers)]).tolist()

    return lambda i: lines()[i]
