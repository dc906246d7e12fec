"""Whether ``files.param`` comes back byte for byte.

The model keeps everything that ECAT ever wrote, but not what only another hand can have put in: comments,
other indentation, quotes or line ends.  A small file is written and compared when it is imported; of a large
one a hash is kept, and compared when it is exported unchanged.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from itertools import zip_longest
from pathlib import Path

import pyarrow as pa

from ecat.formats.ecat2018.elements import PREFIX
from ecat.formats.ecat2018.files_param_write import files_param
from ecat.formats.ecat2018.xml_input import read_input
from ecat.model import Layer, Manifest

COMPARED_BYTES = 1 << 18
HASH_KEY = f"{PREFIX}sha256"


def is_compared(file: Path) -> bool:
    """Whether the file is small enough to be compared when it is imported."""
    return file.stat().st_size <= COMPARED_BYTES


def first_difference(file: Path, manifest: Manifest, layer: Layer, tables: dict[str, pa.Table]) -> str:
    """Where export would not give ``file`` back; empty if it would."""
    lines = read_input(file, f"cannot read {file.name}", COMPARED_BYTES).split(b"\n")
    written = b"".join(files_param(manifest, layer, tables.get, [])).split(b"\n")
    for number, (old, new) in enumerate(zip_longest(lines, written), 1):
        if old != new:
            return (
                f"line {number}: comments, white space, quotes or an order that ECAT does not write are not kept; "
                f"export will differ from here on"
            )
    return ""


class Hashed:
    """Pieces of a file on their way, and what their hash is once they have passed."""

    def __init__(self, pieces: Iterable[bytes]) -> None:
        self._pieces = pieces
        self._digest = hashlib.sha256()

    def __iter__(self) -> Iterator[bytes]:
        for piece in self._pieces:
            self._digest.update(piece)
            yield piece

    @property
    def sha256(self) -> str:
        """The hash of what has passed, as 64 hexadecimal digits."""
        return self._digest.hexdigest()
