"""Sheets of markers to print, cut out and glue on boxes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from xml.sax.saxutils import escape

from ecat.errors import UsageError
from ecat.geometry.markers import cells_of
from ecat.model.prototype import BoxPrototype, MarkerFace

PAGE_MM = (210.0, 297.0)
"""A4."""
_MARGIN_MM = 10.0
_LABEL_MM = 6.0


def marker_sheets(prototypes: Sequence[BoxPrototype]) -> list[str]:
    """SVG pages (A4) with every face of the boxes at true scale, on the white that it needs around it.

    A thin line shows where to cut: the face's own edges if the page is wide enough, or a tenth of the marker away.

    Raises
    ------
    UsageError : a marker is larger than a page.
    """
    pieces = [(box, face, *_piece_mm(box, face)) for box in prototypes for face in box.faces]
    pages: list[list[str]] = []
    x = y = row = 0.0
    for box, face, width, height in pieces:
        if x + width > PAGE_MM[0] - 2 * _MARGIN_MM:
            x, y, row = 0.0, y + row, 0.0
        if not pages or y + height + _LABEL_MM > PAGE_MM[1] - 2 * _MARGIN_MM:
            pages.append([])
            x = y = row = 0.0
        pages[-1] += _drawn(box, face, (x + _MARGIN_MM, y + _MARGIN_MM), (width, height))
        x, row = x + width + 2.0, max(row, height + _LABEL_MM)
    return [_page(shapes) for shapes in pages]


def _piece_mm(box: BoxPrototype, face: MarkerFace) -> tuple[float, float]:
    """Width and height of what is cut out."""
    # upright markers have the box's z axis, or on top and bottom its y axis, going up
    wide, high = (1000 * edge for edge, axis in zip(box.size_m, "xyz", strict=True) if axis != face.face[1])
    least = 1200 * face.side_m
    room = PAGE_MM[0] - 2 * _MARGIN_MM, PAGE_MM[1] - 2 * _MARGIN_MM - _LABEL_MM
    if least > min(room):
        raise UsageError(
            "cannot print the markers",
            where=f"{box.name} {face.face}: {1000 * face.side_m:g} mm do not fit on a page",
            fix="make the marker smaller",
        )
    return (wide if least <= wide <= room[0] else least), (high if least <= high <= room[1] else least)


def _drawn(
    box: BoxPrototype, face: MarkerFace, corner: tuple[float, float], size: tuple[float, float]
) -> list[str]:
    side = 1000 * face.side_m
    cells = cells_of(face.code)
    cell = side / (len(cells) + 2)
    left, top = (c + (s - side) / 2 for c, s in zip(corner, size, strict=True))
    shapes = [
        f'<rect class="cut" {_box(*corner, *size)} fill="none" stroke="#888" stroke-width="0.1"/>',
        f'<rect class="marker" {_box(left, top, side, side)} fill="#000"/>',
    ]
    for row, line in enumerate(cells.tolist(), 1):
        start = 0
        while start < len(line):
            end = start
            while end < len(line) and line[end] == line[start]:
                end += 1
            if line[start]:
                # cells that touch are one shape, so that no hairline shows between them
                where = _box(left + (start + 1) * cell, top + row * cell, (end - start) * cell, cell)
                shapes.append(f'<rect class="white" {where} fill="#fff"/>')
            start = end
    label = escape(f"{box.name} {face.face}  {side:g} mm")
    place = f'x="{corner[0]:g}" y="{corner[1] + size[1] + 3.5:g}"'
    return [*shapes, f'<text {place} font-size="3" font-family="sans-serif" fill="#444">{label}</text>']


def _box(x: float, y: float, width: float, height: float) -> str:
    return f'x="{x:.6g}" y="{y:.6g}" width="{width:.6g}" height="{height:.6g}"'


def _page(shapes: Iterable[str]) -> str:
    width, height = PAGE_MM
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}mm" height="{height:g}mm"'
    body = "\n".join(shapes)
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n{head} viewBox="0 0 {width:g} {height:g}">\n'
        f'<rect width="{width:g}" height="{height:g}" fill="#fff"/>\n{body}\n</svg>\n'
    )
