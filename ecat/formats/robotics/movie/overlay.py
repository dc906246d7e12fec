"""What is drawn over an image: the table's grid, blocks with axes and names, bodies, shapes drawn by a person."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Generic, TypeVar

import numpy as np

from ecat.formats.robotics import tracks
from ecat.formats.robotics.movie import paint
from ecat.formats.robotics.movie.paint import Image
from ecat.formats.robotics.scene import Rgb, TableFits, Thing, Things, table_fits, table_outlines
from ecat.formats.robotics.tracks import JOINTS, TRACKED, Bodies, Poses
from ecat.geometry.cameras import Camera
from ecat.geometry.transforms import Floats, Rigid, known
from ecat.model import Layer
from ecat.model.annotation import AnnotatedObject
from ecat.model.shapes import shape_at
from ecat.model.skeleton import BONES
from ecat.store import Session
from ecat.store.media import annotated_stream

T = TypeVar("T", Poses, Bodies)

_GRID_M = 0.1
_GRID: Rgb = (190, 200, 215)
_UNSEEN: Rgb = (150, 156, 164)
_DARK: Rgb = (16, 18, 22)
_AXES: tuple[Rgb, ...] = ((255, 92, 92), (92, 224, 122), (92, 156, 255))
_TRAIL_FRAMES = 45
_STEPS = 9
_BONES = [(JOINTS.index(a), JOINTS.index(b)) for a, b in BONES]
_CORNERS = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float) / 2
_FACES = np.array([[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]])
"""Corners of each face, ordered round it; the outward normals are -x, x, -y, y, -z, z."""
_EDGES = sorted(
    {(min(a, b), max(a, b)) for f in _FACES.tolist() for a, b in zip(f, f[1:] + f[:1], strict=True)}
)


@dataclass
class Rows(Generic[T]):
    """Rows of frames that are asked for in ascending order."""

    stretches: Iterator[T]
    _now: T | None = None
    _ended: bool = False

    def at(self, frame: int) -> tuple[T, int] | None:
        """The stretch that has the frame, and its row; None where no row is of this frame."""
        while not self._ended and (self._now is None or int(self._now.frame[-1]) < frame):
            self._now = next(self.stretches, None)
            self._ended = self._now is None
        if self._now is None:
            return None
        row = int(np.searchsorted(self._now.frame, frame))
        there = row < len(self._now.frame) and self._now.frame[row] == frame
        return (self._now, row) if there else None


@dataclass(frozen=True, slots=True)
class BlockNow:
    """A block at a frame: centre (3,) and quaternion (4,) in ``table``, None where unknown; whether it was observed."""

    thing: Thing
    pose: tuple[Floats, Floats] | None
    observed: bool


class Overlay:
    """Draws over the images of one camera.

    Parameters
    ----------
    camera : takes points of ``camera/depth``; None where it is unknown, so that nothing in space can be drawn.
    stream : the stream of the images, whose drawn shapes are shown; joints have places in the annotated one.
    scale : pixels of the movie to a pixel of the image. size : that of everything drawn, 1 for 1080 rows.
    """

    def __init__(
        self,
        session: Session,
        things: Things,
        camera: Camera | None,
        layer: Layer | None,
        *,
        stream: str,
        scale: float,
        size: float,
    ) -> None:
        self._things, self._camera, self._scale, self._size = things, camera, scale, size
        self._fits = table_fits(session) if camera is not None else None
        self._grids = list(_grids(session, self._fits)) if self._fits is not None else []
        video = annotated_stream(session.manifest)
        self._has_pixels = not stream or (video is not None and video.name == stream)
        streams = {stream, "", video.name} if self._has_pixels and video is not None else {stream}
        objects = layer.objects if layer is not None else ()
        self._drawn = [thing for thing in objects if _is_drawn(thing, streams)]
        table = tracks.best_poses(session)
        self._ids: Sequence[str] = tracks.box_ids(session, table) if table is not None else ()
        self._poses = Rows(tracks.poses(session, table, self._ids)) if table is not None else None
        self._slots = tracks.body_slots(session)
        self._bodies = Rows(tracks.bodies(session, list(self._slots))) if self._slots else None
        self._trails = [deque[Floats](maxlen=_TRAIL_FRAMES) for _ in self._ids]

    def draw(self, image: Image, frame: int) -> list[BlockNow]:
        """Draw what is known at a frame, not before the one drawn last; the blocks, for who wants to tell of them."""
        place = self._fits.at(frame).inverse() if self._fits is not None else None
        blocks = self._blocks(frame)
        if place is not None:
            self._grid(image, frame)
            for block, trail in zip(blocks, self._trails, strict=True):
                trail.append(block.pose[0] if block.pose is not None else np.full(3, np.nan))
                self._trail(image, trail, block.thing, place)
        self._body(image, frame)
        for thing in self._drawn:
            self._shape(image, thing, frame)
        if place is not None:
            self._boxes(image, blocks, place)
        return blocks

    def _pixels(self, points: Floats) -> Floats:
        """Pixels of the movie (..., 2) of points (..., 3) in ``camera/depth``; NaN for those out of sight."""
        assert self._camera is not None
        return self._moved(self._camera.project(points))

    def _moved(self, pixels: Floats) -> Floats:
        return (pixels + 0.5) * self._scale - 0.5

    # -------------------------------------------------------------------------------------------- the table

    def _grid(self, image: Image, frame: int) -> None:
        lines = next((lines for at, lines in reversed(self._grids) if at <= frame), None)
        for k, points in enumerate(lines or ()):
            pixels = self._pixels(points)
            # the outline comes last
            edge = k == len(lines or ()) - 1
            below = _mean_color(image, pixels)
            color = paint.mixed(below, _GRID, 0.75 if edge else 0.3)
            paint.line(image, pixels, color, (2 if edge else 1) * self._size)

    # -------------------------------------------------------------------------------------------- blocks

    def _blocks(self, frame: int) -> list[BlockNow]:
        row = self._poses.at(frame) if self._poses is not None else None
        found: list[BlockNow] = []
        for k, key in enumerate(self._ids):
            pose = None
            if row is not None and row[0].known[row[1], k]:
                pose = row[0].centre[row[1], k], row[0].quaternion[row[1], k]
            found.append(
                BlockNow(self._things[key], pose, row is not None and bool(row[0].observed[row[1], k]))
            )
        return found

    def _boxes(self, image: Image, blocks: Sequence[BlockNow], place: Rigid) -> None:
        """The farthest first, so that nearer ones lie over it."""
        there = [
            (block, place @ Rigid.from_quaternion(block.pose[1], block.pose[0]))
            for block in blocks
            if block.pose is not None
        ]
        for block, pose in sorted(there, key=lambda pair: -float(np.linalg.norm(pair[1].translation))):
            self._box(image, block, pose)
        for block, pose in there:
            self._name(image, block.thing, pose)

    def _box(self, image: Image, block: BlockNow, pose: Rigid) -> None:
        size = np.array(block.thing.size_m or (0.0,) * 3)
        color = block.thing.color if block.observed else _UNSEEN
        if size.any():
            corners = pose.apply(_CORNERS * size)
            pixels = self._pixels(corners)
            if not known(pixels, 2):
                return
            seen = self._towards(corners)
            for face in _FACES[seen]:
                paint.area(image, pixels[face], color, 0.16 if block.observed else 0.08)
            front = {tuple(sorted(pair)) for face in _FACES[seen].tolist() for pair in _round(face)}
            for edge in sorted(_EDGES, key=lambda edge: edge in front):
                width = 2.6 if edge in front else 1.0
                shade = color if edge in front else paint.mixed(color, _DARK, 0.35)
                paint.line(image, pixels[list(edge)], shade, width * self._size)
        length = 0.75 * size.max() if size.any() else 0.06
        tips = self._pixels(pose.apply(np.vstack([np.zeros(3), np.eye(3) * length])))
        for tip, axis in zip(tips[1:], _AXES, strict=True):
            paint.line(image, np.array([tips[0], tip]), axis, 3 * self._size)
            paint.dot(image, tip, axis, 4 * self._size)

    def _towards(self, corners: Floats) -> list[int]:
        """The faces that the camera sees from outside."""
        assert self._camera is not None
        eye = self._camera.from_reference.inverse().translation
        middle = corners.mean(0)
        return [
            f
            for f, face in enumerate(_FACES)
            if float((corners[face].mean(0) - middle) @ (eye - corners[face].mean(0))) > 0
        ]

    def _name(self, image: Image, thing: Thing, pose: Rigid) -> None:
        size = np.array(thing.size_m or (0.06,) * 3)
        top = self._pixels(pose.apply(_CORNERS * size))
        if known(top, 2):
            self._label(image, thing.name, thing.color, np.array([top[:, 0].mean(), top[:, 1].min()]))

    def _label(self, image: Image, words: str, color: Rgb, place: Floats) -> None:
        """A name above a place (2,)."""
        size = round(22 * self._size)
        width, pad = paint.text_width(words, size, 600), 8 * self._size
        left, base = place[0] - width / 2, place[1] - 16 * self._size
        if not (0 <= place[0] < image.shape[1] and 0 <= place[1] < image.shape[0]):
            return
        base = max(base, size + pad)
        paint.box(image, (left - pad, base - size, left + width + pad, base + 0.45 * size), _DARK, 0.72)
        paint.text(image, (left, base), words, size, color, weight=600)

    def _trail(self, image: Image, trail: deque[Floats], thing: Thing, place: Rigid) -> None:
        """The way of the last moments on the table, below the block."""
        ground = np.array(trail) * np.array([1.0, 1.0, 0.0])
        pixels = self._pixels(place.apply(ground))
        for k in range(1, len(pixels)):
            if known(pixels[k - 1 : k + 1], 2) and np.abs(pixels[k] - pixels[k - 1]).max() >= 0.25:
                shade = paint.mixed(_DARK, thing.color, 0.25 + 0.75 * k / len(pixels))
                paint.line(image, pixels[k - 1 : k + 1], shade, 3 * self._size)

    # -------------------------------------------------------------------------------------------- bodies, shapes

    def _body(self, image: Image, frame: int) -> None:
        row = self._bodies.at(frame) if self._bodies is not None else None
        if row is None:
            return
        for b, (slot, key) in enumerate(self._slots.items()):
            stretch, f = row
            pixels = (
                self._moved(stretch.pixel[f, b]) if self._has_pixels else np.full((len(JOINTS), 2), np.nan)
            )
            if self._camera is not None:
                projected = self._pixels(stretch.position[f, b])
                pixels = np.where(known(pixels)[:, None], pixels, projected)
            there, sure = known(pixels), stretch.state[f, b] == TRACKED
            color = self._things[key or f"body {slot}"].color
            for width, dark in ((7, True), (4, False)):
                for i, j in _BONES:
                    if there[i] and there[j]:
                        shade = _DARK if dark else color if sure[i] and sure[j] else _UNSEEN
                        paint.line(image, pixels[[i, j]], shade, width * self._size)
            for j in np.flatnonzero(there):
                paint.dot(image, pixels[j], _DARK, 6 * self._size)
                paint.dot(image, pixels[j], color if sure[j] else _UNSEEN, 4.5 * self._size)

    def _shape(self, image: Image, thing: AnnotatedObject, frame: int) -> None:
        numbers = shape_at(thing, frame)
        if numbers is None or not numbers:
            return
        color = self._things[thing.id].color
        if thing.kind == "rectangle":
            u, v, width, height = numbers
            ring = np.array([[u, v], [u + width, v], [u + width, v + height], [u, v + height]])
        else:
            ring = np.array(numbers).reshape(-1, 2)
        pixels = self._moved(ring)
        if len(pixels) == 1:
            paint.dot(image, pixels[0], color, 7 * self._size)
        else:
            paint.line(image, pixels, color, 3 * self._size, closed=True)
        self._label(
            image, self._things[thing.id].name, color, np.array([pixels[:, 0].mean(), pixels[:, 1].min()])
        )


def _is_drawn(thing: AnnotatedObject, streams: set[str]) -> bool:
    """Whether the object has shapes in one of these; tables that are known in space are drawn there."""
    return bool(thing.key_frames) and thing.dimensions == 2 and thing.stream in streams


def _round(face: Sequence[int]) -> Iterator[tuple[int, int]]:
    yield from zip(face, [*face[1:], face[0]], strict=True)


def _mean_color(image: Image, pixels: Floats) -> Rgb:
    """What the image shows along a line, about."""
    inside = pixels[known(pixels)]
    u, v = inside.round().astype(int).T if len(inside) else np.zeros((2, 0), int)
    kept = (u >= 0) & (u < image.shape[1]) & (v >= 0) & (v < image.shape[0])
    if not kept.any():
        return _DARK
    b, g, r = image[v[kept], u[kept]].mean(0).round().astype(int).tolist()
    return r, g, b


def _grids(session: Session, fits: TableFits) -> Iterator[tuple[int, list[Floats]]]:
    """Lines on the table, a tenth of a metre apart, and its outline; from each frame on, points in ``camera/depth``."""
    outlines = table_outlines(session, fits)
    for at in sorted({0, *fits.frame.tolist(), *(frame for frame, _ in outlines)}):
        ring = next(
            (ring for frame, ring in reversed(outlines) if frame <= at), outlines[0][1] if outlines else None
        )
        if ring is None:
            return
        back = fits.at(at).inverse()
        closed = np.vstack([ring, ring[:1]])
        lines = [*_grid_lines(ring, 0), *_grid_lines(ring, 1), _subdivided(closed)]
        yield at, [back.apply(points) for points in lines]


def _grid_lines(ring: Floats, axis: int) -> Iterator[Floats]:
    """Lines where ``axis`` is a multiple of the grid's step, inside of a convex ring (n, 3)."""
    low, high = ring[:, axis].min(), ring[:, axis].max()
    ends = np.roll(ring, -1, 0)
    for value in np.arange(np.ceil(low / _GRID_M), np.floor(high / _GRID_M) + 1) * _GRID_M:
        a, b = ring[:, axis] - value, ends[:, axis] - value
        crossed = (a <= 0) != (b <= 0)
        share = (a[crossed] / (a[crossed] - b[crossed]))[:, None]
        hits = ring[crossed] + share * (ends[crossed] - ring[crossed])
        if len(hits) == 2:
            yield _subdivided(hits)


def _subdivided(points: Floats) -> Floats:
    """The same line with points between, as a lens bends it."""
    share = np.linspace(0, 1, _STEPS)[:, None]
    parts = [a + share * (b - a) for a, b in pairwise(points)]
    return np.concatenate(parts)
