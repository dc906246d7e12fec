"""Figures and tables as a person reads them: deterministic, aligned, without paths or times of day."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import zip_longest


def columns(rows: Sequence[Sequence[str]], *, indent: int = 0) -> str:
    """``rows`` of text in aligned columns two spaces apart; a column of nothing but numbers aligns right."""
    by_column = [list(column) for column in zip_longest(*rows, fillvalue="")]
    aligned = [_align(column) for column in by_column if any(column)]
    return "\n".join((" " * indent + "  ".join(cells)).rstrip() for cells in zip(*aligned, strict=True))


def _align(cells: list[str]) -> list[str]:
    width = max(map(len, cells))
    numeric = all(cell.replace(",", "").replace(".", "").isdigit() for cell in cells if cell)
    return [cell.rjust(width) if numeric else cell.ljust(width) for cell in cells]


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
