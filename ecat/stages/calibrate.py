"""The geometry of marked boxes from recordings of them: which face is where, marker sizes, offsets and
turns.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from ecat.errors import InputError
from ecat.geometry.boxes import identify, match_codes
from ecat.geometry.boxfit import Noise
from ecat.geometry.bundle import Priors, Track, adjust
from ecat.geometry.cameras import KINECT_V2_COLOR, Camera
from ecat.geometry.layout import find_layout, laid_out
from ecat.geometry.planes import fit_plane, plane_frame
from ecat.geometry.transforms import Floats, Rigid
from ecat.model.prototype import FACES, NOMINAL_BOXES, BoxPrototype, Triple, nominal_face
from ecat.stages.plane import standing_points
from ecat.stages.sightings import BoxSightings, Faces, box_sightings, read_faces


@dataclass(frozen=True)
class Recording:
    """What calibration reads of a session: marker tables, and points (n, 3) on the table in
    ``camera/depth``.
    """

    markers_2d: pa.Table
    markers_3d: pa.Table | None = None
    polygon: Floats = field(default_factory=lambda: np.empty((0, 3)))


@dataclass(frozen=True)
class CalibrationParameters:
    """``known`` boxes lend their name and size to the box that carries their codes; ``size_m`` is that of all
    others: images alone do not show how large a thing is.  ``every``: share of frames used;
    ``min_sightings``: a code seen less often is taken for a misreading.
    """

    known: tuple[BoxPrototype, ...] = NOMINAL_BOXES
    camera: Camera = KINECT_V2_COLOR
    noise: Noise = field(default_factory=Noise)
    priors: Priors = field(default_factory=Priors)
    size_m: Triple = (0.1524, 0.1524, 0.1524)
    side_m: float = 0.089
    every: int = 6
    min_sightings: int = 30


@dataclass(frozen=True)
class Calibration:
    """Calibrated prototypes, the tables (camera-from-table) of the recordings that show them, and what is left: the
    median distance of a corner from where it should be, in pixels.
    """

    prototypes: tuple[BoxPrototype, ...]
    tables: tuple[Rigid, ...]
    residual_px: float


def calibrate_boxes(
    recordings: Sequence[Recording], parameters: CalibrationParameters | None = None
) -> Calibration:
    """Calibrate all boxes that occur in the recordings, together; boxes should mostly stand on a table.

    Raises
    ------
    InputError : no box shows two faces at once often enough to tell its geometry.
    """
    parameters = parameters or CalibrationParameters()
    faces = [read_faces(r.markers_2d, r.markers_3d, parameters.camera) for r in recordings]
    drawn = [_drawn_table(r.polygon) for r in recordings]
    boxes = [
        laid
        for unplaced in _boxes(faces, parameters)
        if (laid := _laid_out(unplaced, faces, drawn, parameters)) is not None
    ]
    if not boxes:
        raise InputError(
            "cannot calibrate the boxes",
            where=f"{sum(len(f.frame) for f in faces)} marker faces in {len(recordings)} recordings",
            consequence="no prototype was made",
            fix="record the boxes so that two or three faces are seen at once",
        )
    seen = [box_sightings(f, boxes, parameters.camera, parameters.noise) for f in faces]
    # a recording that shows none of them says nothing, and may not even have a table
    used = [i for i, shown in enumerate(seen) if any(np.isfinite(box.seen.pixels).any() for box in shown)]
    tables = [drawn[i] or _standing_table(seen[i], boxes, parameters) for i in used]
    tracks = [
        Track(table, box.prototype, box.seen[:: parameters.every])
        for table, i in enumerate(used)
        for box in seen[i]
    ]
    bundle = adjust(
        tracks,
        tables,
        boxes,
        parameters.camera,
        parameters.noise,
        polygons=[recordings[i].polygon for i in used],
        priors=parameters.priors,
    )
    return Calibration(bundle.prototypes, bundle.tables, bundle.residual_px)


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
