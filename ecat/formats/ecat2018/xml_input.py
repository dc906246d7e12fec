"""The one safe way to read foreign XML.

Files come from other programs and other people, so a document is taken in piece by piece and refused as soon
as it is dangerous: a document type or entity declaration, an encoding other than UTF-8 (or its subset ASCII),
a NUL byte, nesting deeper than 256, a text or attribute above 10 MB, more live elements than memory should
hold. A refusal is one `FormatError` or `LimitError` that names the line; nothing is fetched from elsewhere.
"""

from __future__ import annotations

import re
import stat
from collections.abc import Callable, Collection, Generator, Iterable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO, Literal, TypeAlias

from lxml import etree

from ecat.errors import EcatError, FormatError, LimitError, os_error

Element: TypeAlias = etree._Element  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]

MAX_DEPTH = 256
MAX_LIVE_ELEMENTS = 2_000_000
"""Elements held at one time: about 0.5 GB, since a tree needs up to thirty times the bytes of its file."""
MAX_LIVE_BYTES = 256 << 20
"""Bytes read since the tree was last empty, and the default size of a document read whole."""

MAX_SIBLINGS = 4096
MAX_SIBLINGS_OF_WHOLE = 100_000
_RECORDS = 1024
MAX_RECORD_TAGS = 1_000_000

_CHUNK_BYTES = 1 << 20
_FED_BYTES = 1 << 18
_BOM = b"\xef\xbb\xbf"
_DECLARED_ENCODING = re.compile(rb"""<\?xml[^>]*?\sencoding\s*=\s*["']([^"'>]*)["']""")
_FORBIDDEN = re.compile(rb"\x00|<!doctype|<!entity", re.IGNORECASE)
_FORBIDDEN_STARTS = (
    b"\x00",
    b"!",
)  # single bytes are found fast, most pieces have neither, and a regex is slow
_FORBIDDEN_OVERLAP = len(b"<!doctype") - 1
_LIMIT_CODES = frozenset({etree.ErrorTypes.ERR_RESOURCE_LIMIT, etree.ErrorTypes.ERR_NAME_TOO_LONG})
_UNFINISHED = re.compile(r"Premature end|not finished|not terminated|Couldn't find end|expected")
_POSITION = re.compile(r",? ?line \d+, column \d+$")


# ---------------------------------------------------------------------------------------------- files


