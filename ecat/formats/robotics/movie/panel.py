"""What stands beside the image: the session, the time, what happens, where the blocks are, which relations hold."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecat.formats.robotics.movie import paint
from ecat.formats.robotics.movie.lanes import Bar, clock
from ecat.formats.robotics.movie.overlay import BlockNow
from ecat.formats.robotics.movie.paint import Image
from ecat.formats.robotics.scene import Held, Rgb
from ecat.geometry.transforms import euler_from_quaternion

_BACK, _INK, _QUIET = (20, 22, 27), (236, 239, 244), (140, 147, 158)
_MOST_RELATIONS, _MOST_LINES = 9, 4


def _words(held: Held) -> str:
    predicate = held.predicate.lower().replace("_", " ")
    first, *others = held.arguments or ("",)
    return f"{first} {predicate} {', '.join(others)}".strip()


class Panel:
    """Draws the panel of ``shape`` (height, width); ``size`` is that of everything drawn, 1 for 1080 rows."""

    def __init__(
        self, title: str, layer: str, relations: Sequence[Held], *, shape: tuple[int, int], size: float
    ) -> None:
        self._title, self._layer = title, layer
        self._relations = [(held.start_ns, held.end_ns, _words(held)) for held in relations if held.polarity]
        (self._height, self._width), self._size = shape, size
        self._pad = round(22 * size)
        self._blank = np.full((*shape, 3), paint.bgr(_BACK), np.uint8)

    def draw(self, t_ns: int, end_ns: int, current: Sequence[Bar], blocks: Sequence[BlockNow]) -> Image:
        """The panel at a moment."""
        image = self._blank.copy()
        y = self._pad + self._line(0, 1.0)
        y = self._text(image, y, self._title, 26, _INK, weight=700)
        if self._layer:
            y = self._text(image, y, f"layer {self._layer}", 18, _QUIET)
        y = self._text(image, y + 6 * self._size, f"{clock(t_ns)}  of  {clock(end_ns)}", 24, _INK)
        y = self._now(image, self._heading(image, y, "now"), current)
        if blocks:
            y = self._heading(image, y, "blocks")
            for block in blocks:
                y = self._block(image, y, block)
        holding = [words for start, end, words in self._relations if start <= t_ns < end]
        if self._relations:
            y = self._heading(image, y, "relations")
            for words in holding[:_MOST_RELATIONS]:
                y = self._text(image, y, words, 20, _INK)
            if len(holding) > _MOST_RELATIONS:
                self._text(image, y, f"and {len(holding) - _MOST_RELATIONS} more", 18, _QUIET)
        return image

    def _now(self, image: Image, y: float, current: Sequence[Bar]) -> float:
        wholes = [bar for bar in current if not bar.is_part]
        for bar in wholes[:2]:
            size = round(24 * self._size)
            for words in paint.wrapped(bar.words, size, self._width - 2 * self._pad, 600)[:_MOST_LINES]:
                y = self._text(image, y, words, 24, bar.color, weight=600)
        parts = [bar for bar in current if bar.is_part]
        if parts:
            y = self._text(image, y, " · ".join(bar.words for bar in parts), 20, _INK)
        return y if wholes or parts else self._text(image, y, "—", 24, _QUIET)

    def _block(self, image: Image, y: float, block: BlockNow) -> float:
        size = self._size
        paint.dot(image, np.array([self._pad + 8 * size, y - 8 * size]), block.thing.color, 8 * size)
        y = self._text(image, y, block.thing.name, 21, _INK, weight=600, indent=26)
        if block.pose is None:
            return self._text(image, y, "not seen", 18, _QUIET, indent=26)
        centre, quaternion = block.pose
        yaw = np.degrees(euler_from_quaternion(quaternion)[2])
        x_cm, y_cm, z_cm = (centre * 100).tolist()
        place = f"x {x_cm:.1f}   y {y_cm:.1f}   z {z_cm:.1f} cm   {yaw:.0f}°"
        y = self._text(image, y, place, 18, _INK if block.observed else _QUIET, indent=26)
        return y + 4 * size

    def _heading(self, image: Image, y: float, words: str) -> float:
        y += 14 * self._size
        rule = y - 26 * self._size
        paint.line(image, np.array([[self._pad, rule], [self._width - self._pad, rule]]), (46, 50, 59), 1)
        return self._text(image, y, words.upper(), 15, _QUIET, weight=600) + 8 * self._size

    def _text(
        self, image: Image, y: float, words: str, size: int, color: Rgb, *, weight: int = 400, indent: int = 0
    ) -> float:
        """A line with its baseline at ``y``; where the next one's is."""
        if y > self._height - 6 * self._size:
            return y
        left, real = self._pad + indent * self._size, round(size * self._size)
        fitting = paint.shortened(words, real, self._width - left - self._pad / 2, weight)
        paint.text(image, (left, y), fitting, real, color, weight=weight)
        return y + self._line(size, 0.55)

    def _line(self, size: int, more: float) -> float:
        return (size * (1 + more) if size else 24 * more) * self._size
