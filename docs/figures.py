"""Draws the figures of docs/relations.md with the thresholds that the stages use.

python docs/figures.py
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ecat.geometry.relations import Threshold, held
from ecat.geometry.rest import find_rests
from ecat.stages.propose import ProposeParameters
from ecat.stages.relations import RelationParameters

FOLDER = Path(__file__).parent / "images" / "relations"
RULES = RelationParameters()
A, B, INK, SOFT, GOOD = "#e8a33d", "#5b8fd9", "#333333", "#999999", "#3f9b57"
Point = tuple[float, float]


class Drawing:
    """An SVG picture of ``width`` by ``height`` px, y down."""

    def __init__(self, width: int, height: int) -> None:
        self._size = width, height
        self._parts: list[str] = []

    def line(self, a: Point, b: Point, *, color: str = INK, width: float = 1.5, dash: str = "") -> None:
        """A straight line."""
        self._parts.append(
            f'<line x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}" stroke="{color}" '
            f'stroke-width="{width}"' + (f' stroke-dasharray="{dash}"' if dash else "") + "/>"
        )

    def shape(
        self, points: Sequence[Point], *, fill: str = "none", color: str = INK, opacity: float = 1
    ) -> None:
        """A polygon."""
        corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self._parts.append(
            f'<polygon points="{corners}" fill="{fill}" fill-opacity="{opacity}" stroke="{color}" stroke-width="1.5"/>'
        )

    def curve(self, points: Sequence[Point], *, color: str = INK, width: float = 2) -> None:
        """A line through points."""
        corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self._parts.append(
            f'<polyline points="{corners}" fill="none" stroke="{color}" stroke-width="{width}"/>'
        )

    def dot(self, at: Point, radius: float = 4, color: str = INK) -> None:
        """A filled circle."""
        self._parts.append(f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{radius}" fill="{color}"/>')

    def box(self, x: float, y: float, width: float, height: float, fill: str) -> None:
        """An upright rectangle, its top left corner first."""
        self.shape(
            [(x, y), (x + width, y), (x + width, y + height), (x, y + height)], fill=fill, opacity=0.75
        )

    def text(
        self, at: Point, words: str, *, color: str = INK, anchor: str = "middle", size: int = 13
    ) -> None:
        """Words at a place."""
        self._parts.append(
            f'<text x="{at[0]:.1f}" y="{at[1]:.1f}" text-anchor="{anchor}" font-size="{size}" '
            f'fill="{color}">{words}</text>'
        )

    def measure(self, a: Point, b: Point, words: str, at: Point, *, anchor: str = "start") -> None:
        """A measured distance with ticks at its ends."""
        across = np.array([b[1] - a[1], a[0] - b[0]])
        across = 4 * across / max(float(np.linalg.norm(across)), 1e-9)
        self.line(a, b, color="#c0392b")
        for x, y in (a, b):
            self.line((x - across[0], y - across[1]), (x + across[0], y + across[1]), color="#c0392b")
        self.text(at, words, color="#c0392b", anchor=anchor)

    def save(self, name: str) -> None:
        """Write the picture."""
        width, height = self._size
        text = "\n".join(self._parts)
        (FOLDER / f"{name}.svg").write_text(
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" '
            f'height="{height}" font-family="sans-serif">\n<rect width="{width}" height="{height}" fill="white"/>\n'
            f"{text}\n</svg>\n",
            encoding="utf-8",
        )


def mm(threshold: Threshold) -> str:
    """Both thresholds."""
    return f"on {threshold.on * 1000:.0f} mm, off {threshold.off * 1000:.0f} mm"


def hysteresis() -> None:
    """A measure, its two thresholds, and the interval."""
    d = Drawing(560, 250)
    t = np.arange(150) / 30.0
    value = 0.016 - 0.012 * np.sin((t - 0.7) * 1.1) + 0.0022 * np.sin(t * 23)
    value[62:74] = np.nan
    rule = Threshold(on=0.01, off=0.018, min_s=0.2)

    def at(row: int, height: float) -> Point:
        return 60 + row * 3.1, 200 - height * 5200

    for height, name in ((rule.on, "on"), (rule.off, "off")):
        d.line(at(0, height), at(149, height), color=SOFT, dash="5 4")
        d.text((at(0, height)[0] - 8, at(0, height)[1] + 4), name, anchor="end")
    known = np.isfinite(value)
    for part in (range(62), range(74, 150)):
        d.curve([at(row, float(value[row])) for row in part if known[row]])
    d.text((at(68, 0.0)[0], 190), "gap", color=SOFT)
    for span in held(t, value, np.full(150, 1e-4), rule):
        d.box(at(span.start, 0)[0], 212, (span.end - span.start) * 3.1, 14, GOOD)
        d.text(((at(span.start, 0)[0] + at(span.end, 0)[0]) / 2, 242), "holds")
    d.text((60, 22), "measure", anchor="start")
    d.line((60, 30), (60, 205))
    d.line((60, 205), (530, 205))
    d.text((545, 209), "t")
    d.save("hysteresis")


def on() -> None:
    """Height over the table or another box, and overhang."""
    d = Drawing(560, 230)
    d.line((20, 190), (260, 190), width=3)
    d.text((40, 210), "table")
    d.box(80, 85, 90, 90, A)
    d.text((125, 135), "a")
    d.measure((200, 175), (200, 190), "h(a)", (210, 187))
    d.text((140, 225), f"ON(a, table): |h| {mm(RULES.on)}", size=12)
    d.box(340, 110, 80, 80, B)
    d.text((380, 155), "b")
    d.line((300, 190), (540, 190), width=3)
    d.box(400, 18, 80, 80, A)
    d.text((440, 63), "a")
    d.measure((330, 98), (330, 110), "h(a, b)", (322, 108), anchor="end")
    d.line((440, 58), (440, 175), color=SOFT, dash="4 4")
    d.line((420, 110), (420, 175), color=SOFT, dash="4 4")
    d.measure((420, 165), (440, 165), "o(a, b)", (447, 169))
    d.text((415, 225), "ON(a, b): max(|h|, o); ABOVE(a, b): max(-h, o)", size=12)
    d.save("on")


def gap() -> None:
    """The free distance of two boxes, seen from above."""
    d = Drawing(560, 210)
    d.shape([(70, 60), (160, 40), (180, 130), (90, 150)], fill=A, opacity=0.75)
    d.text((125, 100), "a")
    d.box(260, 45, 90, 90, B)
    d.text((305, 95), "b")
    d.measure((180, 130), (260, 130), "d(a, b)", (198, 152))
    d.text((200, 183), f"TOUCHING: d {mm(RULES.touching)}", size=12)
    d.text((200, 200), f"NEAR: d {mm(RULES.near)}", size=12)
    d.box(420, 90, 80, 80, A)
    d.dot((475, 62), 7, "#b5651d")
    d.text((490, 60), "hand", anchor="start")
    d.measure((455, 62), (455, 90), "d", (436, 80))
    d.text((462, 192), f"in hand: d {mm(RULES.in_hand)}", size=12)
    d.save("gap")


def directions() -> None:
    """The four cones around a box, seen from above, the viewer at the bottom."""
    d = Drawing(420, 400)
    centre = (210.0, 185.0)
    for name, axis, fill in (
        ("RIGHT_OF", 0.0, "#dbe7f7"),
        ("BEHIND", 90.0, "#e3f2e1"),
        ("LEFT_OF", 180.0, "#fbe9d0"),
        ("IN_FRONT_OF", 270.0, "#f4dfe3"),
    ):
        spread = math.degrees(RULES.beside.on)
        rim = [math.radians(axis + step * spread) for step in np.linspace(-1, 1, 20)]
        d.shape(
            [centre, *((centre[0] + 150 * math.cos(v), centre[1] - 150 * math.sin(v)) for v in rim)],
            fill=fill,
        )
        middle = math.radians(axis)
        d.text((centre[0] + 98 * math.cos(middle), centre[1] - 110 * math.sin(middle) + 4), name)
    corners = ((-28, -28), (28, -28), (28, 28), (-28, 28))
    d.shape([(centre[0] + x, centre[1] + y) for x, y in corners], fill="#84abe3")
    d.text((centre[0], centre[1] + 5), "b")
    d.text((210, 372), "viewer", size=14)
    d.line((210, 356), (210, 342), width=2)
    d.shape([(210, 338), (205, 347), (215, 347)], fill=INK)
    degrees = [f"{math.degrees(v):.0f}" for v in (RULES.beside.on, RULES.beside.off)]
    d.text(
        (210, 393), f"direction from b to a: on {degrees[0]}, off {degrees[1]} degrees from an axis", size=12
    )
    d.save("directions")


def events() -> None:
    """A box's way over time: rests, movement, and the parts of an action."""
    d = Drawing(640, 330)
    frames = np.arange(150)
    share = np.clip((frames - 45) / 60, 0, 1)
    way = 0.3 * share**3 * (10 - 15 * share + 6 * share**2)
    noisy = way + np.random.default_rng(2).normal(0, 0.0025, 150)
    noisy[[22, 118]] += (0.06, -0.07)
    seen = np.ones(150, bool)
    seen[66:84] = False

    def at(frame: float, height: float) -> Point:
        return 60 + frame * 3.6, 180 - height * 400

    for frame in frames[seen]:
        d.dot(at(float(frame), float(noisy[frame])), 2, B)
    rests = find_rests(
        frames[seen] / 30.0,
        np.column_stack([noisy[seen], np.zeros((seen.sum(), 2))]),
        np.full(int(seen.sum()), 0.0025),
        ProposeParameters().moves.stillness,
    )
    rows = frames[seen]
    rests = [rest for rest in rests if rest.last - rest.first > 15]
    first, last = rests[0], rests[-1]
    for rest in (first, last):
        d.box(
            at(float(rows[rest.first]), 0)[0],
            200,
            3.6 * float(rows[rest.last] - rows[rest.first]),
            16,
            "#dddddd",
        )
    start, end = int(rows[first.last]) + 1, int(rows[last.first])
    d.text((at(float(rows[first.last]) / 2, 0)[0], 213), "rest", size=12)
    d.text((at((rows[last.first] + 150) / 2, 0)[0], 213), "rest", size=12)
    for name, a, b, y, color in (
        ("move", start, end, 200, GOOD),
        ("grasp", start - 14, start - 6, 228, A),
        ("hold", start - 6, end + 6, 228, "#f3d19b"),
        ("release", end + 6, end + 14, 228, A),
        ("action", start - 14, end + 14, 256, B),
    ):
        d.box(at(a, 0)[0], y, 3.6 * (b - a), 16, color)
        x = at((a + b) / 2, 0)[0]
        d.text((x + {"grasp": -38, "release": 42}.get(name, 0), y + 13), name, size=12)
    d.text((at(75, 0)[0], 50), "not seen", color=SOFT, size=12)
    d.text((at(22, 0.08)[0] + 8, at(22, 0.06)[1] - 4), "outlier", color=SOFT, anchor="start", size=12)
    d.text((60, 18), "way of the box", anchor="start")
    d.line((60, 26), (60, 190))
    d.line((60, 190), (610, 190))
    d.text((625, 194), "t")
    d.text(
        (320, 305),
        "the hand stays fixed to the box while it holds; it is near its grip while it grasps or releases",
        size=12,
    )
    d.save("events")


def together() -> None:
    """Two boxes on their way with and without a steady distance."""
    d = Drawing(560, 170)
    for x, way, name in ((40, (70, 70), "TOGETHER(a, b)"), (320, (70, 20), "not together")):
        d.box(x, 50, 60, 60, A)
        d.box(x + 75, 50, 60, 60, B)
        for start, y, length in ((x + 30, 68, way[0]), (x + 105, 92, way[1])):
            d.dot((start, y), 3)
            d.line((start, y), (start + length, y), width=2.5)
            tip = start + length
            d.shape([(tip + 8, y), (tip, y - 5), (tip, y + 5)], fill=INK)
        d.text((x + 70, 140), name)
    d.text((280, 164), "both move, and the speed of one relative to the other is small", size=12)
    d.save("together")


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    for draw in (hysteresis, on, gap, directions, together, events):
        draw()