@contextmanager
def open_input(path: Path, what: str) -> Generator[BinaryIO]:
    """Open a regular file for reading; every ``OSError`` inside the block becomes the typed error.

    Devices, pipes and sockets are refused: reading them may never end. ``what`` is an error's first line.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise FormatError(what, where=f"{path}: not a regular file", fix="name the file itself")
        with path.open("rb") as file:
            yield file
    except OSError as error:
        raise os_error(error, what, path) from error


def reading(source: Path | bytes, kind: str) -> str:
    """First line of an error about ``source``; ``kind`` (``the glyph``) stands for it when it has no path."""
    return f"cannot read {source if isinstance(source, Path) else kind}"


def read_input(source: Path | bytes, what: str, max_bytes: int) -> bytes:
    """The whole of a file (or the bytes themselves); `LimitError` above ``max_bytes``."""
    if isinstance(source, bytes):
        data = source
    else:
        with open_input(source, what) as file:
            data = file.read(max_bytes + 1)
    if len(data) > max_bytes:
        raise LimitError(
            what, where=f"more than {max_bytes:,} bytes", fix="check that this is the right file"
        )
    return data


def _chunks(source: Path | bytes, what: str) -> Iterator[bytes]:
    if isinstance(source, bytes):
        for start in range(0, len(source), _CHUNK_BYTES):
            yield source[start : start + _CHUNK_BYTES]
    else:
        with open_input(source, what) as file:
            while chunk := file.read(_CHUNK_BYTES):
                yield chunk


# ---------------------------------------------------------------------------------------------- XML


def iterparse_safe(
    source: Path | bytes, *, tags: Collection[str], what: str, max_bytes: int | None = None
) -> Iterator[Element]:
    """Stream a document: the root once its start tag is read, then every element of ``tags`` at its end.

    A yielded element is complete, but elements of ``tags`` inside it were yielded before it and are emptied. It
    is emptied itself when the next one is asked for. Everything outside the elements of ``tags`` is dropped as
    it is read: memory holds one outermost wanted element, not the document.

    Parameters
    ----------
    source : path of the file, or its bytes.
    tags : names of the wanted elements (``{namespace}name`` where there is one).
    what : first line of an error (``cannot read Session1/files.param``).
    max_bytes : refuse a longer document; None for any length.

    Raises
    ------
    FormatError : empty, malformed or truncated, wrong encoding, document type or entity; names the line. What
        was complete before the fault has been yielded by then.
    LimitError : too long, too deep, too large a text or element.
    StoreError : the file cannot be opened or read.
    """
    wanted = frozenset(tags)
    feed = _Feed(source, what, max_bytes)
    kept: list[int] = []  # per open element: descendants that stay in the tree
    husks: list[Element | None] = []
    live = inside = mark = 0
    for event, element in feed.events():
        if event == "start":
            if not kept:
                yield element
            inside += element.tag in wanted
            kept.append(0)
            husks.append(None)
            live += 1
            if live > MAX_LIVE_ELEMENTS or feed.fed_bytes - mark > MAX_LIVE_BYTES:
                raise LimitError(
                    what,
                    where=f"line {element.sourceline}: an element too large to hold in memory",
                    fix="check that this is the right file",
                )
            continue
        below = kept.pop()
        husks.pop()
        is_wanted = element.tag in wanted
        if is_wanted:
            inside -= 1
            yield element
        if kept and (is_wanted or not inside):
            # The parser may still write behind this element: empty it now, unlink it when a sibling follows.
            element.clear(keep_tail=True)
            husk, husks[-1] = husks[-1], element
            if husk is not None:
                element.getparent().remove(husk)  # pyright: ignore[reportOptionalMemberAccess]
            live -= below + 1
        elif kept:
            kept[-1] += below + 1
        if live == len(kept):
            mark = feed.fed_bytes


def iter_records(
    source: Path | bytes,
    *,
    tags: Collection[str],
    whole: Collection[str],
    what: str,
    max_record_bytes: int = 64 << 20,
    cut: Callable[[Iterable[bytes]], Iterator[bytes]] | None = None,
) -> Iterator[Element]:
    """Stream a document of many small records, fast: each element of ``tags`` at its end, children in place.

    Two to three times faster than `iterparse_safe`, because only the records become Python objects.  A record
    and everything in it is emptied when the next one is asked for.  What lies beside records is kept for a
    look, up to some thousand elements; inside elements of ``whole`` it is kept until their end.  Between two
    records at most ``max_record_bytes`` and a million tags may pass.  ``cut`` may take pieces of the document
    out before the parser sees them (what remains must be well-formed).  Errors as in `iterparse_safe`.
    """
    feed = _Feed(source, what, None, max_record_bytes)
    feed.cut = cut
    for number, element in enumerate(feed.ends(tags)):
        yield element
        element.clear(keep_tail=True)
        husk = element.getprevious()
        if husk is not None and husk.tag in tags:
            # the parser may still write behind this element, never behind the one before it
            element.getparent().remove(husk)  # pyright: ignore[reportOptionalMemberAccess]
        # to count what lies beside it takes as long as that is much; it gets more when a piece of the document is fed
        if feed.record_tags or number % _RECORDS == 0:
            _prune(element, whole, what)
        feed.record_bytes = feed.record_tags = 0


def _prune(element: Element, whole: Collection[str], what: str) -> None:
    """Drop what gathers beside an element and the elements around it."""
    line = [element, *element.iterancestors()]
    inside = max((i for i, node in enumerate(line) if i and node.tag in whole), default=0)
    for i, (node, parent) in enumerate(pairwise(line)):
        crowd = len(parent)
        if i >= inside and crowd > MAX_SIBLINGS:
            del parent[: parent.index(node)]
        elif crowd > MAX_SIBLINGS_OF_WHOLE:
            raise LimitError(
                what,
                where=f"line {parent.sourceline}: more than {MAX_SIBLINGS_OF_WHOLE:,} elements in <{parent.tag}>",
                fix="check that this is the right file",
            )


def parse_safe(source: Path | bytes, *, what: str, max_bytes: int | None = None) -> Element:
    """Read a small document whole and return its root; the same refusals as `iterparse_safe`."""
    root = None
    feed = _Feed(source, what, MAX_LIVE_BYTES if max_bytes is None else max_bytes)
    live = 0
    for event, element in feed.events():
        if root is None:
            root = element
        live += event == "start"
        if live > MAX_LIVE_ELEMENTS:
            raise LimitError(
                what,
                where=f"line {element.sourceline}: more than {MAX_LIVE_ELEMENTS:,} elements",
                fix="check that this is the right file",
            )
    assert root is not None  # a document without a root is malformed
    return root


def required_attribute(element: Element, name: str, *, what: str) -> str:
    """The attribute's value; `FormatError` when it is missing."""
    value = element.get(name)
    if value is None:
        raise FormatError(
            what,
            where=f"{place(element)}: attribute {name} is missing",
            fix="add it, or restore the file from a copy",
        )
    return value


