"""Marker faces in a video: found anywhere now and then, followed in between (thesis §3.4).

The whole image is searched every so many frames.  In between, each face is measured again in every image where it is
expected, and only those parts are searched that have changed since they were last looked at, or where a face is
missing: a picture that stays the same shows nothing new.  A few images are taken together, since most of the work on a
few small faces is not done on pixels; the last of them is searched, and what turns up there is followed back.  A face
that is out of sight is looked for in all of them where it was, as soon as something happens there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.changes import (
    TILE_PX,
    Changes,
    Region,
    around,
    grown,
    marked,
    merged,
    regions,
    tile_means,
    touched,
)
from ecat.geometry.detection import Detector, Evidence, Found, belonging, places, same_place
from ecat.geometry.transforms import Floats
from ecat.model.prototype import NOMINAL_BOXES, BoxPrototype

# what is found this near to where a face was followed to is no better place for it
_SAME_PX = 2.0
# how far from where it is expected a face is that keeps moving as it did; others are measured once more
_STEADY_PX = 3.0
_NO_RINGS: Floats = np.empty((0, 4, 2))

Grey: TypeAlias = NDArray[np.uint8]
Believable: TypeAlias = Callable[[int, Found], NDArray[np.bool_]]
"""Of faces found in the image with this index, which to believe."""


@dataclass(frozen=True)
class TrackParameters:
    """How faces are followed, and what makes a box out of them.

    Parameters
    ----------
    prototypes : the boxes that are looked for.
    objects : the object that each of them is; by default as :func:`object_ids` names it.
    every : the whole image is searched every so many frames.  What changes is searched anyway; this is for what appears
        so faintly that no tile changes, which is missed for that long at most.
    together : so many frames are measured at once, and the last of them searched where something changed; what is found
        there is followed back.  A face that comes and goes in fewer, where none was seen before, can be missed.
    changed : grey levels by which the mean of a tile changes when something happens in it.
    reach_px : how far from where it is expected a face is measured without a search.
    sightings, within : a box is believed once it was seen in so many frames, among so many consecutive ones.
    depth_m, depth_share : by how much the depth inside a face may differ from the distance that its size tells: so many
        metres, plus this share of the distance.
    mirrored : whether images are left for right; as the camera has it if None.
    """

    prototypes: tuple[BoxPrototype, ...] = NOMINAL_BOXES
    objects: tuple[str, ...] = ()
    evidence: Evidence = field(default_factory=Evidence)
    every: int = 35
    together: int = 7
    changed: int = 8
    reach_px: float = 4.0
    sightings: int = 5
    within: int = 60
    depth_m: float = 0.05
    depth_share: float = 0.15
    mirrored: bool | None = None


@dataclass(frozen=True)
class _Block:
    """Images that are measured at once, and faces (m,) that could be in them.

    ``last``: where they were seen last; ``way`` (m, 4, 2) by how much they moved to there from the image before;
    ``here`` (m,) whether that was in the image before these.
    """

    images: Sequence[Grey]
    last: Found
    way: Floats
    here: NDArray[np.bool_]


class Tracker:
    """Follows faces from image to image; keeps nothing but where each was last seen, and a few images at a time."""

    def __init__(
        self, detector: Detector, parameters: TrackParameters, believable: Believable | None = None
    ) -> None:
        self._detector = detector
        self._parameters = parameters
        self._believable = believable
        self._changes = Changes(parameters.changed)
        # what reads like a face, but not clearly enough to be believed
        self._doubtful = Found.none()
        self._next = 0
        # where faces were last seen, how far they moved since the image before, and in which image
        self._last = Found.none()
        self._way = _NO_RINGS
        self._seen = np.empty(0, np.int64)
        self._largest_px = 0.0

    def follow(self, images: Iterable[Grey]) -> Iterator[Found]:
        """The faces in each image (height, width), some images later than it was taken in.

        An image must stay as it is until its faces are out.
        """
        block: list[Grey] = []
        for i, grey in enumerate(images, self._next):
            block.append(grey)
            if len(block) >= self._parameters.together or i % self._parameters.every == 0:
                found = self._block(block)
                block.clear()
                yield from found
        if block:
            yield from self._block(block)

    def _block(self, images: Sequence[Grey]) -> list[Found]:
        """Follow what is known, look for the rest in the last image, and follow that back."""
        start, self._next = self._next, self._next + len(images)
        tiles, whole = tile_means(images[-1]), (self._next - 1) % self._parameters.every == 0
        changed = self._changes.all_seen(tiles) if whole else self._changes.look(tiles)
        every = self._followed(images, start, changed)
        new = self._searched(images[-1], changed, whole=whole)
        if not len(new):
            return every
        every[-1] = every[-1][places(every[-1], new) < 0]
        way = self._followed_back(images, new, every)
        self._remember(new, way)
        every[-1] = Found.joined([every[-1], new])
        return every

    def _followed_back(self, images: Sequence[Grey], new: Found, every: list[Found]) -> Floats:
        """Add faces that are new in the last image to those before; how far they moved since the last but one."""
        way = np.zeros_like(new.rings)
        n, m = len(images) - 1, len(new)
        if not n:
            return way
        # all images at once, as if they had been where they are
        which = np.repeat(np.arange(n), m)
        seen, there = self._measured(images[:-1], new[np.tile(np.arange(m), n)], which, _STEADY_PX)
        rows = np.arange(m)
        later, back = new, way
        for i in range(n - 1, -1, -1):
            kept = places(later, every[i]) < 0
            rows, later, back = rows[kept], later[kept], back[kept]
            if not len(rows):
                break
            found, fine = seen[i * m + rows], there[i * m + rows]
            if not fine.all():
                other, fine[~fine] = self._traced(images[i], later[~fine], -back[~fine])
                found = found.replaced(np.flatnonzero(~there[i * m + rows]), other)
            back = (later.rings - found.rings)[fine]
            rows, later = rows[fine], found[fine]
            every[i] = Found.joined([every[i], later])
            if i == n - 1:
                way[rows] = back
        return way

    def _followed(self, images: Sequence[Grey], start: int, changed: NDArray[np.uint8]) -> list[Found]:
        """The faces seen in the image before, in each of the images; those out of sight, where something changed."""
        here = self._seen == start - 1
        now = np.flatnonzero(here | touched(changed, self._last.rings, ~here))
        n, m = len(images), len(now)
        if not m:
            return [Found.none()] * n
        here = here[now]
        block = _Block(images, self._last[now], np.where(here[:, None, None], self._way[now], 0.0), here)
        # all images at once, as if every face kept moving as it did
        rings = block.last.rings + block.way * np.arange(1, n + 1)[:, None, None, None]
        expected = block.last[np.tile(np.arange(m), n)].moved(rings.reshape(-1, 4, 2))
        seen, there = self._measured(images, expected, np.repeat(np.arange(n), m), _STEADY_PX)
        if not there.reshape(n, m)[:, here].all():
            seen, there = self._mended(block, seen, there)
        self._keep_up(now, block, seen, there.reshape(n, m), start)
        rows = [slice(i * m, (i + 1) * m) for i in range(n)]
        return [seen[row] if there[row].all() else seen[row][there[row]] for row in rows]

    def _measured(
        self, images: Sequence[Grey], expected: Found, which: NDArray[np.intp], reach_px: float
    ) -> tuple[Found, NDArray[np.bool_]]:
        """Faces near where they are expected, in the images ``which``; and which of them are there."""
        seen, there = self._detector.again(images, expected, which, reach_px=reach_px)
        return seen, there & self._near(seen, expected.rings)

    def _mended(
        self, block: _Block, seen: Found, there: NDArray[np.bool_]
    ) -> tuple[Found, NDArray[np.bool_]]:
        """Where faces did not keep moving as they did: along another path, or else with a search around them."""
        m, known = len(block.last), block.here
        before, last = block.last.rings - block.way, block.last.rings
        for i, image in enumerate(block.images):
            rows = slice(i * m, (i + 1) * m)
            if i and (known & ~there[rows]).any():
                seen, there = self._steered(block, known, seen, there)
            amiss = np.flatnonzero(known & ~there[rows])
            if amiss.size:
                at = i * m + amiss
                found, fine = self._traced(image, seen[at].moved(last[amiss]), (last - before)[amiss])
                seen, there[at] = seen.replaced(at[fine], found[fine]), fine
            known = known & there[rows]
            before, last = last, seen.rings[rows]
        return seen, there

    def _steered(
        self, block: _Block, known: NDArray[np.bool_], seen: Found, there: NDArray[np.bool_]
    ) -> tuple[Found, NDArray[np.bool_]]:
        """Known faces (m,) in the images after the last they were in, as the block's first images say they move on."""
        n, m = len(block.images), len(block.last)
        met = there.reshape(n, m)
        end = np.where(known & ~met.all(0), np.argmin(met, 0), n)
        image, face = np.nonzero(~met & (np.arange(n)[:, None] >= end))
        # a parabola through three places, as far apart as there are; a line if there are but two
        path = np.concatenate([block.last.rings[None], seen.rings.reshape(n, m, 4, 2)])
        end = end[face]
        apart = np.maximum(end // 2, 1)
        x = ((image + 1 - end) / apart)[:, None, None]
        bend = np.where(end > 1, 0.5, 0.0)[:, None, None] * (x + x * x)
        rings = (
            path[end, face] * (1 + x + bend)
            - path[end - apart, face] * (x + 2 * bend)
            + path[np.maximum(end - 2 * apart, 0), face] * bend
        )
        rows = image * m + face
        found, fine = self._measured(block.images, seen[rows].moved(rings), image, self._parameters.reach_px)
        there[rows] = fine
        return seen.replaced(rows[fine], found[fine]), there

    def _traced(self, grey: Grey, faces: Found, way: Floats) -> tuple[Found, NDArray[np.bool_]]:
        """Faces of a neighbouring image in this one, by how far they moved there; and which of them are here."""
        expected = faces.moved(faces.rings + way)
        here = np.zeros(len(faces), np.intp)
        seen, there = self._measured([grey], expected, here, self._parameters.reach_px)
        if there.all():
            return seen, there
        parts = merged(
            [around(f, w, grey.shape) for f, w in zip(faces.rings[~there], way[~there], strict=True)]
        )
        found = self._detector.read(grey, self._candidates(grey, parts, seen.rings[there]))
        place = places(found, faces)
        place[place >= 0] = np.where(there[place[place >= 0]], -1, place[place >= 0])
        found, place = found[place >= 0], place[place >= 0]
        fine = self._near(found, expected.rings[place])
        fine[~fine] = self._detector.convincing(found[~fine])
        there[place[fine]] = True
        return seen.replaced(place[fine], found[fine]), there

    def _near(self, found: Found, rings: Floats) -> NDArray[np.bool_]:
        gone = np.abs(found.rings - rings).max((1, 2))
        return np.asarray(gone <= 2 * self._parameters.reach_px, np.bool_)

    def _keep_up(
        self, now: NDArray[np.intp], block: _Block, seen: Found, there: NDArray[np.bool_], start: int
    ) -> None:
        """Remember faces (m,) that were measured in images (n * m), and in which of these they were (n, m)."""
        met = np.flatnonzero(there.any(0))
        newest = len(there) - 1 - np.argmax(there[::-1, met], axis=0)
        rows, faces = newest * len(now) + met, now[met]
        rings = np.concatenate([block.last.rings, seen.rings])
        moved = rings[rows + len(now)] - rings[rows]
        steady = np.where(newest > 0, there[newest - 1, met], block.here[met])
        self._way[faces] = np.where(steady[:, None, None], moved, 0.0)
        self._last = self._last.replaced(faces, seen[rows])
        self._seen[faces] = start + newest

    def _searched(self, grey: Grey, changed: NDArray[np.uint8], *, whole: bool) -> Found:
        """Faces in the last image that were not followed into it."""
        image, shape = self._next - 1, (grey.shape[0], grey.shape[1])
        known = self._seen == image
        lost: list[Region] = []
        if whole:
            parts = [(0, 0, shape[1], shape[0])]
        else:
            parts = [grown(r, self._margin_px(), shape) for r in regions(changed)]
            lately = ~known & (self._seen >= image - self._parameters.together)
            for ring, way in zip(self._last.rings[lately], self._way[lately], strict=True):
                lost.append(around(ring, way, grey.shape))
            changed = marked(changed, lost)
        followed = self._last.rings[known]
        rings = self._candidates(grey, merged(parts + lost), followed)
        if len(rings):
            rings = rings[touched(changed, rings, ~belonging(rings, followed))]
        # no farther than a search reaches: beyond a face that is seen from the side lies the edge of another
        found = self._detector.read(grey, np.concatenate([rings, self._doubtful.rings]))
        if not len(found):
            self._doubtful = found
            return found
        fine = self._believed(found, image)
        self._doubtful = found[~fine & (places(found, self._last[known]) < 0)]
        return found[fine]

    def _candidates(self, grey: Grey, parts: Sequence[Region], known: Floats) -> Floats:
        """Rings in parts of the image that are not within reach of known ones: those would lead to the same edges.

        They are roughly placed, by several pixels where a large face moves.
        """
        some = [self._detector.candidates(grey, r) for r in parts if r[0] < r[2] and r[1] < r[3]]
        rings = np.concatenate([_NO_RINGS, *some])
        return rings[~same_place(rings, known, self._parameters.reach_px)] if len(rings) else rings

    def _margin_px(self) -> float:
        """A face that appears may change the image only at one end: the rest of it has to be in view too."""
        return max(4 * TILE_PX, self._largest_px)

    def _believed(self, found: Found, image: int) -> NDArray[np.bool_]:
        """Faces that were not expected have to be convincing, and agree with whatever else is known."""
        place = places(found, self._last)
        fine = place >= 0
        at = place[fine]
        # what was followed is there already, unless this is elsewhere and clearer
        gone_px = np.abs(found.rings[fine] - self._last.rings[at]).max((1, 2))
        twice = (self._seen[at] == image) & (
            (found.likeness[fine] <= self._last.likeness[at]) | (gone_px < _SAME_PX)
        )
        fine[fine] = self._near(found[fine], self._last.rings[at]) & (self._seen[at] < image)
        new = ~fine
        new[np.flatnonzero(place >= 0)[twice]] = False
        new = np.flatnonzero(new)
        new = new[self._detector.convincing(found[new])]
        if self._believable is not None and new.size:
            new = new[self._believable(image, found[new])]
        fine[new] = True
        return fine

    def _remember(self, new: Found, way: Floats) -> None:
        left = places(self._last, new) < 0
        self._last = Found.joined([new, self._last[left]])
        self._way = np.concatenate([way, self._way[left]])
        self._seen = np.concatenate([np.full(len(new), self._next - 1), self._seen[left]])
        self._largest_px = max(self._largest_px, float(np.ptp(new.rings, axis=1).max()))
