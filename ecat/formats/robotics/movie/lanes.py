"""Events as lanes on a page of time: a row for each tier, more where events overlap, and a cursor over it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ecat.formats.robotics.movie import paint
from ecat.formats.robotics.movie.paint import Image
from ecat.formats.robotics.scene import PALETTE, Rgb, span_ns
from ecat.model import Layer

_BACK, _ROW, _INK, _QUIET = (20, 22, 27), (30, 33, 40), (236, 239, 244), (140, 147, 158)
_CURSOR: Rgb = (255, 220, 90)
_MOST_ROWS = 8
_TICKS_S = (0.5, 1, 2, 5, 10, 30, 60, 300, 600, 1800)
_MOST_TICKS = 14


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """A stretch of an event: half-open, ns since the session's start."""

    tier: str
    start_ns: int
    end_ns: int
    words: str
    color: Rgb
    is_part: bool


def bars_of(layer: Layer, times: NDArray[np.int64]) -> list[Bar]:
    """The stretches of a layer's events; each type has a colour."""
    colors: dict[str, Rgb] = {}
    found: list[Bar] = []
    for event in layer.events:
        key = event.type or event.text
        color = colors.setdefault(key, PALETTE[len(colors) % len(PALETTE)])
        for segment in event.segments:
            start, end = span_ns(segment, times)
            words = event.text.strip() or event.type or event.id
            found.append(
                Bar(
                    tier=event.tier or "events",
                    start_ns=start,
                    end_ns=max(end, start + 1),
                    words=words,
                    color=color,
                    is_part=event.parent is not None,
                )
            )
    return sorted(found, key=lambda bar: (bar.start_ns, bar.end_ns))


def rows_of(bars: Sequence[Bar]) -> tuple[list[str], list[int]]:
    """The tier of each row, and the row of each bar, so that none overlap in a row."""
    tiers = sorted({bar.tier for bar in bars}, key=lambda tier: _rank(tier, bars))
    names: list[str] = []
    rows = [0] * len(bars)
    for tier in tiers:
        ends: list[int] = []
        for i, bar in enumerate(bars):
            if bar.tier != tier:
                continue
            row = next((row for row, end in enumerate(ends) if end <= bar.start_ns), len(ends))
            ends[row : row + 1] = [bar.end_ns]
            rows[i] = len(names) + row
        names += [tier] * len(ends)
    return names, rows


def _rank(tier: str, bars: Sequence[Bar]) -> tuple[bool, str]:
    """Tiers of whole events come before those of their parts."""
    return all(bar.is_part for bar in bars if bar.tier == tier), tier


