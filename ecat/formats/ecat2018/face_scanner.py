"""Runs of marker faces, taken out of the byte stream before the XML parser sees them.

Nine tenths of a Kinect session's file are faces in one fixed layout, and reading that layout as such
(:mod:`ecat.formats.ecat2018.face_markup`) is many times faster than parsing it.  Only what has ECAT's layout
exactly, directly inside a marker list, is taken; everything else, and everything from the first comment, CDATA
section, processing instruction or entity on, goes to the parser.  It gets line ends in place of what was
taken, so that line numbers stay true.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from ecat.formats.ecat2018.face_markup import Run, read_markers

_WS = rb"\r?\n *"
_LIST = re.compile(
    rb"<markers(3d)?>" + _WS + rb'(?=<marker (?:type="LOCATION" )?frame="[0-9]{1,9}" glyphSize="[0-9]{1,2}">)'
)
_END = b"</marker>"
_LONGEST_LIST_START = 512
_LONGEST_MARKER = 1 << 16


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
                self._line += _count_lines(out)
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
        return b"\n" * _count_lines(whole)

    def _take_all(self, whole: bytes) -> int | None:
        """Hand over complete markers; or only say how many there are before one that is laid out in another way."""
        if not whole:
            return None
        run = read_markers(whole, self._dimensions, self._line)
        if isinstance(run, int):
            return run
        self._take(self._dimensions, run)
        return None


def _count_lines(text: bytes) -> int:
    # bytes.count() takes six times as long where lines are short
    return int(np.count_nonzero(np.frombuffer(text, np.uint8) == ord("\n")))


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
