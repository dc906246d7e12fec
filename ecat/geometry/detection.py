"""Finding the marker faces of known boxes in an image, and finding them again in the next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.boxes import SQUARE, corner_order, square_poses
from ecat.geometry.cameras import Camera
from ecat.geometry.changes import Region
from ecat.geometry.corners import Outlines, Several, outline
from ecat.geometry.markers import Codebook, Reading, cell_values, code_of, codebooks, read_codes
from ecat.geometry.quads import find_quads
from ecat.geometry.transforms import Floats, Rigid
from ecat.model.prototype import BoxPrototype

# a ring measured from this near is as good as one measured twice
_NEAR_PX = 1.0
# the same for a face that was there before, so that it lies where it would if nothing were known of it
_AGAIN_PX = 0.5
_LEAST_SINE = 0.1
# how far the cells of a face may be from those that were read: root of the sum of squares, in units of the contrast.
# One cell that is half black and half white is farther away, however blurred
_SAME_LOOK = 0.3
# a ring with its middle in a face and at most this share of its area is a part of it; one around a face that is as much
# larger is the edge of what it is printed on
_SMALLER = 0.6


@dataclass(frozen=True)
class Evidence:
    """What it takes to believe that a quadrilateral is a marker.

    Parameters
    ----------
    min_side_px : mean side.
    support : share of each edge along which there is a step.
    min_cell_px : side of a cell where the ring is narrowest: what is smaller cannot be read.
    likeness, first_likeness : correlation of the image with the marker, as blurred as the image: of a face that is
        followed, and of one that was not there before.
    contrast : grey levels between black and white.
    square_px, square_share : how far the corners may be from those of a square seen by the camera, root mean square: so
        many pixels, plus this share of the side.
    """

    min_side_px: float = 13.0
    support: float = 0.5
    min_cell_px: float = 1.2
    likeness: float = 0.93
    first_likeness: float = 0.97
    contrast: float = 20.0
    square_px: float = 0.6
    square_share: float = 0.03


@dataclass(frozen=True)
class Found:
    """Faces of boxes in one image, (n,) each; ``box`` and ``face`` are indices.

    ``rings`` (n, 4, 2): pixels of the corners, clockwise on the screen, from the upright glyph's top left as the image
    shows it; ``sigma_px`` (n, 4) their standard deviations.  ``likeness`` (n,), between -1 and 1, and ``look``
    (n, cells) are of the image in which the face was last read, see :class:`Reading`.
    """

    box: NDArray[np.intp]
    face: NDArray[np.intp]
    rings: Floats
    sigma_px: Floats
    likeness: Floats
    look: Floats

    def __len__(self) -> int:
        return len(self.box)

    def __getitem__(self, rows: NDArray[Any] | slice) -> Found:
        return Found(*(getattr(self, name)[rows] for name in _FOUND))

    def moved(self, rings: Floats) -> Found:
        """The same faces elsewhere."""
        return Found(self.box, self.face, rings, self.sigma_px, self.likeness, self.look)

    def replaced(self, rows: NDArray[np.intp], others: Found) -> Found:
        """The same with others in these rows."""
        if not len(rows):
            return self
        new = Found(*(getattr(self, name).copy() for name in _FOUND))
        for name in _FOUND:
            getattr(new, name)[rows] = getattr(others, name)
        return new

    @classmethod
    def none(cls) -> Found:
        """Nothing."""
        no = np.empty(0, np.intp)
        return cls(no, no, np.empty((0, 4, 2)), np.empty((0, 4)), np.empty(0), np.empty((0, 0)))

    @classmethod
    def joined(cls, parts: Sequence[Found]) -> Found:
        """All of them, one after the other."""
        some = [part for part in parts if len(part)] or list(parts[:1])
        if len(some) == 1:
            return some[0]
        return cls(*(np.concatenate([getattr(part, name) for part in some]) for name in _FOUND))

    def best(self) -> Found:
        """Of a face that was found more than once, the one with the best likeness."""
        if len(self) < 2:
            return self
        by = np.lexsort((-self.likeness, self.face, self.box))
        first = np.ones(len(by), bool)
        first[1:] = (np.diff(self.box[by]) != 0) | (np.diff(self.face[by]) != 0)
        return self[by[first]]


_FOUND = ("box", "face", "rings", "sigma_px", "likeness", "look")


class Detector:
    """Finds the faces of boxes.

    Parameters
    ----------
    prototypes : the boxes; no other codes are read.
    camera : whose images are looked at; without one, squares are not told from other quadrilaterals.
    mirrored : whether images are left for right; as the camera has it if not given.

    Raises
    ------
    InputError : two faces cannot be told apart.
    """

    def __init__(
        self,
        prototypes: Sequence[BoxPrototype],
        camera: Camera | None = None,
        *,
        mirrored: bool | None = None,
        evidence: Evidence | None = None,
    ) -> None:
        self.prototypes = tuple(prototypes)
        self.camera = camera
        self.evidence = evidence or Evidence()
        self.mirrored = (camera is not None and camera.mirrored) if mirrored is None else mirrored
        self._books = codebooks(self.prototypes, mirrored=self.mirrored)
        # of each face, its codebook and its upright glyph
        most = max((len(box.faces) for box in self.prototypes), default=0)
        self._places = np.zeros((len(self.prototypes), most, 2), np.intp)
        for b, book in enumerate(self._books):
            for i, g in enumerate(book.glyphs):
                if not g.turn:
                    self._places[g.box, g.face] = b, i
        self._cells = max(((book.n + 2) ** 2 for book in self._books), default=0)
        self._sides = {
            (b, f): face.side_m for b, box in enumerate(prototypes) for f, face in enumerate(box.faces)
        }

    def search(self, grey: NDArray[np.uint8], region: Region | None = None) -> Found:
        """All faces in an image (height, width), or in a region of it."""
        found = self.read(grey, self.candidates(grey, region))
        return found[self.convincing(found)]

    def candidates(self, grey: NDArray[np.uint8], region: Region | None = None) -> Floats:
        """Rings (n, 4, 2) that could be faces, roughly placed."""
        left, top, right, bottom = region or (0, 0, grey.shape[1], grey.shape[0])
        part = np.ascontiguousarray(grey[top:bottom, left:right])
        return find_quads(part, min_side_px=self.evidence.min_side_px) + np.array([left, top], float)

    def read(self, grey: NDArray[np.uint8], rings: Floats, *, reach_px: float = 3.0) -> Found:
        """The faces whose edges are within ``reach_px`` of rings (n, 4, 2)."""
        if not len(rings):
            return Found.none()
        seen = outline(grey, rings, reach_px=reach_px)
        sound = self._sound(seen)
        seen, rings = seen[sound], rings[sound]
        # where corners were far from where they were thought to be, they are better measured once more
        far = np.abs(seen.rings - rings).max((1, 2)) > _NEAR_PX if len(seen) else sound
        found = [Found.none()]
        for book in self._books if len(seen) else ():
            reading = read_codes(grey, seen, book)
            good = self._clear(seen.rings, reading, book)
            near = np.flatnonzero(good & ~far & reading.certain)
            found.append(self._faces(seen, reading, near, book))
            if (good & far).any():
                again = outline(grey, seen.rings[good & far], reach_px=2)
                reading = read_codes(grey, again, book)
                clear = self._clear(again.rings, reading, book) & reading.certain & self._sound(again)
                found.append(self._faces(again, reading, np.flatnonzero(clear), book))
        return Found.joined([part for part in found if len(part)] or found[:1]).best()

    def again(
        self, images: Sequence[NDArray[np.uint8]], faces: Found, which: NDArray[np.intp], *, reach_px: float
    ) -> tuple[Found, NDArray[np.bool_]]:
        """The faces (n,) measured again in some images, ``which`` (n,) by index and ascending; and which are there.

        What one shows is compared with nothing but what it showed before.
        """
        grey = Several(images, which)
        seen = outline(grey, faces.rings, reach_px=reach_px)
        there = self._sound(seen)
        far = np.flatnonzero(there & (np.abs(seen.rings - faces.rings).max((1, 2)) > _AGAIN_PX))
        if far.size:
            seen = seen.replaced(far, outline(grey[far], seen.rings[far], reach_px=2))
            there = self._sound(seen)
        found = Found(
            faces.box, faces.face, seen.rings, seen.sigma_px, faces.likeness.copy(), faces.look.copy()
        )
        book = self._places[faces.box, faces.face, 0]
        for b in range(len(self._books)):
            rows = np.flatnonzero(there & (book == b))
            if rows.size:
                there[rows] = self._shown(grey, seen, found, rows, b)
        return found, there

    def _shown(
        self, grey: Several, seen: Outlines, found: Found, rows: NDArray[np.intp], b: int
    ) -> NDArray[np.bool_]:
        """Whether the faces in these rows, all of the codebook ``b``, show what they should.

        What has to be read anew is noted in ``found``.
        """
        book, at = self._books[b], slice(None) if len(rows) == len(found) else rows
        some = found[at]
        now = cell_values(grey[at], some.rings, book)
        shown = self._looks_the_same(now, some, book)
        other = rows[~shown]
        if other.size:
            glyph = self._places[found.box[other], found.face[other], 1]
            reading = read_codes(grey[other], seen[other], book, glyph)
            found.likeness[other] = reading.likeness
            found.look[other, : now.shape[1]] = reading.look
            shown[~shown] = self._clear(found.rings[other], reading, book) & reading.certain
        return shown

    def convincing(self, found: Found) -> NDArray[np.bool_]:
        """Which faces are clear enough to be believed without a history, and, by the camera, seen as squares are."""
        clear = found.likeness >= self.evidence.first_likeness
        if self.camera is None or not clear.any():
            return np.asarray(clear, np.bool_)
        order = corner_order(0, mirrored=self.mirrored)
        side_m = self._side_m(found)
        errors: list[Floats] = []
        for pose in self.poses(found):
            points = np.einsum("nij,nkj->nki", pose.rotation, SQUARE * side_m[:, None, None])
            gap = self.camera.project(points + pose.translation[:, None]) - found.rings[:, order]
            errors.append(np.sqrt((np.nan_to_num(gap, nan=1e6) ** 2).mean((1, 2))))
        allowed = self.evidence.square_px + self.evidence.square_share * sides_px(found.rings).mean(1)
        return np.asarray(clear & (np.minimum(*errors) <= allowed), np.bool_)

    def code(self, box: int, face: int, first: int) -> str:
        """What a face shows, row by row from the corner ``first`` of its ring."""
        book, i = self._places[box, face].tolist()
        return code_of(np.rot90(self._books[book].glyphs[i].cells, first))

    def cells(self, box: int, face: int) -> int:
        """Cells along a side of a face's code."""
        return self._books[self._places[box, face][0]].n

    def poses(self, found: Found) -> tuple[Rigid, Rigid]:
        """Both poses reference-from-marker of every face, from its corners alone; needs the camera."""
        assert self.camera is not None
        pixels = found.rings[:, corner_order(0, mirrored=self.mirrored)]
        return square_poses(pixels, self._side_m(found), self.camera)

    def _side_m(self, found: Found) -> Floats:
        return np.array([self._sides[key] for key in face_keys(found)], float)

    def _sound(self, seen: Outlines) -> NDArray[np.bool_]:
        enough = (sides_px(seen.rings).mean(1) >= self.evidence.min_side_px) & (
            seen.support >= self.evidence.support
        )
        return np.asarray(enough & (seen.bend > _LEAST_SINE), np.bool_)

    def _clear(self, rings: Floats, reading: Reading, book: Codebook) -> NDArray[np.bool_]:
        return self._enough(rings, reading.likeness, reading.contrast, book)

    def _enough(self, rings: Floats, likeness: Floats, contrast: Floats, book: Codebook) -> NDArray[np.bool_]:
        e = self.evidence
        cell = sides_px(rings).min(1) / (book.n + 2)
        fine = (likeness >= e.likeness) & (contrast >= e.contrast) & (cell >= e.min_cell_px)
        return np.asarray(fine, np.bool_)

    def _looks_the_same(self, now: Floats, faces: Found, book: Codebook) -> NDArray[np.bool_]:
        """Which faces (n,) need not be read, since their cells (n, cells) are as they were when that was done.

        Angles between images add up at most: what is near an image that is near the marker is not far from the marker.
        """
        look = faces.look[:, : now.shape[1]]
        power, product = np.einsum("nc,nc->n", look, look), np.einsum("nc,nc->n", look, now)
        contrast = product / np.maximum(power, 1e-9)
        # squared cosine and tangent of the angle between the two
        cosine2 = np.minimum(contrast * product / np.maximum(np.einsum("nc,nc->n", now, now), 1e-9), 1.0)
        same = power * (1 - cosine2) <= _SAME_LOOK**2 * cosine2
        least = np.cos(np.arccos(np.sqrt(cosine2)) + np.arccos(np.clip(faces.likeness, -1, 1)))
        return same & self._enough(faces.rings, least, contrast, book)

    def _faces(self, seen: Outlines, reading: Reading, rows: NDArray[np.intp], book: Codebook) -> Found:
        glyphs = [book.glyphs[i] for i in reading.glyph[rows].tolist()]
        turn, box, face = (
            np.array([getattr(glyph, name) for glyph in glyphs], np.intp) for name in ("turn", "box", "face")
        )
        order = (turn[:, None] + np.arange(4)) % 4
        rings = np.take_along_axis(seen.rings[rows], order[..., None], 1)
        look, k = np.zeros((len(rows), self._cells)), book.n + 2
        for row, i, glyph in zip(look, rows.tolist(), glyphs, strict=True):
            row[: k * k] = np.rot90(reading.look[i].reshape(k, k), glyph.turn).ravel()
        sigma_px = np.take_along_axis(seen.sigma_px[rows], order, 1)
        return Found(box, face, rings, sigma_px, reading.likeness[rows], look)


