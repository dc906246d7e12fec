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
from ecat.geometry.markers import Codebook, Reading, code_of, codebooks, read_codes
from ecat.geometry.quads import find_quads
from ecat.geometry.transforms import Floats, Rigid
from ecat.model.prototype import BoxPrototype

# a ring measured from this near is as good as one measured twice
_NEAR_PX = 1.0
# the same for a face that was there before, so that it lies where it would if nothing were known of it
_AGAIN_PX = 0.5
_LEAST_SINE = 0.1


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
    shows it; ``sigma_px`` (n, 4) their standard deviations; ``likeness`` (n,) between -1 and 1.
    """

    box: NDArray[np.intp]
    face: NDArray[np.intp]
    rings: Floats
    sigma_px: Floats
    likeness: Floats

    def __len__(self) -> int:
        return len(self.box)

    def __getitem__(self, rows: NDArray[Any]) -> Found:
        return Found(
            self.box[rows], self.face[rows], self.rings[rows], self.sigma_px[rows], self.likeness[rows]
        )

    def moved(self, rings: Floats) -> Found:
        """The same faces elsewhere."""
        return Found(self.box, self.face, rings, self.sigma_px, self.likeness)

    def replaced(self, rows: NDArray[np.intp], others: Found) -> Found:
        """The same with others in these rows."""
        rings, sigma_px, likeness = self.rings.copy(), self.sigma_px.copy(), self.likeness.copy()
        rings[rows], sigma_px[rows], likeness[rows] = others.rings, others.sigma_px, others.likeness
        return Found(self.box, self.face, rings, sigma_px, likeness)

    @classmethod
    def none(cls) -> Found:
        """Nothing."""
        no = np.empty(0, np.intp)
        return cls(no, no, np.empty((0, 4, 2)), np.empty((0, 4)), np.empty(0))

    @classmethod
    def joined(cls, parts: Sequence[Found]) -> Found:
        """All of them, one after the other."""
        if len(parts) == 1:
            return parts[0]
        names = ("box", "face", "rings", "sigma_px", "likeness")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def best(self) -> Found:
        """Of a face that was found more than once, the one with the best likeness."""
        if len(self) < 2:
            return self
        by = np.lexsort((-self.likeness, self.face, self.box))
        first = np.ones(len(by), bool)
        first[1:] = (np.diff(self.box[by]) != 0) | (np.diff(self.face[by]) != 0)
        return self[by[first]]


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
        self._places = {
            (g.box, g.face): (b, i)
            for b, book in enumerate(self._books)
            for i, g in enumerate(book.glyphs)
            if not g.turn
        }
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
            good = self._clear(seen, reading, book)
            near = np.flatnonzero(good & ~far & reading.certain)
            found.append(self._faces(seen[near], reading.glyph[near], reading.likeness[near], book))
            if (good & far).any():
                again = outline(grey, seen.rings[good & far], reach_px=2)
                reading = read_codes(grey, again, book)
                clear = self._clear(again, reading, book) & reading.certain & self._sound(again)
                found.append(self._faces(again[clear], reading.glyph[clear], reading.likeness[clear], book))
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
        likeness = np.zeros(len(faces))
        place = np.array([self._places[key] for key in face_keys(faces)], np.intp).reshape(-1, 2)
        for b, book in enumerate(self._books):
            rows = np.flatnonzero(there & (place[:, 0] == b))
            if rows.size:
                reading = read_codes(grey[rows], seen[rows], book, place[rows, 1])
                there[rows] = self._clear(seen[rows], reading, book) & reading.certain
                likeness[rows] = reading.likeness
        return Found(faces.box, faces.face, seen.rings, seen.sigma_px, likeness), there

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
        book, i = self._places[box, face]
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

    def _clear(self, seen: Outlines, reading: Reading, book: Codebook) -> NDArray[np.bool_]:
        e = self.evidence
        cell = sides_px(seen.rings).min(1) / (book.n + 2)
        fine = (reading.likeness >= e.likeness) & (reading.contrast >= e.contrast) & (cell >= e.min_cell_px)
        return np.asarray(fine, np.bool_)

    def _faces(self, seen: Outlines, glyph: NDArray[np.intp], likeness: Floats, book: Codebook) -> Found:
        turn, box, face = (
            np.array([getattr(book.glyphs[i], name) for i in glyph], np.intp)
            for name in ("turn", "box", "face")
        )
        order = (turn[:, None] + np.arange(4)) % 4
        rings = np.take_along_axis(seen.rings, order[..., None], 1)
        return Found(box, face, rings, np.take_along_axis(seen.sigma_px, order, 1), likeness)


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
