"""The stage that turns a video into the table of marker faces that the next stages read."""

from __future__ import annotations

import re
from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.geometry.boxes import from_leftmost
from ecat.geometry.detection import Detector, Found
from ecat.model.prototype import BoxPrototype, MarkerFace
from ecat.stages.depth_gauge import DepthGauge
from ecat.stages.images import Images, ImagesByKind
from ecat.stages.sightings import FoundInAll
from ecat.stages.stage import Stage, Tables
from ecat.stages.tracker import Tracker, TrackParameters
from ecat.tables import MARKERS_2D

_ORIGIN, _LEVEL = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
_AT_ONCE = 512


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
    found = _Tracks(detector, color, parameters)
    for i, faces in enumerate(tracker.follow(map(_grey, color))):
        found.add(i, faces)
    return found.table()


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


class _Tracks:
    """The rows of ``markers_2d``, made while the video is looked at: what is found in an hour is larger than they."""

    def __init__(self, detector: Detector, color: Images, parameters: TrackParameters) -> None:
        self._detector, self._color, self._parameters = detector, color, parameters
        self._waiting: list[FoundInAll] = []
        self._parts = [MARKERS_2D.arrow.empty_table()]
        # a recording of a few images cannot show more
        needed = max(1, min(parameters.sightings, len(color)))
        self._last: dict[int, deque[int]] = defaultdict(lambda: deque(maxlen=needed))
        self._believed: set[int] = set()

    def add(self, image: int, faces: Found) -> None:
        """The faces found in an image; images come in their order."""
        if not len(faces):
            return
        self._waiting.append(FoundInAll.of(image, faces))
        for box in np.unique(faces.box).tolist():
            last = self._last[box]
            last.append(image)
            if len(last) == last.maxlen and last[-1] - last[0] < self._parameters.within:
                self._believed.add(box)
        if len(self._waiting) >= _AT_ONCE:
            self._settle()

    def table(self) -> pa.Table:
        """All rows of the boxes that were seen often enough."""
        self._settle()
        if self._believed >= self._last.keys():
            return pa.concat_tables(self._parts)
        ids = _names(self._detector, self._parameters)
        believed = pa.array([ids[box] for box in sorted(self._believed)], pa.string())
        return pa.concat_tables(
            part.filter(pc.is_in(part["object_id"].cast(pa.string()), believed)) for part in self._parts
        )

    def _settle(self) -> None:
        if self._waiting:
            found = FoundInAll.joined(self._waiting)
            self._waiting.clear()
            self._parts.append(_table(found, self._detector, self._color, self._parameters))


def _names(detector: Detector, parameters: TrackParameters) -> Sequence[str]:
    """The object that each box is."""
    return parameters.objects or object_ids(detector.prototypes)


def _table(found: FoundInAll, detector: Detector, color: Images, parameters: TrackParameters) -> pa.Table:
    ids, images = np.array(_names(detector, parameters), object), found.image
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
    version=4,
    inputs=(),
    images=("color", "depth"),
    outputs=("markers_2d",),
    parameters=TrackParameters,
    run=run_track,
    optional=("depth",),
    recorded=_what_is_looked_for,
)
"""The stage that finds the markers."""