def required_child(element: Element, name: str, *, what: str) -> Element:
    """The first child of that name; `FormatError` when there is none."""
    child = element.find(name)
    if child is None:
        raise FormatError(
            what,
            where=f"{place(element)}: element <{name}> is missing",
            fix="add it, or restore the file from a copy",
        )
    return child


def place(element: Element) -> str:
    """Where an element stands, for errors."""
    return f"line {element.sourceline}, <{element.tag}>"


class _Feed:
    """A document on its way into the parser: what may be fed, and how the parser's complaints are told."""

    def __init__(
        self, source: Path | bytes, what: str, max_bytes: int | None, max_record_bytes: int | None = None
    ) -> None:
        self._source = source
        self._what = what
        self._max_bytes = max_bytes
        self._max_record_bytes = max_record_bytes
        self.fed_bytes = 0
        self.record_bytes = self.record_tags = 0
        self.cut: Callable[[Iterable[bytes]], Iterator[bytes]] | None = None

    def events(self) -> Iterator[tuple[str, Element]]:
        """Start and end of every element in document order; those before a fault come before the error."""
        depth = 0
        for event, element in self._pull(("start", "end"), None):
            depth += 1 if event == "start" else -1
            if depth > MAX_DEPTH:
                raise self._too_deep(element.sourceline)
            yield event, element

    def ends(self, tags: Collection[str]) -> Iterator[Element]:
        """Elements of ``tags`` at their end.  The parser itself limits the depth."""
        return (element for _, element in self._pull(("end",), tuple(tags)))

    def _pull(
        self, events: tuple[Literal["start", "end"], ...], tags: tuple[str, ...] | None
    ) -> Iterator[tuple[str, Element]]:
        parser = etree.XMLPullParser(
            events=events,
            tag=tags,
            encoding="utf-8",
            resolve_entities=False,
            load_dtd=False,
            no_network=True,
            huge_tree=False,
            remove_comments=True,
            remove_pis=True,
        )
        for piece in self._pieces():
            fault = self._feed(parser, piece)
            yield from parser.read_events()
            if fault is not None:
                raise fault

    def _feed(
        self,
        parser: etree.XMLPullParser,
        piece: bytes | None,
    ) -> EcatError | None:
        """Feed one piece (None ends the document); the fault, if it has one."""
        at_end = piece is None
        try:
            parser.close() if piece is None else parser.feed(piece)
        except etree.XMLSyntaxError as error:
            told = parser.feed_error_log.filter_from_errors()
            if error.code == etree.ErrorTypes.ERR_INTERNAL_ERROR and told:
                return self._fault(told[0].type, told[0].message, told[0].line, at_end=at_end)
            return self._fault(error.code, error.msg, error.lineno, at_end=at_end)
        told = parser.feed_error_log.filter_from_errors()
        return self._fault(told[0].type, told[0].message, told[0].line, at_end=at_end) if told else None

    def _pieces(self) -> Iterator[bytes | None]:
        """What to feed the parser, and None at the end."""
        document = self._checked() if self.cut is None else self.cut(self._checked())
        # what is fed at once becomes elements at once
        for piece in (p[i : i + _FED_BYTES] for p in document for i in range(0, len(p), _FED_BYTES)):
            if self._max_record_bytes is not None:
                self.record_bytes += len(piece)
                self.record_tags += piece.count(b"<")
                if self.record_bytes > self._max_record_bytes or self.record_tags > MAX_RECORD_TAGS:
                    raise LimitError(
                        self._what,
                        where=f"{self.record_tags:,} tags and {self.record_bytes:,} bytes in one element",
                        fix="check that this is the right file",
                    )
            yield piece
        yield None

    def _checked(self) -> Iterator[bytes]:
        """The document without its BOM, each piece checked before it is fed."""
        tail = b""
        for chunk in _chunks(self._source, self._what):
            piece = chunk if self.fed_bytes else _check_head(chunk, self._what)
            self.fed_bytes += len(piece)
            if self._max_bytes is not None and self.fed_bytes > self._max_bytes:
                raise LimitError(
                    self._what,
                    where=f"more than {self._max_bytes:,} bytes",
                    fix="check that this is the right file",
                )
            if any(start in piece or start in tail for start in _FORBIDDEN_STARTS):
                window = tail + piece
                if forbidden := _FORBIDDEN.search(window):
                    line = self._line_at(self.fed_bytes - len(window) + forbidden.start())
                    raise _refused(forbidden.group(), line, self._what)
            tail = (tail + piece[-_FORBIDDEN_OVERLAP:])[-_FORBIDDEN_OVERLAP:]
            yield piece
        if not self.fed_bytes:
            raise FormatError(self._what, where="the file is empty", fix="restore it from a copy")

    def _line_at(self, position: int) -> int:
        """The line of a byte, counted when an error needs it (from the start of the document without BOM)."""
        line, rest = 1, position
        for chunk in _chunks(self._source, self._what):
            line += chunk.count(b"\n", 0, max(rest, 0))
            rest -= len(chunk)
        return line

    def _fault(self, code: int, message: str | None, line: int | None, *, at_end: bool) -> EcatError:
        text = _POSITION.sub("", message or "not well-formed XML")
        if "depth" in text:
            return self._too_deep(line)
        if code in _LIMIT_CODES or "too big" in text:
            text = text.partition(", try XML_PARSE_HUGE")[0]
            return LimitError(
                self._what, where=f"line {line}: {text}", fix="check that this is the right file"
            )
        if at_end and _UNFINISHED.search(text):
            text = f"the file ends too early ({text})"
        return FormatError(self._what, where=f"line {line}: {text}", fix="restore the file from a copy")

    def _too_deep(self, line: int | None) -> LimitError:
        return LimitError(
            self._what,
            where=f"line {line}: elements nested deeper than {MAX_DEPTH}",
            fix="check that this is the right file",
        )


