"""Runs of marker faces, taken out of the byte stream before the XML parser sees them.

Nine tenths of a Kinect session's file are faces in one fixed layout.  A regular expression reads them several times faster
than a parser can.  Only what matches that layout exactly, directly inside a marker list, is taken; everything else, and
everything from the first comment, CDATA section or entity on, goes to the parser, which gets line ends in place of what was taken so
that line numbers stay true.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

_WS = rb"\r?\n *"  # single-character classes match several times faster than sets
_FACE = re.compile(
    rb'(?:<marker (type="LOCATION" )?frame="([0-9]{1,9})" glyphSize="([0-9]{1,2})">' + _WS + rb")?"
    rb"<face>" + _WS + rb"<bounding>([^<]+)</bounding>" + _WS + rb"<code>([^<]+)</code>" + _WS
    # the marker ends, or a face follows
    + rb"</face>" + _WS + rb"(</marker>" + _WS + rb"(?=<))?"
)
_LIST = re.compile(
    rb"<markers(3d)?>" + _WS + rb'(?=<marker (?:type="LOCATION" )?frame="[0-9]{1,9}" glyphSize="[0-9]{1,2}">)'
)
_LONGEST_LIST_START = 512
_LONGEST_MARKER = 1 << 16

@dataclass
class Run:
    """Markers that follow each other: per marker its frame, glyph size and number of faces; per face its texts.

    ``line(i)`` is the line of marker ``i``, found only when an error needs it.
    """

    frames: list[int]
    sizes: list[int]
    counts: list[int]
    corners: list[bytes]
    codes: list[bytes]
    line: Callable[[int], int]


class FaceScanner:
    """Cuts markers with faces out of a document that comes in pieces.

    Parameters
    ----------
    take : called with the number of dimensions (2 or 3) and a run of markers, in file order, before the parser is fed what
        follows them.
    """

    def __init__(self, take: Callable[[int, Run], None]) -> None:
        self._take = take
        self._buffer = b""
        self._line = 1
        self._dimensions = 0  # of the list that the buffer starts in; 0 outside of lists
        self._off = False

    def cut(self, pieces: Iterable[bytes]) -> Iterator[bytes]:
        """The document without the faces that were taken."""
        for piece in pieces:
            # markup that could hide faces from a parser ends the search; the document's own `<?xml` does not
            skip = 2 if piece.startswith(b"<?xml") else 0
            self._off = self._off or b"<!" in piece or b"&" in piece or piece.find(b"<?", skip) >= 0
            self._buffer += piece
            while not self._off and (out := self._step()) is not None:
                self._line += out.count(b"\n")
                yield out
            if self._off:
                yield self._pass(len(self._buffer))
        self._off = True
        yield self._pass(len(self._buffer))

    def _pass(self, length: int) -> bytes:
        out, self._buffer = self._buffer[:length], self._buffer[length:]
        return out

    def _step(self) -> bytes | None:
        """What the parser may have now; None when more of the document is needed first."""
        if self._dimensions:
            return self._inside()
        if start := _LIST.search(self._buffer):
            self._dimensions = 3 if start.group(1) else 2
            return self._pass(start.end())
        length = len(self._buffer) - _LONGEST_LIST_START
        return self._pass(length) if length > 0 else None

    def _inside(self) -> bytes | None:
        buffer, dimensions = self._buffer, self._dimensions
        run, end = self._run(buffer, self._line)
        rest = len(buffer) - end
        if rest > _LONGEST_MARKER or (rest > len(b"<marker ") and not buffer.startswith(b"<marker ", end)):
            self._dimensions = 0  # the list ends here, or goes on in another form
        elif not end:
            return None
        if end:
            self._take(dimensions, run)
        self._buffer = buffer[end:]
        return b"\n" * buffer.count(b"\n", 0, end)

    def _run(self, buffer: bytes, line: int) -> tuple[Run, int]:
        """The complete markers at the start of ``buffer`` and where they end."""
        wanted = None if self._dimensions == 3 else b'type="LOCATION" '  # noqa: PLR2004
        frames: list[bytes] = []
        sizes: list[bytes] = []
        starts: list[int] = []
        ends = [0]
        corners: list[bytes] = []
        codes: list[bytes] = []
        position = end = 0
        is_open = False
        for found in _FACE.finditer(buffer):
            kind, frame, size, corner, code, close = found.groups()
            if found.start() != position or (frame is None) != is_open or (kind != wanted and not is_open):
                break
            if not is_open:
                frames.append(frame)
                sizes.append(size)
                starts.append(position)
            corners.append(corner)
            codes.append(code)
            position = found.end()
            is_open = close is None
            if not is_open:
                ends.append(len(corners))
                end = position
        n, faces = len(ends) - 1, ends[-1]
        return Run(
            [int(frame) for frame in frames[:n]],
            [int(size) for size in sizes[:n]],
            [b - a for a, b in pairwise(ends)],
            corners[:faces],
            codes[:faces],
            lambda i: line + buffer.count(b"\n", 0, starts[i]),
        ), end
