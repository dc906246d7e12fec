"""Marker faces in a video: found anywhere now and then, followed in between (thesis §3.4).

The whole image is searched every so many frames.  In between, each face is measured again in every image where it is
expected, and only those parts are searched that have changed since they were last looked at, or where a face is
missing: a picture that stays the same shows nothing new.  A few images are taken together, since most of the work on a
few small faces is not done on pixels; the last of them is searched, and what turns up there is followed back.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.geometry.boxes import from_leftmost
from ecat.geometry.changes import TILE_PX, Changes, Region, around, grown, merged, tile_means
from ecat.geometry.detection import Detector, Evidence, Found, places, same_place
from ecat.geometry.transforms import Floats
from ecat.model.prototype import NOMINAL_BOXES, BoxPrototype, MarkerFace
from ecat.stages.depth_gauge import DepthGauge
from ecat.stages.images import Images, ImagesByKind
from ecat.stages.sightings import FoundInAll
from ecat.stages.stage import Stage, Tables
from ecat.tables import MARKERS_2D

# candidates are roughly placed; the edges of one that is as near as this are within reach
_SAME_PX = 2.0
# how far from where it is expected a face is that keeps moving as it did; others are measured once more
_STEADY_PX = 3.0
_ORIGIN, _LEVEL = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
_KEPT_APART = 512
_AT_ONCE = 4096
_NO_RINGS: Floats = np.empty((0, 4, 2))

Believable: TypeAlias = Callable[[int, Found], NDArray[np.bool_]]
"""Of faces found in the image with this index, which to believe."""


@dataclass(frozen=True)
class TrackParameters:
    """How faces are followed, and what makes a box out of them.

    Parameters
    ----------
    prototypes : the boxes that are looked for.
    objects : the object that each of them is; by default as :func:`object_ids` names it.
    every : the whole image is searched every so many frames.
    together : so many frames are measured at once, and the last of them searched where something changed; what is found
        there is followed back.
    changed : grey levels by which the mean of a tile changes when something happens in it.
    reach_px : how far from where it is expected a face is measured without a search.
    patience : frames for which a lost face is looked for where it was.
    sightings, within : a box is believed once it was seen in so many frames, among so many consecutive ones.
    depth_m, depth_share : by how much the depth inside a face may differ from the distance that its size tells: so many
        metres, plus this share of the distance.
    mirrored : whether images are left for right; as the camera has it if None.
    """

    prototypes: tuple[BoxPrototype, ...] = NOMINAL_BOXES
    objects: tuple[str, ...] = ()
    evidence: Evidence = field(default_factory=Evidence)
    every: int = 20
    together: int = 5
    changed: int = 8
    reach_px: float = 4.0
    patience: int = 15
    sightings: int = 5
    within: int = 60
    depth_m: float = 0.05
    depth_share: float = 0.15
    mirrored: bool | None = None


class Tracker:
    """Follows faces from image to image; keeps nothing but where each was last seen, and a few images at a time."""

    def __init__(
        self, detector: Detector, parameters: TrackParameters, believable: Believable | None = None
    ) -> None:
        self._detector = detector
        self._parameters = parameters
        self._believable = believable
        self._changes = Changes(parameters.changed)
        self._next = 0
        # where faces were last seen, how far they moved since the image before, and in which image
        self._last = Found.none()
        self._way = _NO_RINGS
        self._seen = np.empty(0, np.int64)
        self._largest_px = 0.0

    def follow(self, images: Iterable[NDArray[np.uint8]]) -> Iterator[Found]:
        """The faces in each image (height, width), some images later than it was taken in.

        An image must stay as it is until its faces are out.
        """
        block: list[NDArray[np.uint8]] = []
        for i, grey in enumerate(images, self._next):
            block.append(grey)
            if len(block) >= self._parameters.together or i % self._parameters.every == 0:
                found = self._block(block)
                block.clear()
                yield from found
        if block:
            yield from self._block(block)

    def _block(self, images: Sequence[NDArray[np.uint8]]) -> list[Found]:
        """Follow what is known, look for the rest in the last image, and follow that back."""
        start, self._next = self._next, self._next + len(images)
        every = self._followed(images, start)
        new = self._searched(images[-1], self._next - 1)
        if len(new):
            every[-1] = every[-1][places(every[-1], new) < 0]
        way = np.zeros_like(new.rings)
        later, back = new, way
        for i in range(len(images) - 2, -1, -1):
            unknown = places(later, every[i]) < 0
            later, back = later[unknown], back[unknown]
            if not len(later):
                break
            seen, there = self._traced(images[i], later, -back)
            later, back = seen[there], (later.rings - seen.rings)[there]
            every[i] = Found.joined([every[i], later])
            if i == len(images) - 2:
                way[places(later, new)] = back
        self._remember(new, way)
        if len(new):
            every[-1] = Found.joined([every[-1], new])
        return every

    def _followed(self, images: Sequence[NDArray[np.uint8]], start: int) -> list[Found]:
        """The faces seen in the image before, in each of the images."""
        now = np.flatnonzero(self._seen == start - 1)
        n, m = len(images), len(now)
        if not m:
            return [Found.none()] * n
        last, way = self._last.rings[now], self._way[now]
        # all images at once, as if every face kept moving as it did
        expected = self._last[np.tile(now, n)]
        rings = (last + way * np.arange(1, n + 1)[:, None, None, None]).reshape(-1, 4, 2)
        which = np.repeat(np.arange(n), m)
        seen, there = self._detector.again(images, expected.moved(rings), which, reach_px=_STEADY_PX)
        there &= self._near(seen, rings)
        if not there.all():
            seen, there = self._mended(images, now, seen, there)
        self._keep_up(now, seen, there.reshape(n, m), start)
        return [seen[there & (which == i)] for i in range(n)]

    def _mended(
        self,
        images: Sequence[NDArray[np.uint8]],
        now: NDArray[np.intp],
        seen: Found,
        there: NDArray[np.bool_],
    ) -> tuple[Found, NDArray[np.bool_]]:
        """One image after the other where faces did not move as they did before."""
        m = len(now)
        before, last = self._last.rings[now] - self._way[now], self._last.rings[now]
        known = np.ones(m, bool)
        for i in range(len(images)):
            rows = slice(i * m, (i + 1) * m)
            amiss = np.flatnonzero(known & ~there[rows])
            if amiss.size:
                at = i * m + amiss
                found, fine = self._traced(images[i], seen[at].moved(last[amiss]), (last - before)[amiss])
                seen, there[at] = seen.replaced(at[fine], found[fine]), fine
            known = there[rows]
            before, last = last, seen.rings[rows]
        return seen, there

    def _traced(self, grey: NDArray[np.uint8], faces: Found, way: Floats) -> tuple[Found, NDArray[np.bool_]]:
        """Faces of a neighbouring image in this one, by how far they moved there; and which of them are here."""
        expected = faces.moved(faces.rings + way)
        here = np.zeros(len(faces), np.intp)
        seen, there = self._detector.again([grey], expected, here, reach_px=self._parameters.reach_px)
        there &= self._near(seen, expected.rings)
        if there.all():
            return seen, there
        regions = merged(
            [around(f, w, grey.shape) for f, w in zip(faces.rings[~there], way[~there], strict=True)]
        )
        found = self._detector.read(grey, self._candidates(grey, regions, seen.rings[there]))
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

    def _keep_up(self, now: NDArray[np.intp], seen: Found, there: NDArray[np.bool_], start: int) -> None:
        """Remember faces (m,) that were measured in images (n * m), and in which of these they were (n, m)."""
        met = np.flatnonzero(there.any(0))
        newest = len(there) - 1 - np.argmax(there[::-1, met], axis=0)
        rows, faces = newest * len(now) + met, now[met]
        rings = np.concatenate([self._last.rings[now], seen.rings])
        moved = rings[rows + len(now)] - rings[rows]
        steady = there[newest - 1, met] | (newest == 0)
        self._way[faces] = np.where(steady[:, None, None], moved, 0.0)
        self._last = self._last.replaced(faces, seen[rows])
        self._seen[faces] = start + newest

    def _searched(self, grey: NDArray[np.uint8], image: int) -> Found:
        """Faces in the image that were not followed into it."""
        tiles = tile_means(grey)
        known = self._seen == image
        if image % self._parameters.every == 0:
            self._changes.all_seen(tiles)
            regions = [(0, 0, grey.shape[1], grey.shape[0])]
        else:
            size = grey.shape[0], grey.shape[1]
            regions = [grown(r, self._margin_px(), size) for r in self._changes.look(tiles)]
            lately = ~known & (self._seen >= image - self._parameters.together)
            lost = zip(self._last.rings[lately], self._way[lately], strict=True)
            regions += [around(ring, way, grey.shape) for ring, way in lost]
        rings = np.concatenate(
            [self._last.rings[~known], self._candidates(grey, merged(regions), self._last.rings)]
        )
        # no farther than a search reaches: beyond a face that is seen from the side lies the edge of another
        found = self._detector.read(grey, rings)
        return found[self._believed(found, image)] if len(found) else found

    def _candidates(self, grey: NDArray[np.uint8], regions: Sequence[Region], known: Floats) -> Floats:
        """Rings in regions of the image that are not at known places: those would lead to the same edges."""
        some = [self._detector.candidates(grey, r) for r in regions if r[0] < r[2] and r[1] < r[3]]
        rings = np.concatenate([_NO_RINGS, *some])
        return rings[~same_place(rings, known, _SAME_PX)]

    def _margin_px(self) -> float:
        """A face that appears may change the image only at one end: the rest of it has to be in view too."""
        return max(4 * TILE_PX, self._largest_px)

    def _believed(self, found: Found, image: int) -> NDArray[np.bool_]:
        """Faces that were not expected have to be convincing, and agree with whatever else is known."""
        place = places(found, self._last)
        fine = place >= 0
        at = place[fine]
        # what was followed is there already, unless this is clearer
        twice = (self._seen[at] == image) & (found.likeness[fine] <= self._last.likeness[at])
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
        image = self._next - 1
        left = (places(self._last, new) < 0) & (self._seen > image - self._parameters.patience)
        if len(new) or not left.all():
            self._last = Found.joined([new, self._last[left]])
            self._way = np.concatenate([way, self._way[left]])
            self._seen = np.concatenate([np.full(len(new), image), self._seen[left]])
        if len(new):
            self._largest_px = max(self._largest_px, float(np.ptp(new.rings, axis=1).max()))


def track_markers(
    color: Images, parameters: TrackParameters | None = None, depth: Images | None = None
) -> pa.Table:
    """The table ``markers_2d``: a row for every face in every image, of the boxes that were seen often enough.

    One object per box, by the name of :func:`object_ids`.  With depth images, a face that is not as far away as its
    size says is not believed.

    Raises
    ------
    InputError : two faces of the prototypes cannot be told apart.
    CorruptError : the images cannot be decoded any further.
    """
    parameters = parameters or TrackParameters()
    detector = Detector(
        parameters.prototypes, color.camera, mirrored=parameters.mirrored, evidence=parameters.evidence
    )
    gauge = (
        None
        if depth is None
        else DepthGauge(
            detector, color, depth, depth_m=parameters.depth_m, depth_share=parameters.depth_share
        )
    )
    tracker = Tracker(detector, parameters, gauge)
    parts: list[FoundInAll] = []
    joined = 0
    for i, faces in enumerate(tracker.follow(map(_grey, color))):
        if len(faces):
            parts.append(FoundInAll.of(i, faces))
        if len(parts) - joined >= _KEPT_APART:
            # an hour of small arrays is many times as large as its numbers
            parts[joined:] = [FoundInAll.joined(parts[joined:])]
            joined += 1
    tables = _tables(FoundInAll.joined(parts), detector, color, parameters) if parts else ()
    return pa.concat_tables([MARKERS_2D.arrow.empty_table(), *tables])


def object_ids(prototypes: Sequence[BoxPrototype]) -> list[str]:
    """The object that each box becomes: its name in lower case, everything but letters and digits as ``_``.

    "Stella Artois" becomes ``stella_artois``; of boxes with the same name, the later ones are numbered.
    """
    found: list[str] = []
    for prototype in prototypes:
        name = re.sub(r"\W+", "_", prototype.name.lower()).strip("_") or "box"
        same = sum(1 for other in found if other == name or re.fullmatch(re.escape(name) + r"_\d+", other))
        found.append(f"{name}_{same + 1}" if same else name)
    return found


def _grey(image: NDArray[Any]) -> NDArray[np.uint8]:
    import cv2

    return np.asarray(image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


def _seen_enough(images: NDArray[np.int32], n_images: int, parameters: TrackParameters) -> bool:
    """Whether there are enough sightings (ascending image numbers) among some consecutive images."""
    seen = np.unique(images)
    # a recording of a few images cannot show more
    needed = max(1, min(parameters.sightings, n_images))
    return bool((seen[needed - 1 :] - seen[: max(len(seen) - needed + 1, 0)] < parameters.within).any())


def _tables(
    seen: FoundInAll, detector: Detector, color: Images, parameters: TrackParameters
) -> Iterator[pa.Table]:
    """The rows of the boxes that were seen often enough, those of some images at a time."""
    for box in np.unique(seen.box):
        if not _seen_enough(seen.image[seen.box == box], len(color), parameters):
            seen = seen[seen.box != box]
    first = np.searchsorted(seen.image, np.arange(0, len(color) + _AT_ONCE, _AT_ONCE))
    for start, end in pairwise(first.tolist()):
        yield _table(seen[start:end], detector, color, parameters)


def _table(found: FoundInAll, detector: Detector, color: Images, parameters: TrackParameters) -> pa.Table:
    ids, images = np.array(parameters.objects or object_ids(detector.prototypes), object), found.image
    x, y = found.rings[..., 0], found.rings[..., 1]
    area = 0.5 * np.abs((x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y).sum(1))
    names, frame = ids[found.box], np.asarray(color.frame)[images]
    by = np.lexsort((found.face, -area, names.astype(str), frame))
    images, found, names, frame = images[by], found[by], names[by], frame[by]
    marker = np.flatnonzero(np.r_[True, (np.diff(frame) != 0) | (names[1:] != names[:-1])]) if len(by) else by
    order = np.arange(len(by)) - np.repeat(marker, np.diff(np.r_[marker, len(by)]))
    # the code is read from the leftmost corner, the ring starts at the least u + v (ECAT 2018 file format §0.4)
    leftmost = from_leftmost(found.rings)[:, 0]
    shown = list(zip(found.box.tolist(), found.face.tolist(), leftmost.tolist(), strict=True))
    codes = {key: detector.code(*key) for key in set(shown)}
    code = [codes[key] for key in shown]
    size = [detector.cells(box, face) for box, face, _ in shown]
    start = np.argmin(found.rings.sum(-1) + 1e-6 * found.rings[..., 0], axis=1)
    rings = np.take_along_axis(found.rings, ((start[:, None] + np.arange(4)) % 4)[..., None], 1)
    times = None if color.t_ns is None else np.asarray(color.t_ns)[images]
    no_text = pa.nulls(len(by), pa.string())
    columns = [
        pa.nulls(len(by), pa.int64()) if times is None else pa.array(times),
        pa.array(frame),
        pa.array(names, pa.string()),
        pa.array(order),
        pa.array(np.ones(len(by), bool)),
        pa.array(size, pa.int16()),
        pa.array(code, pa.string()),
        no_text,
        no_text,
        *(pa.array(column) for column in rings.reshape(-1, 8).T),
    ]
    schema = MARKERS_2D.arrow
    return pa.Table.from_arrays(
        [column.cast(f.type) for column, f in zip(columns, schema, strict=True)], schema=schema
    )


def run_track(tables: Tables, images: ImagesByKind, parameters: TrackParameters) -> dict[str, pa.Table]:
    """The stage: ``markers_2d`` of the colour images, with the depth images where there are any."""
    del tables
    return {"markers_2d": track_markers(images["color"], parameters, images.get("depth"))}


def _what_is_looked_for(parameters: TrackParameters) -> TrackParameters:
    """The parameters with nothing of the boxes but their codes: where on a box a marker sits changes no sighting."""
    return replace(
        parameters,
        prototypes=tuple(
            BoxPrototype(
                box.name,
                (1.0, 1.0, 1.0),
                tuple(MarkerFace(f.face, f.code, 1.0, _ORIGIN, _LEVEL) for f in box.faces),
            )
            for box in parameters.prototypes
        ),
    )


TRACK = Stage(
    name="track",
    version=3,
    inputs=(),
    images=("color", "depth"),
    outputs=("markers_2d",),
    parameters=TrackParameters,
    run=run_track,
    optional=("depth",),
    recorded=_what_is_looked_for,
)
"""The stage that finds the markers."""