def face_keys(found: Found) -> list[tuple[int, int]]:
    """Box and face of each."""
    return list(zip(found.box.tolist(), found.face.tolist(), strict=True))


def places(found: Found, others: Found) -> NDArray[np.intp]:
    """Where each face is among the others (n,), -1 if it is not."""
    at = {key: i for i, key in enumerate(face_keys(others))}
    return np.array([at.get(key, -1) for key in face_keys(found)], np.intp)


def sides_px(rings: Floats) -> Floats:
    """Sides (n, 4) of rings (n, 4, 2)."""
    side = rings[:, (1, 2, 3, 0)] - rings
    return np.asarray(np.hypot(side[..., 0], side[..., 1]), np.float64)


def same_place(rings: Floats, known: Floats, within_px: float) -> NDArray[np.bool_]:
    """Which rings (n, 4, 2) have all corners within so many pixels of those of a known one (m, 4, 2)."""
    # whichever corner comes first, both run clockwise
    turned = known[:, (np.arange(4)[:, None] + np.arange(4)) % 4]
    apart = np.abs(rings[:, None, None] - turned).max((-1, -2))
    return np.asarray((apart <= within_px).any((1, 2)), np.bool_)


def belonging(rings: Floats, known: Floats) -> NDArray[np.bool_]:
    """Which rings (n, 4, 2) are part of a known one (m, 4, 2) or the other way round, all of them clockwise."""
    size, whole = _area(rings)[:, None], _area(known)
    part = _within(rings, known) & (size < _SMALLER * whole)
    around = _within(known, rings).T & (whole < _SMALLER * size)
    return np.asarray((part | around).any(1), np.bool_)


def _within(rings: Floats, others: Floats) -> NDArray[np.bool_]:
    """Whether the middle of each ring (n, 4, 2) is inside of each of the others (m, 4, 2)."""
    side = others[:, (1, 2, 3, 0)] - others
    way = rings.mean(1)[:, None, None] - others
    return np.asarray((side[..., 0] * way[..., 1] > side[..., 1] * way[..., 0]).all(-1), np.bool_)


def _area(rings: Floats) -> Floats:
    one, other = rings[:, 2] - rings[:, 0], rings[:, 3] - rings[:, 1]
    return np.asarray(0.5 * (one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]), np.float64)
