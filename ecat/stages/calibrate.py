"""The geometry of marked boxes from recordings of them: which face is where, marker sizes, offsets and
turns.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ecat.errors import InputError
from ecat.geometry.boxes import box_corners, identify, match_codes
from ecat.geometry.boxfit import RESTING, Noise, refine, resting_start
from ecat.geometry.boxpose import scene_of
from ecat.geometry.bundle import Priors, Track, adjust
from ecat.geometry.cameras import KINECT_V2_COLOR, Camera
from ecat.geometry.layout import find_layout, laid_out
from ecat.geometry.planes import fit_plane, plane_frame
from ecat.geometry.poseerror import SteadyErrors
from ecat.geometry.transforms import Floats, Rigid
from ecat.model.prototype import FACES, NOMINAL_BOXES, BoxPrototype, Triple, nominal_face
from ecat.stages.plane import standing_points
from ecat.stages.pose import table_frames
from ecat.stages.sightings import BoxSightings, Faces, box_sightings, read_faces

_T = TypeVar("_T")

ENOUGH = 64
"""More recordings that show a box tell nothing new about it."""


@dataclass(frozen=True)
class Recording:
    """What calibration reads of a session: marker tables, and points (n, 3) on the table in
    ``camera/depth``.
    """

    markers_2d: pa.Table
    markers_3d: pa.Table | None = None
    polygon: Floats = field(default_factory=lambda: np.empty((0, 3)))


_ON_TABLE: Floats = np.stack(np.meshgrid(*2 * [np.linspace(-0.5, 0.5, 10)], [0.0]), -1).reshape(-1, 3)
"""Points on the table that stand for its plane in depth: so many that by ``Priors.polygon_m`` it is known to a
millimetre, which is how well depth shows it."""


def recordings_on(
    table_plane: pa.Table, markers_2d: pa.Table, markers_3d: pa.Table | None = None
) -> list[Recording]:
    """A recording with the plane that depth shows, in pieces for which a row of ``table_plane`` holds."""
    planes = table_frames(table_plane)
    starts = [0, *(frame for frame, _ in planes[1:])]
    pieces: list[Recording] = []
    for (_, table), start, end in zip(planes, starts, [*starts[1:], None], strict=True):
        marks = [
            None if rows is None else rows.filter(_between(start, end)) for rows in (markers_2d, markers_3d)
        ]
        assert marks[0] is not None
        pieces.append(Recording(marks[0], marks[1], table.apply(_ON_TABLE)))
    return pieces


def _between(start: int, end: int | None) -> pc.Expression:
    frame = pc.field("frame")
    return frame >= start if end is None else (frame >= start) & (frame < end)


@dataclass(frozen=True)
class CalibrationParameters:
    """``known`` boxes lend their name and size to the box that carries their codes; ``size_m`` is that of all
    others: images alone do not show how large a thing is.  ``every``: share of frames used;
    ``min_sightings``: a code seen less often is taken for a misreading.  ``off``: a box whose corners are off by more
    standard deviations (root mean square) does not rest on the table as it is taken to; one that does in fewer than
    ``min_rested`` of the frames used is not measured.  ``most``: of so many recordings that show a code, others add
    nothing, see :func:`sufficient`.
    """

    known: tuple[BoxPrototype, ...] = NOMINAL_BOXES
    camera: Camera = KINECT_V2_COLOR
    noise: Noise = field(default_factory=Noise)
    priors: Priors = field(default_factory=Priors)
    size_m: Triple = (0.1524, 0.1524, 0.1524)
    side_m: float = 0.089
    every: int = 6
    min_sightings: int = 30
    off: float = 4.0
    min_rested: int = 5
    most: int = ENOUGH


@dataclass(frozen=True)
class Calibration:
    """Calibrated prototypes, the tables (camera-from-table) of the recordings they are from, and what is left: the
    median distance of a corner from where it should be, in pixels.

    Boxes that were seen, and could not be measured, are among the prototypes as far as they are known; their faces have
    no ``sigma_m``.
    """

    prototypes: tuple[BoxPrototype, ...]
    tables: tuple[Rigid, ...]
    residual_px: float


_FEWEST = 5
"""A code that a recording shows less often is perhaps a misreading."""
_GOLDEN = 0.6180339887498949


def sufficient(recordings: Sequence[_T], marks: Callable[[_T], pa.Table], most: int) -> list[_T]:
    """As many of the recordings, in their order, as show every code ``most`` times, or all that show it.

    What boxes are like is told by 64 recordings as well as by 1,000, but the time to solve for the tables of all grows
    with the cube of their number.  They are chosen all over the sequence, as neighbours are alike, and always the same.

    Parameters
    ----------
    marks : the marks of a recording, a table with the column ``code``; asked for only where there are too many.
    """
    if len(recordings) <= most:
        return list(recordings)
    shown: Counter[str] = Counter()
    chosen: list[int] = []
    # multiples of the golden ratio fill an interval evenly, however many there are
    for i in sorted(range(len(recordings)), key=lambda i: (i * _GOLDEN) % 1.0):
        column: Any = marks(recordings[i])["code"]
        counts = column.value_counts().to_pylist()
        codes = [row["values"] for row in counts if row["values"] is not None and row["counts"] >= _FEWEST]
        if any(shown[code] < most for code in codes):
            shown.update(codes)
            chosen.append(i)
    return [recordings[i] for i in sorted(chosen)]


def calibrate_boxes(
    recordings: Sequence[Recording], parameters: CalibrationParameters | None = None
) -> Calibration:
    """Calibrate all boxes that occur in the recordings, together, by the frames in which they rest on a table.

    Raises
    ------
    InputError : no box shows two faces at once often enough to tell its geometry, while it rests.
    """
    parameters = parameters or CalibrationParameters()
    recordings = sufficient(recordings, lambda recording: recording.markers_2d, parameters.most)
    faces = [read_faces(r.markers_2d, r.markers_3d, parameters.camera) for r in recordings]
    drawn = [_drawn_table(r.polygon) for r in recordings]
    unplaced = _boxes(faces, parameters)
    boxes = [_laid_out(box, faces, drawn, parameters) for box in unplaced]
    laid = [box for box in boxes if box is not None]
    seen = [box_sightings(f, laid, parameters.camera, parameters.noise) for f in faces]
    # a recording that shows none of them says nothing, and may not even have a table
    used = [i for i, shown in enumerate(seen) if any(np.isfinite(box.seen.pixels).any() for box in shown)]
    tables = [drawn[i] or _standing_table(seen[i], laid, parameters) for i in used]
    tracks = Track.joined(
        [
            Track(table, box.prototype, box.seen[:: parameters.every])
            for table, i in enumerate(used)
            for box in seen[i]
        ]
    )
    polygons = [recordings[i].polygon for i in used]
    measured = _measured(tracks, tables, laid, polygons, parameters)
    if measured is None:
        raise InputError(
            "cannot calibrate the boxes",
            where=f"{sum(len(f.frame) for f in faces)} marker faces in {len(recordings)} recordings",
            consequence="no prototype was made",
            fix="record the boxes standing on the table so that two or three faces are seen at once",
        )
    known = {box.name: box for box in parameters.known}
    alone = [
        known[box.name]
        for box, placed in zip(unplaced, boxes, strict=True)
        if placed is None and box.name in known
    ]
    return replace(measured, prototypes=(*measured.prototypes, *alone))


def _measured(
    tracks: Sequence[Track],
    tables: Sequence[Rigid],
    boxes: Sequence[BoxPrototype],
    polygons: Sequence[Floats],
    parameters: CalibrationParameters,
) -> Calibration | None:
    """What the frames say in which boxes rest; None if none does often enough, or no corner is where it should be.

    Which those are is told by boxes as they should be, and then by boxes as they were measured.
    """
    now, planes, found = tuple(boxes), tuple(tables), None
    for sharp in (False, True):
        rested = [_rested(track, planes, now, parameters, sharp=sharp) for track in tracks]
        often = np.zeros(len(boxes), np.int64)
        np.add.at(often, [track.box for track in rested], [len(track) for track in rested])
        enough = often >= parameters.min_rested
        if not enough.any():
            return None
        bundle = adjust(
            [track for track in rested if enough[track.box] and len(track)],
            planes,
            now,
            parameters.camera,
            parameters.noise,
            polygons=polygons,
            priors=parameters.priors,
        )
        if np.isnan(bundle.residual_px):
            return None
        now, planes = bundle.prototypes, bundle.tables
        kept = tuple(new if ok else old for new, old, ok in zip(now, boxes, enough, strict=True))
        found = Calibration(kept, planes, bundle.residual_px)
    return found


def _rested(
    track: Track,
    tables: Sequence[Rigid],
    boxes: Sequence[BoxPrototype],
    parameters: CalibrationParameters,
    *,
    sharp: bool,
) -> Track:
    """The frames in which the box rests on its table; ``sharp``: by markers that were measured.  Those that show only
    3-D corners cannot be judged, and count as well.
    """
    box = boxes[track.box]
    camera, noise = parameters.camera, parameters.noise
    scene = track.scene(tables, box_corners(box), box.size_m[2] / 2, camera)
    sigma_px: float | Floats = noise.sigma_px
    if not sharp:
        blurred = [SteadyErrors().image_noise(noise, box, scene_of(box, camera, table)) for table in tables]
        sigma_px = np.array(blurred)[track.table]
    errors = refine(track.seen, scene, resting_start(track.seen, scene), noise, freedom=RESTING).errors_px
    seen = np.isfinite(errors)
    square = np.where(seen, errors, 0.0) ** 2 / 2
    rms = np.sqrt(square.sum((1, 2)) / np.maximum(seen.sum((1, 2)), 1))
    return track[rms <= parameters.off * sigma_px]


def _drawn_table(polygon: Floats) -> Rigid | None:
    if np.isfinite(polygon).all(-1).sum() < 3:
        return None
    plane = fit_plane(polygon)
    return plane_frame(plane.normal, plane.offset)


def _standing_table(
    seen: list[BoxSightings], boxes: Sequence[BoxPrototype], parameters: CalibrationParameters
) -> Rigid:
    plane = fit_plane(standing_points(seen, boxes, parameters.camera), tolerance_m=0.03)
    return plane_frame(plane.normal, plane.offset)


def _boxes(faces: Sequence[Faces], parameters: CalibrationParameters) -> list[BoxPrototype]:
    """One prototype per box with its codes on arbitrary faces: names and codes are right, places are not."""
    found: list[BoxPrototype] = []
    mirrored = parameters.camera.mirrored
    for recording in faces:
        by_object: dict[str, Counter[str]] = {}
        for object_id, code in zip(recording.object_id, recording.code, strict=True):
            by_object.setdefault(object_id, Counter())[code] += 1
        for object_id, counts in sorted(by_object.items()):
            printed = _printed_codes(counts, parameters)
            if not printed or match_codes(list(counts), found, mirrored=mirrored):
                continue
            known = match_codes(list(counts), parameters.known, mirrored=mirrored)
            votes = Counter(known[code][0] for code in counts.elements() if code in known)
            model = parameters.known[votes.most_common(1)[0][0]] if votes else None
            name, size = (model.name, model.size_m) if model else (object_id, parameters.size_m)
            places = zip(FACES, printed, strict=False)
            faces_of = tuple(nominal_face(face, code, parameters.side_m, size) for face, code in places)
            found.append(BoxPrototype(name, size, faces_of))
    return found


def _printed_codes(counts: Counter[str], parameters: CalibrationParameters) -> list[str]:
    """The patterns of one object as printed, each once however it was turned, the most frequent six."""
    mirrored = parameters.camera.mirrored
    known = [face.code for box in parameters.known for face in box.faces]
    total: Counter[str] = Counter()
    for code, count in counts.items():
        patterns = [*known, *total]
        total[
            next(
                (p for p in patterns if identify(code, p, mirrored=mirrored) is not None),
                _unmirrored(code, mirrored=mirrored),
            )
        ] += count
    return [code for code, count in total.most_common(6) if count >= parameters.min_sightings]


def _unmirrored(code: str, *, mirrored: bool) -> str:
    n = math.isqrt(len(code))
    rows = [code[i : i + n] for i in range(0, len(code), n)]
    return "".join(row[::-1] if mirrored else row for row in rows)


def _laid_out(
    box: BoxPrototype,
    faces: Sequence[Faces],
    drawn: Sequence[Rigid | None],
    parameters: CalibrationParameters,
) -> BoxPrototype | None:
    """The box with its markers on the right faces; None if they are never seen together."""
    pixels: list[Floats] = []
    up: list[Floats] = []
    for recording, table in zip(faces, drawn, strict=True):
        hint = table.rotation[:, 2] if table is not None else np.array([0.0, -1.0, 0.0])
        for sightings in box_sightings(recording, [box], parameters.camera, parameters.noise):
            some = sightings.seen.pixels[:: parameters.every]
            pixels.append(some)
            up.append(np.broadcast_to(hint, (len(some), 3)))
    layout = find_layout(np.concatenate(pixels), parameters.camera, np.concatenate(up))
    if np.isfinite(layout.turns[:, 0, 0]).sum() < 2:
        return None
    return laid_out(box.name, box.size_m, [f.code for f in box.faces], layout, side_m=parameters.side_m)
