"""``*.glyph``: one marker pattern as text, and the nine patterns ECAT was shipped with (§1.8).

Five lines of five characters ``0`` / ``1`` (1 = white), LF or CRLF, no final line end. The patterns are those
of the ArUco "original" dictionary as printed, some turned. ECAT mirrors each row while it loads a file,
because Kinect colour images are mirrored: the codes in its sessions are the left-right mirror image of the
file.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ecat.errors import FormatError, NotFoundError, UsageError
from ecat.formats.ecat2018.xml_input import read_input, reading
from ecat.model.prototype import PEPSI, SHELL, STELLA_ARTOIS

Cells: TypeAlias = NDArray[np.uint8]
"""uint8[5, 5], rows from the top of the print, 1 = white."""

_SIZE = 5
_PATTERN = re.compile(rb"(?:[01]{5}\r?\n){4}[01]{5}(?:\r?\n)?")

_CODES = {(box.name, face.face): face.code for box in (STELLA_ARTOIS, PEPSI, SHELL) for face in box.faces}
GLYPHS = MappingProxyType(
    {
        5: ("Stella Artois", "+z"),
        477: ("Stella Artois", "-y"),
        71: ("Stella Artois", "+x"),
        6: ("Pepsi", "+z"),
        566: ("Pepsi", "-x"),
        155: ("Pepsi", "+x"),
        426: ("Shell", "+z"),
        303: ("Shell", "-x"),
        521: ("Shell", "+y"),
    }
)
"""ArUco "original" id of every shipped glyph -> the box and the face that carry it."""


@dataclass(frozen=True, slots=True)
class Identity:
    """What a code is: the glyph, its counter-clockwise quarter turns from the file, and if it is mirrored.

    ``code == rot90(mirror(code_of(id)) if mirrored else code_of(id), quarter_turns)``. Patterns 477 and 521
    are their own mirror images; they count as mirrored, as in a session.
    """

    id: int
    quarter_turns: int
    mirrored: bool


def read_glyph(source: Path | bytes) -> Cells:
    """The pattern as printed, not mirrored.

    Raises
    ------
    FormatError : not five lines of five characters 0 or 1.
    """
    what = reading(source, "the glyph")
    data = read_input(source, what, max_bytes=64)
    if not _PATTERN.fullmatch(data):
        raise FormatError(what, where=f"expected {_SIZE} lines of {_SIZE} characters 0 or 1")
    digits = np.frombuffer(data, dtype=np.uint8)
    return (digits[digits >= ord("0")] - ord("0")).reshape(_SIZE, _SIZE)


def write_glyph(cells: ArrayLike, *, newline: str = "\n") -> bytes:
    """The file of a pattern (5 x 5 cells of 0 and 1), without a final line end."""
    pattern = np.asarray(cells)
    if pattern.shape != (_SIZE, _SIZE) or not np.isin(pattern, (0, 1)).all():
        fix = f"give {_SIZE} x {_SIZE} cells of 0 and 1"
        raise UsageError("cannot write the glyph", where=f"cells of shape {pattern.shape}", fix=fix)
    return newline.join("".join(map(str, row)) for row in pattern.astype(int).tolist()).encode()


def mirror(cells: Cells) -> Cells:
    """The pattern as a mirrored image shows it."""
    return np.fliplr(cells)


def code_of(glyph_id: int) -> Cells:
    """The pattern of a shipped glyph, as its file holds it; `NotFoundError` for other ids."""
    if glyph_id not in GLYPHS:
        known = ", ".join(map(str, sorted(GLYPHS)))
        raise NotFoundError(
            f"no glyph {glyph_id}", where=f"the shipped glyphs are {known}", fix="name one of them"
        )
    digits = np.frombuffer(_CODES[GLYPHS[glyph_id]].encode(), dtype=np.uint8)
    return (digits - ord("0")).reshape(_SIZE, _SIZE)


def identify(cells: ArrayLike) -> Identity | None:
    """Which shipped glyph a code (5 x 5, 1 = white) is, however turned or mirrored; None if it is none."""
    return _IDENTITIES.get(np.asarray(cells).astype(np.uint8).tobytes())


def _identities() -> dict[bytes, Identity]:
    return {
        np.rot90(mirror(code_of(glyph_id)) if mirrored else code_of(glyph_id), turns).tobytes(): Identity(
            glyph_id, turns, mirrored
        )
        for glyph_id in GLYPHS
        for mirrored in (False, True)
        for turns in range(4)
    }


_IDENTITIES = _identities()
