"""Figures, tables and commands as a person reads them."""

from __future__ import annotations

import shlex
import shutil
import sys
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path

_WIDEST = 60
"""Characters of a cell."""


def columns(rows: Sequence[Sequence[str]], *, indent: int = 0) -> str:
    """``rows`` of text in aligned columns two spaces apart; a column of nothing but numbers aligns right."""
    by_column = [list(column) for column in zip_longest(*rows, fillvalue="")]
    aligned = [_align(column) for column in by_column if any(column)]
    return "\n".join((" " * indent + "  ".join(cells)).rstrip() for cells in zip(*aligned, strict=True))


def _align(cells: list[str]) -> list[str]:
    width = max(map(len, cells))
    numeric = all(text.replace(",", "").replace(".", "").isdigit() for text in cells if text)
    return [text.rjust(width) if numeric else text.ljust(width) for text in cells]


def cell(text: str) -> str:
    """A text for a column of a table: on one line, its end left out where it is long."""
    text = " ".join(text.split())
    return text if len(text) <= _WIDEST else f"{text[: _WIDEST - 1]}…"


def duration(seconds: float) -> str:
    """``1 h 02 min 03 s``, ``1 min 28.357 s`` or ``0.040 s``."""
    milliseconds = round(seconds * 1000)
    if milliseconds < 60_000:
        return f"{milliseconds / 1000:.3f} s"
    minutes, milliseconds = divmod(milliseconds, 60_000)
    if minutes < 60:
        return f"{minutes} min {milliseconds / 1000:06.3f} s"
    hours, minutes = divmod(minutes, 60)
    return f"{hours:,} h {minutes:02} min {milliseconds // 1000:02} s"


def count(number: int, noun: str) -> str:
    """``1 event``, ``2 events``."""
    return f"{number:,} {noun}" + ("" if number == 1 else "s")


def listing(counts: Mapping[str, int]) -> str:
    """``2 marker_box, 1 rig``, the most first."""
    ordered = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    return ", ".join(f"{number:,} {name}" for name, number in ordered)


def shell(program: str, *arguments: object) -> str:
    """A command that can be pasted here: ``program``, of those installed with ecat, as the shell finds it.

    By its name if that leads to the one installed with ecat, else by its path.
    """
    return shlex.join([_called(program), *map(str, arguments)])


def _called(program: str) -> str:
    ours = Path(sys.executable).with_name(program)
    if not ours.exists():
        return program
    found = shutil.which(program)
    # a name elsewhere may be a link to ours, but every Python is a link to the same one
    if found and (Path(found).parent.samefile(ours.parent) or Path(found).resolve() == ours.absolute()):
        return program
    here = Path.cwd()
    return str(ours.relative_to(here) if ours.is_relative_to(here) else ours)