class Lanes:
    """The lanes below the image.

    Parameters
    ----------
    span_ns : what is shown, half-open. page_ns : how much of it at a time. shape : (height, width) in pixels.
    size : that of everything drawn, 1 for 1080 rows.
    """

    def __init__(
        self,
        bars: Sequence[Bar],
        span_ns: tuple[int, int],
        page_ns: int,
        *,
        shape: tuple[int, int],
        size: float,
    ) -> None:
        self._names, rows = rows_of(bars)
        self.n_hidden = max(len(self._names) - _MOST_ROWS, 0)
        self._names = self._names[:_MOST_ROWS]
        self._bars = [(bar, row) for bar, row in zip(bars, rows, strict=True) if row < _MOST_ROWS]
        self._start, self._page_ns = span_ns[0], max(min(page_ns, span_ns[1] - span_ns[0]), 1)
        (self._height, self._width), self._size = shape, size
        self._left = round(150 * size)
        self._top = round(34 * size)
        self._number, self._page = -1, np.zeros((*shape, 3), np.uint8)

    def draw(self, t_ns: int) -> Image:
        """The page at a moment, with what holds brightened and the cursor."""
        number = max(t_ns - self._start, 0) // self._page_ns
        if number != self._number:
            self._number = number
            self._page = self._drawn()
        now = self._page.copy()
        current = [(bar, row) for bar, row in self._bars if bar.start_ns <= t_ns < bar.end_ns]
        for bar, row in current:
            self._bar(now, bar, row, bright=True)
        x, size = self._x(t_ns), round(18 * self._size)
        paint.line(
            now, np.array([[x, self._top - 8 * self._size], [x, self._height]]), _CURSOR, 2 * self._size
        )
        words = clock(t_ns)
        half = paint.text_width(words, size, 600) / 2 + 7 * self._size
        middle = min(max(x, self._left + half), self._width - half)
        paint.box(now, (middle - half, 2 * self._size, middle + half, self._top - 6 * self._size), _CURSOR)
        baseline = self._top - 12 * self._size
        paint.text(now, (middle - half + 7 * self._size, baseline), words, size, _BACK, weight=600)
        return now

    def _x(self, t_ns: int) -> float:
        inside = (t_ns - self._start - self._number * self._page_ns) / self._page_ns
        return self._left + inside * (self._width - self._left - 12 * self._size)

    def _row(self, row: int) -> tuple[float, float]:
        """The upper and lower edge of a row."""
        room = self._height - self._top - 8 * self._size
        height = min(room / max(len(self._names), 1), 52 * self._size)
        return self._top + row * height, self._top + (row + 1) * height - 4 * self._size

    def _drawn(self) -> Image:
        """The page without its cursor."""
        page = np.full((self._height, self._width, 3), paint.bgr(_BACK), np.uint8)
        size = round(17 * self._size)
        for row, name in enumerate(self._names):
            top, bottom = self._row(row)
            paint.box(page, (self._left, top, self._width - 8 * self._size, bottom), _ROW)
            if row == 0 or self._names[row - 1] != name:
                words = paint.shortened(name, size, self._left - 24 * self._size)
                paint.text(page, (14 * self._size, (top + bottom) / 2 + 0.35 * size), words, size, _QUIET)
        self._ticks(page, size)
        for bar, row in self._bars:
            self._bar(page, bar, row, bright=False)
        return page

    def _ticks(self, page: Image, size: int) -> None:
        length_s = self._page_ns / 1e9
        step = next((s for s in _TICKS_S if length_s / s <= _MOST_TICKS), _TICKS_S[-1])
        first = (self._start + self._number * self._page_ns) / 1e9
        for k in range(int(np.ceil(first / step)), int(np.floor((first + length_s) / step)) + 1):
            x = self._x(round(k * step * 1e9))
            paint.line(page, np.array([[x, self._top - 5 * self._size], [x, self._height]]), (46, 50, 59), 1)
            paint.text(
                page, (x + 4 * self._size, self._top - 12 * self._size), _short(k * step), size, _QUIET
            )

    def _bar(self, page: Image, bar: Bar, row: int, *, bright: bool) -> None:
        left, right = (
            max(self._x(bar.start_ns), self._left),
            min(self._x(bar.end_ns), self._width - 12 * self._size),
        )
        if right <= self._left or left >= self._width or right <= left:
            return
        top, bottom = self._row(row)
        color = bar.color if bright else paint.mixed(bar.color, _BACK, 0.45)
        paint.box(page, (left, top, max(right, left + 3), bottom), color)
        size = min(round(20 * self._size), round(0.62 * (bottom - top)))
        words = paint.shortened(bar.words, size, right - left - 14 * self._size, 600)
        ink = _BACK if bright else _INK
        paint.text(
            page, (left + 7 * self._size, (top + bottom) / 2 + 0.35 * size), words, size, ink, weight=600
        )


def clock(t_ns: int) -> str:
    """Minutes, seconds and hundredths."""
    hundredths = t_ns // 10_000_000
    return f"{hundredths // 6000}:{hundredths // 100 % 60:02d}.{hundredths % 100:02d}"


def _short(seconds: float) -> str:
    whole = f"{int(seconds) // 60}:{int(seconds) % 60:02d}"
    return whole if seconds == int(seconds) else f"{whole}.{round(seconds % 1 * 10)}"
