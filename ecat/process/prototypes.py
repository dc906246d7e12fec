"""Box prototypes: calibrated from recordings, kept in a file, handed to the stages."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from ecat.errors import EcatError, FormatError, InputError, LimitError, SchemaError, os_error
from ecat.model.prototype import BoxPrototype
from ecat.process.inputs import (
    StageImages,
    color_camera,
    has_marks,
    image_stream,
    mark_noise,
    sane,
    session_camera,
    table_surface,
    was_tracked,
)
from ecat.progress import Progress, silent
from ecat.store import Session, open_session, staged_file, write_new_file

if TYPE_CHECKING:
    from ecat.stages.calibrate import Recording

MAX_BYTES = 4 << 20
MAX_BOXES = 1000
_MAX_PROBLEMS = 100
_VERSION = 1
_HEAD = b'{\n  "version"'


def write_prototypes(path: Path, prototypes: Sequence[BoxPrototype]) -> None:
    """Save prototypes as JSON, replacing the file if it is there."""
    document = {"version": _VERSION, "boxes": [box.to_dict() for box in prototypes]}
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    with staged_file(path, replaces=_HEAD) as staging:
        write_new_file(staging, [text.encode()])


def read_prototypes(path: Path) -> tuple[BoxPrototype, ...]:
    """Read what :func:`write_prototypes` wrote.

    Raises
    ------
    FormatError : the file is not JSON of that kind.
    SchemaError : a prototype in it is not valid (every problem is listed), or it is of another version.
    LimitError : it is larger than 4 MiB, or has more than a thousand boxes.
    """
    what = f"cannot read the prototypes in {path}"
    try:
        if path.exists() and not path.is_file():
            raise FormatError(what, where="not a regular file", fix="name a file written by ecat calibrate")
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise os_error(error, what, path) from error
    if len(data) > MAX_BYTES:
        raise LimitError(
            what, where=f"more than {MAX_BYTES:,} bytes", fix="name a file written by ecat calibrate"
        )
    try:
        document = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise FormatError(what, where=str(error), fix="name a file written by ecat calibrate") from None
    known = isinstance(document, dict) and isinstance(document.get("boxes"), list) and "version" in document
    if not known or not document["boxes"]:
        where = f'expected {{"version": {_VERSION}, "boxes": [...]}}'
        raise FormatError(what, where=where, fix="ecat calibrate writes such a file")
    version = document["version"]
    if type(version) is not int or version != _VERSION:
        newer = isinstance(version, int) and version > _VERSION
        raise SchemaError(
            what,
            problems=(f"version: {str(version)[:20]}, this ecat knows version {_VERSION}",),
            consequence="no prototype was loaded",
            fix="upgrade ecat" if newer else "calibrate the boxes again",
        )
    return _boxes_of(document["boxes"], what)


def _boxes_of(rows: Sequence[object], what: str) -> tuple[BoxPrototype, ...]:
    if len(rows) > MAX_BOXES:
        where = f"{len(rows):,} boxes, at most {MAX_BOXES:,} are read"
        raise LimitError(what, where=where, fix="name a file written by ecat calibrate")
    boxes: list[BoxPrototype] = []
    problems: list[str] = []
    for i, box in enumerate(rows):
        try:
            boxes.append(BoxPrototype.from_dict(box))
        except SchemaError as error:
            problems += [f"boxes[{i}].{problem}" for problem in error.problems]
    if problems:
        raise SchemaError(
            what,
            problems=tuple(problems[:_MAX_PROBLEMS]),
            consequence="no prototype was loaded",
            fix="calibrate the boxes again, or correct the fields named above",
        )
    return tuple(boxes)


def kept_prototypes(session: Session) -> tuple[BoxPrototype, ...]:
    """The boxes kept in a session.

    Raises
    ------
    SchemaError : one of them is not valid; every problem is listed.
    """
    what = f"cannot use the prototypes of {session.name}"
    return _boxes_of(session.manifest.prototypes, what)


def recordings_of(session: Session, images: StageImages | None = None) -> list[Recording]:
    """What calibration needs of a session: one recording for each place that the camera had.

    None if the session has no marks, or some of a camera that nobody knows.  Where the table is seen in depth, that
    tells the scale, to which colour images are blind.

    Parameters
    ----------
    images : those of the session, if they are open already.
    """
    from ecat.stages.calibrate import Recording, recordings_on
    from ecat.stages.plane import polygon_points

    if not session.has_table("markers_2d") or (was_tracked(session) and color_camera(session) is None):
        return []
    marks = sane(session.table("markers_2d").to_arrow())
    marks_3d = sane(session.table("markers_3d").to_arrow()) if session.has_table("markers_3d") else None
    plane = None
    if image_stream(session, "depth") is not None:
        with StageImages(session) if images is None else contextlib.nullcontext(images) as opened:
            plane = _plane_in_depth(session, opened, marks, marks_3d)
    if plane is None:
        polygon = polygon_points(sane(session.keyframes.to_arrow()), table_surface(session))
        return [Recording(marks, marks_3d, polygon)]
    return recordings_on(plane, marks, marks_3d)


def _plane_in_depth(
    session: Session, images: StageImages, marks: pa.Table, marks_3d: pa.Table | None
) -> pa.Table | None:
    """The table as depth shows it, found by boxes as they should be; None where it shows no table."""
    from ecat.stages.plane import PLANE, PlaneParameters

    tables = {"keyframes": sane(session.keyframes.to_arrow()), "markers_2d": marks}
    if marks_3d is not None:
        tables["markers_3d"] = marks_3d
    parameters = PlaneParameters(
        camera=session_camera(session), noise=mark_noise(session), surface=table_surface(session)
    )
    with contextlib.suppress(InputError, np.linalg.LinAlgError), np.errstate(all="ignore"):
        plane = PLANE.run(tables, images.of(PLANE), parameters)["table_plane"]
        return plane if "depth" in plane["evidence"][0].as_py() else None
    return None


def to_be_tracked(paths: Iterable[Path], *, again: bool = True) -> set[Path]:
    """The sessions in whose videos marks are looked for, if there are sessions without boxes to be measured by them.

    Parameters
    ----------
    again : those whose marks were found before as well, as that may be out of date; else only those that have none
        and can be opened: nobody waits for a video that is damaged.
    """
    sessions: list[Session] = []
    for path in paths:
        with contextlib.suppress(EcatError):
            sessions.append(open_session(path))
    if all(session.manifest.prototypes for session in sessions):
        return set()
    return {session.path for session in sessions if _has_video(session) and (again or _waits(session))}


def _waits(session: Session) -> bool:
    if session.has_table("markers_2d"):
        return False
    from ecat.stages.track import TRACK

    with contextlib.suppress(EcatError, OSError), StageImages(session) as images:
        return bool(images.of(TRACK))
    return False


def _has_video(session: Session) -> bool:
    record = session.manifest.table("markers_2d")
    return image_stream(session, "color") is not None and (record is None or bool(record.stage))


def calibrate_together(
    paths: Sequence[Path], progress: Progress = silent
) -> dict[Path, tuple[BoxPrototype, ...]]:
    """Boxes for the sessions that have marks but no boxes yet, from all sessions of the same camera together.

    The more sessions show a box, the better it is known; and what an interrupted run left undone gets the boxes that
    it would have got.  Sessions whose boxes cannot be calibrated are left out.
    """
    from ecat.stages.calibrate import ENOUGH, sufficient

    by_camera: dict[str, list[Session]] = {}
    for path in paths:
        # what is wrong with a session is said where that session is processed
        with contextlib.suppress(EcatError):
            session = open_session(path)
            if has_marks(session):
                by_camera.setdefault(_eye(session), []).append(session)
    found: dict[Path, tuple[BoxPrototype, ...]] = {}
    for group in by_camera.values():
        bare = [session.path for session in group if not session.manifest.prototypes]
        if not bare:
            continue
        recordings: list[Recording] = []
        # chosen before they are read, since the table is looked for in the depth of each
        chosen = sufficient(group, _codes, ENOUGH)
        for done, session in enumerate(chosen):
            progress("reading marks", done, len(chosen))
            with contextlib.suppress(EcatError):
                recordings += recordings_of(session)
        progress("calibrating the boxes", len(chosen), len(chosen))
        with contextlib.suppress(InputError):
            found |= dict.fromkeys(bare, boxes_in(recordings, group[0]))
    return found


def _codes(session: Session) -> pa.Table:
    """The codes of its marks; none where they cannot be read, which is said where the session is processed."""
    with contextlib.suppress(EcatError):
        return session.table("markers_2d", columns=["code"]).to_arrow()
    return pa.table({"code": pa.array([], pa.string())})


def _eye(session: Session) -> str:
    """What sessions must have in common to be calibrated together: the camera, and what found the marks."""
    return f"{color_camera(session)!r} {mark_noise(session)!r}"


def boxes_in(recordings: Sequence[Recording], session: Session) -> tuple[BoxPrototype, ...]:
    """The boxes of the recordings, calibrated together, with the camera and the detector of ``session``.

    Raises
    ------
    InputError : no box shows two faces at once often enough, or the marks are so that no box fits them.
    """
    from ecat.stages.calibrate import CalibrationParameters, calibrate_boxes

    parameters = CalibrationParameters(camera=session_camera(session), noise=mark_noise(session))
    try:
        with np.errstate(all="ignore"):
            return calibrate_boxes(recordings, parameters).prototypes
    except np.linalg.LinAlgError as error:
        raise InputError(
            "cannot calibrate the boxes",
            where=f"no box fits the marks ({error})",
            consequence="no prototype was made",
            fix="ecat check says which marks cannot be right",
        ) from error


def calibrate(paths: Iterable[Path], progress: Progress = silent) -> tuple[BoxPrototype, ...]:
    """Calibrate the boxes of several sessions together; all must have the same camera.

    Raises
    ------
    InputError : no session shows a box from two sides, or their cameras differ.
    """
    recordings: list[Recording] = []
    cameras: dict[str, Session] = {}
    found = list(paths)
    for done, path in enumerate(found):
        progress("reading marks", done, len(found))
        session = open_session(path)
        if found_there := recordings_of(session):
            recordings += found_there
            cameras[_eye(session)] = session
    progress("calibrating the boxes", len(found), len(found))
    if not recordings:
        raise InputError(
            "cannot calibrate the boxes",
            where=f"none of {len(found)} sessions has marks of boxes, seen by a known camera",
            consequence="no prototype was made",
            fix="import a recording with marked boxes",
        )
    if len(cameras) > 1:
        raise InputError(
            "cannot calibrate the boxes",
            where=f"the sessions were recorded by {len(cameras)} different cameras",
            consequence="no prototype was made",
            fix="calibrate the sessions of one camera at a time",
        )
    return boxes_in(recordings, next(iter(cameras.values())))