def _check_head(head: bytes, what: str) -> bytes:
    """The first piece without its BOM, if it starts a document in UTF-8 or ASCII."""
    if head[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\x00" in head[:4]:
        raise FormatError(
            what, where="line 1: UTF-16 or UTF-32, expected UTF-8", fix="save the file as UTF-8 and try again"
        )
    head = head.removeprefix(_BOM)
    if not head.lstrip(b" \t\r\n").startswith(b"<"):
        raise FormatError(what, where="line 1: not XML, the first character is not <", fix="check the file")
    if declared := _DECLARED_ENCODING.match(head):
        name = declared.group(1).decode("ascii", "replace")
        if name.lower() not in ("utf-8", "utf8", "us-ascii", "ascii"):
            raise FormatError(
                what,
                where=f"line 1: declared encoding {name[:40]!r}, expected UTF-8",
                fix="convert the file to UTF-8",
            )
    return head


def _refused(found: bytes, line: int, what: str) -> FormatError:
    if found == b"\x00":
        return FormatError(what, where=f"line {line}: a NUL byte", fix="restore the file from a copy")
    kind = "document type" if found.lower() == b"<!doctype" else "entity"
    return FormatError(
        what,
        where=f"line {line}: a {kind} declaration, which is refused unread",
        fix="remove the declaration",
    )
