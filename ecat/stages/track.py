"""Marker faces in a video: found anywhere now and then, followed in between (thesis §3.4).

The whole image is searched every so many frames.  In between, each face is measured again where it is expected, and
only those parts of the image are searched that have changed since they were last looked at, or where a face is
missing: a picture that stays the same shows nothing new.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.geometry.boxes import from_leftmost
from ecat.geometry.changes import TILE_PX, Changes, Region, grown, merged, tile_means
from ecat.geometry.detection import Detector, Evidence, Found, face_keys, same_place
from ecat.geometry.transforms import Floats
from ecat.model.prototype import NOMINAL_BOXES, BoxPrototype, MarkerFace
from ecat.stages.images import Images, ImagesByKind
from ecat.stages.stage import Stage, Tables
from ecat.tables import MARKERS_2D

# candidates are roughly placed; the edges of one that is as near as this are within reach
_SAME_PX = 2.0
_ORIGIN, _LEVEL = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
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
    changed: int = 8
    reach_px: float = 4.0
    patience: int = 15
    sightings: int = 5
    within: int = 60
    depth_m: float = 0.05
    depth_share: float = 0.15
    mirrored: bool | None = None


class Tracker:
    """Follows faces from image to image; keeps nothing but where each was last seen."""

    def __init__(
        self, detector: Detector, parameters: TrackParameters, believable: Believable | None = None
    ) -> None:
        self._detector = detector
        self._parameters = parameters
        self._believable = believable
        self._changes = Changes(parameters.changed)
        self._image = -1
        # where faces were last seen, how far they moved since the frame before, and in which frame
        self._last = Found.none()
        self._way = _NO_RINGS
        self._seen = np.empty(0, np.int64)
        self._largest_px = 0.0

    def __call__(self, grey: NDArray[np.uint8]) -> Found:
        """The faces in the next image (height, width)."""
        self._image += 1
        tiles = tile_means(grey)
        expected = self._expected()
        if self._image % self._parameters.every == 0:
            self._changes.all_seen(tiles)
            rings = [self._detector.candidates(grey)]
        else:
            rings = [self._detector.candidates(grey, r) for r in self._where_to_look(grey.shape, tiles)]
        others = np.concatenate([_NO_RINGS, *rings])
        # a candidate at an expected place would lead to the same edges
        others = others[~same_place(others, expected.rings, _SAME_PX)]
        every = np.concatenate([expected.rings, others])
        found = self._detector.read(grey, every, reach_px=self._parameters.reach_px)
        found = found[self._believed(found, expected)]
        self._remember(found, expected)
        return found

    def _expected(self) -> Found:
        """The faces seen lately, each where it should be now if it keeps moving as it did."""
        moving = (self._seen == self._image - 1)[:, None, None]
        rings = self._last.rings + np.where(moving, self._way, 0.0)
        last = self._last
        return Found(last.box, last.face, rings, last.sigma_px, last.likeness)

    def _where_to_look(self, shape: tuple[int, ...], tiles: NDArray[np.uint8]) -> Iterator[Region]:
        size = shape[0], shape[1]
        regions = [grown(r, self._margin_px(), size) for r in self._changes.look(tiles)]
        lost = self._seen == self._image - 2
        for ring, way in zip(self._last.rings[lost], self._way[lost], strict=True):
            far = np.ptp(ring, axis=0).max() / 2 + 3 * np.abs(way).max() + TILE_PX
            low, high = ring.min(0), ring.max(0)
            regions.append(grown((int(low[0]), int(low[1]), int(high[0]) + 1, int(high[1]) + 1), far, size))
        yield from (r for r in merged(regions) if r[0] < r[2] and r[1] < r[3])

    def _margin_px(self) -> float:
        """A face that appears may change the image only at one end: the rest of it has to be in view too."""
        return max(4 * TILE_PX, self._largest_px)

    def _believed(self, found: Found, expected: Found) -> NDArray[np.bool_]:
        """Faces that were not expected have to be convincing, and agree with whatever else is known."""
        place = _places(found, expected)
        fine = place >= 0
        gone = np.abs(found.rings[fine] - expected.rings[place[fine]]).max((1, 2))
        fine[fine] = gone <= 2 * self._parameters.reach_px
        if not fine.all():
            new = np.flatnonzero(~fine)
            new = new[self._detector.convincing(found[new])]
            if self._believable is not None and new.size:
                new = new[self._believable(self._image, found[new])]
            fine[new] = True
        return fine

    def _remember(self, found: Found, expected: Found) -> None:
        # what is expected are the last faces, in the same order
        place = _places(found, expected)
        met = place >= 0
        met[met] = self._seen[place[met]] == self._image - 1
        way = np.zeros((len(found), 4, 2))
        way[met] = found.rings[met] - self._last.rings[place[met]]
        left = self._seen > self._image - self._parameters.patience
        left[place[place >= 0]] = False
        self._way = np.concatenate([way, self._way[left]])
        self._seen = np.concatenate([np.full(len(found), self._image), self._seen[left]])
        self._last = Found.joined([found, self._last[left]])
        if len(found):
            self._largest_px = max(self._largest_px, float(np.ptp(found.rings, axis=1).max()))


def _places(found: Found, others: Found) -> NDArray[np.intp]:
    """Where each face is among the others (n,), -1 if it is not."""
    at = {key: i for i, key in enumerate(face_keys(others))}
    return np.array([at.get(key, -1) for key in face_keys(found)], np.intp)


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
    gauge = None if depth is None else _DepthGauge(detector, color, depth, parameters)
    tracker = Tracker(detector, parameters, gauge)
    images: list[NDArray[np.int64]] = []
    found: list[Found] = []
    for i, image in enumerate(color):
        faces = tracker(_grey(image))
        if len(faces):
            images.append(np.full(len(faces), i))
            found.append(faces)
    if not found:
        return MARKERS_2D.arrow.empty_table()
    return _table(np.concatenate(images), Found.joined(found), detector, color, parameters)


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


class _DepthGauge:
    """Whether faces are as far away as their size says, by the depth image taken nearest in time."""

    def __init__(self, detector: Detector, color: Images, depth: Images, parameters: TrackParameters) -> None:
        self._detector, self._depth, self._parameters = detector, depth, parameters
        timed = color.t_ns is not None and depth.t_ns is not None
        when, there = (color.t_ns, depth.t_ns) if timed else (color.frame, depth.frame)
        self._when = np.asarray(when, np.int64)
        self._there = np.asarray(there, np.int64)

    def __call__(self, image: int, found: Found) -> NDArray[np.bool_]:
        camera, parameters = self._depth.camera, self._parameters
        fine = np.ones(len(found), bool)
        if camera is None or self._detector.camera is None or not len(self._there):
            return fine
        nearest = int(np.argmin(np.abs(self._there - self._when[image])))
        measured = next(iter(self._depth.read([nearest])), None)
        if measured is None:
            return fine
        # both poses of a square are equally far away
        centre = self._detector.poses(found)[0].translation
        distance = camera.from_reference.apply(centre)[:, 2]
        pixels = camera.project(centre)
        for i, (u, v) in enumerate(pixels):
            inside = np.isfinite(u) and 0 <= u < measured.shape[1] and 0 <= v < measured.shape[0]
            if not inside:
                continue
            column, row = round(float(u)), round(float(v))
            patch = measured[max(row - 2, 0) : row + 3, max(column - 2, 0) : column + 3]
            if (patch > 0).any():
                depth_m = float(np.median(patch[patch > 0])) * self._depth.unit_m
                allowed = parameters.depth_m + parameters.depth_share * depth_m
                fine[i] = abs(distance[i] - depth_m) <= allowed
        return fine


def _seen_enough(images: NDArray[np.int64], n_images: int, parameters: TrackParameters) -> bool:
    """Whether there are enough sightings (ascending image numbers) among some consecutive images."""
    seen = np.unique(images)
    # a recording of a few images cannot show more
    needed = max(1, min(parameters.sightings, n_images))
    return bool((seen[needed - 1 :] - seen[: max(len(seen) - needed + 1, 0)] < parameters.within).any())


def _table(
    images: NDArray[np.int64], found: Found, detector: Detector, color: Images, parameters: TrackParameters
) -> pa.Table:
    ids = np.array(parameters.objects or object_ids(detector.prototypes), object)
    for box in np.unique(found.box):
        if not _seen_enough(images[found.box == box], len(color), parameters):
            kept = found.box != box
            images, found = images[kept], found[kept]
    x, y = found.rings[..., 0], found.rings[..., 1]
    area = 0.5 * np.abs((x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y).sum(1))
    names, frame = ids[found.box], np.asarray(color.frame)[images]
    by = np.lexsort((found.face, -area, names.astype(str), frame))
    images, found, names, frame = images[by], found[by], names[by], frame[by]
    marker = np.flatnonzero(np.r_[True, (np.diff(frame) != 0) | (names[1:] != names[:-1])]) if len(by) else by
    order = np.arange(len(by)) - np.repeat(marker, np.diff(np.r_[marker, len(by)]))
    # the code is read from the leftmost corner, the ring starts at the least u + v (ECAT 2018 file format §0.4)
    leftmost = from_leftmost(found.rings)[:, 0]
    code = [
        detector.code(box, face, first)
        for box, face, first in zip(found.box.tolist(), found.face.tolist(), leftmost.tolist(), strict=True)
    ]
    size = [detector.cells(*key) for key in face_keys(found)]
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
    version=1,
    inputs=(),
    images=("color", "depth"),
    outputs=("markers_2d",),
    parameters=TrackParameters,
    run=run_track,
    optional=("depth",),
    recorded=_what_is_looked_for,
)
"""The stage that finds the markers."""
