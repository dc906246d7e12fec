"""Numbers as ECAT 2018 writes them (ECAT 2018 file format §1.2.1)."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import ArrayLike, NDArray

from ecat.errors import FormatError
from ecat.formats.ecat2018.spans import spans, values_of


def parse_floats(
    text: str, expected: int | None = None, *, what: str = "cannot read a list of numbers", where: str = ""
) -> NDArray[np.float64]:
    """Comma-separated numbers as ``float64[n]``; ``∞``, ``-∞``, ``Infinity`` and ``NaN`` are numbers too.

    Empty text is no numbers. `FormatError` (with ``what`` and ``where``) when a token is not a number, or
    when there are not ``expected`` of them.
    """
    plain = text.replace("∞", "inf")
    tokens = plain.split(",") if plain.strip() else []
    if expected is not None and len(tokens) != expected:
        problem = f"expected {expected} numbers, found {len(tokens)}"
    else:
        try:
            # float() would also take underscores and the digits of other scripts
            if plain.isascii() and "_" not in plain:
                return np.array(tokens, dtype=np.float64)
        except ValueError:
            pass
        problem = f"{next(itertools.filterfalse(_is_number, tokens), text)[:40]!r} is not a number"
    raise FormatError(what, where=f"{where}: {problem}" if where else problem)


def parse_float_lines(lines: bytes, width: int) -> NDArray[np.float64] | None:
    """Many texts at once, a line each, as float64 (lines, width).

    None when a line is not plainly ``width`` numbers; `parse_floats` tells what is wrong with it, if anything is.
    """
    data = np.frombuffer(lines, np.uint8)
    commas = np.flatnonzero(data == ord(","))
    line_ends = np.append(np.flatnonzero(data == ord("\n")), len(data))
    if len(commas) != len(line_ends) * (width - 1):
        return None
    ends = np.column_stack([commas.reshape(-1, width - 1), line_ends]).ravel()
    starts = np.append(0, ends[:-1] + 1)
    if (starts > ends).any():  # a comma is in another line than it should be
        return None
    if b"\xe2" in lines:  # one byte is found much faster than three
        lines = lines.replace("∞".encode(), b"inf")  # which is as long
    try:
        numbers = pc.cast(spans(lines, starts, ends, pa.string()), pa.float64())
    except pa.ArrowInvalid:
        return None
    return values_of(numbers, np.float64).reshape(-1, width)


def _is_number(token: str) -> bool:
    try:
        float(token)
    except ValueError:
        return False
    return token.isascii() and "_" not in token


def format_float32(values: ArrayLike) -> str:
    """Comma-separated numbers as ECAT 2018 writes them: seven digits of the 32-bit float, ``E-05``, ``∞``."""
    with np.errstate(over="ignore"):
        single = np.asarray(values, dtype=np.float32).ravel()
    text = ",".join(["%.7g"] * single.size) % tuple(single.tolist())
    return text.replace("e", "E").replace("inf", "∞").replace("nan", "NaN")


_INTEGER = re.compile(r"[+-]?[0-9]{1,18}")


def parse_int(text: str, *, what: str, where: str, low: int = -(2**31), high: int = 2**31 - 1) -> int:
    """A plain decimal integer within ``low`` ... ``high``, outer blanks allowed; `FormatError` otherwise."""
    value = int(text) if _INTEGER.fullmatch(text.strip()) else None
    if value is None or not low <= value <= high:
        raise FormatError(what, where=f"{where}: {text[:40]!r} is not an integer from {low} to {high}")
    return value
