"""Box prototypes: calibrated from recordings, kept in a file, handed to the stages."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ecat.errors import EcatError, FormatError, InputError, LimitError, os_error
from ecat.model.prototype import BoxPrototype
from ecat.progress import Progress, silent
from ecat.store import Session, open_session, staged_file, write_new_file

if TYPE_CHECKING:
    from ecat.geometry.cameras import Camera
    from ecat.stages.calibrate import Recording

MAX_BYTES = 4 << 20
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
    SchemaError : a prototype in it is not valid; every problem is listed.
    LimitError : it is larger than 4 MiB.
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
    if not isinstance(document, dict) or not isinstance(document.get("boxes"), list) or not document["boxes"]:
        raise FormatError(
            what, where='expected {"version": 1, "boxes": [...]}', fix="ecat calibrate writes such a file"
        )
    return tuple(BoxPrototype.from_dict(box) for box in document["boxes"])


def session_camera(session: Session) -> Camera:
    """The colour camera of a session: its own, or a typical Kinect v2."""
    from ecat.geometry.cameras import KINECT_V2_COLOR
    from ecat.geometry.records import camera_of

    record = session.manifest.camera("color")
    return camera_of(record) if record is not None else KINECT_V2_COLOR


def recording_of(session: Session, surface: str = "") -> Recording | None:
    """What calibration needs of a session, or ``None`` if it has no marks."""
    from ecat.stages.calibrate import Recording
    from ecat.stages.plane import polygon_points

    if not session.has_table("markers_2d"):
        return None
    marks_3d = session.table("markers_3d").to_arrow() if session.has_table("markers_3d") else None
    polygon = polygon_points(session.keyframes.to_arrow(), surface)
    return Recording(session.table("markers_2d").to_arrow(), marks_3d, polygon)


def table_surface(session: Session) -> str:
    """The object that is the table: its type or its name says so; empty if none does."""
    for row in session.objects.to_arrow().to_pylist():
        if row["dimensions"] == 3 and "table" in (row["semantic_type"].lower(), row["name"].strip().lower()):
            return str(row["object_id"])
    return ""


def calibrate_together(
    paths: Sequence[Path], progress: Progress = silent
) -> dict[Path, tuple[BoxPrototype, ...]]:
    """Boxes for the sessions that have marks but no boxes yet, those of one camera calibrated together.

    The more sessions show a box, the better it is known.  Sessions whose boxes cannot be calibrated are left out.
    """
    by_camera: dict[str, list[Path]] = {}
    for path in paths:
        with contextlib.suppress(EcatError):
            session = open_session(path)
            if session.has_table("markers_2d") and not session.manifest.prototypes:
                by_camera.setdefault(repr(session.manifest.camera("color")), []).append(path)
    found: dict[Path, tuple[BoxPrototype, ...]] = {}
    for group in by_camera.values():
        with contextlib.suppress(InputError):
            found |= dict.fromkeys(group, calibrate(group, progress))
    return found


def calibrate(paths: Iterable[Path], progress: Progress = silent) -> tuple[BoxPrototype, ...]:
    """Calibrate the boxes of several sessions together; all must have the same camera.

    Raises
    ------
    InputError : no session shows a box from two sides, or their cameras differ.
    """
    from ecat.stages.calibrate import CalibrationParameters, calibrate_boxes

    recordings: list[Recording] = []
    cameras: dict[str, Camera] = {}
    found = list(paths)
    for done, path in enumerate(found):
        progress(path.name, done, len(found))
        session = open_session(path)
        recording = recording_of(session, table_surface(session))
        if recording is not None:
            recordings.append(recording)
            cameras[repr(session.manifest.camera("color"))] = session_camera(session)
    progress("calibrating", len(found), len(found))
    if not recordings:
        raise InputError(
            "cannot calibrate the boxes",
            where=f"none of {len(found)} sessions has marks of boxes",
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
    return calibrate_boxes(recordings, CalibrationParameters(camera=next(iter(cameras.values())))).prototypes
