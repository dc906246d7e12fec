"""What is in a session, a project or a workspace, as plain data for ``ecat info``."""

from __future__ import annotations

import shlex
from collections import Counter
from pathlib import Path
from typing import Any

from ecat.errors import EcatError, NotFoundError
from ecat.model import Camera, Layer, Manifest, Provenance
from ecat.store import Session, find_sessions, open_project, open_session
from ecat.store.manifest import PROJECT_FILE, SESSION_FILE

Data = dict[str, Any]


def describe(path: Path) -> Data:
    """What is at ``path``: its ``kind`` is ``session``, ``project``, ``workspace``, ``folder`` of sessions or ``file``.

    Raises
    ------
    NotFoundError : nothing of ecat's is there, nor a file that a format explains.
    InputError : it is such a file, but cannot be read.
    """
    if path.is_file() and (found := _file(path)) is not None:
        return found
    sessions = sessions_at(path)
    if sessions == [path]:
        return _session(open_session(path))
    if (path / PROJECT_FILE).is_file():
        manifest = open_project(path).manifest
        return _folder(path, sessions, manifest.kind, manifest.name, manifest.provenance)
    return _folder(path, sessions, "folder", path.resolve().name, Provenance())


def _file(path: Path) -> Data | None:
    """What a file beside recordings of another program holds, if a format knows it."""
    from ecat.formats import registry

    kind = registry.side_file(path)
    if kind is None:
        return None
    holds = dict(kind.explain(path))
    return {
        "kind": "file",
        "name": path.name,
        "what": kind.name,
        "description": kind.description,
        "holds": holds,
    }


def sessions_at(path: Path) -> list[Path]:
    """:func:`ecat.store.find_sessions`, for what a person may have typed.

    Raises
    ------
    NotFoundError : nothing of ecat's is there, or it is a file.
    """
    require_folder(path)
    return find_sessions(path)


def require_folder(path: Path) -> None:
    """Returns unless there is something at ``path`` that is not a folder.

    Raises
    ------
    NotFoundError : it is a file: one of a session, or one that may have to be imported.
    """
    if path.is_dir() or not path.exists():
        return
    inside = next((folder for folder in path.absolute().parents if (folder / SESSION_FILE).is_file()), None)
    if inside is None and path.name == PROJECT_FILE:
        inside = path.absolute().parent
    fix = "name the folder of a session; a recording becomes one with: "
    raise NotFoundError(
        f"cannot find sessions in {path.name}",
        where=f"{path}: it is a file, not a folder",
        consequence="nothing was done",
        fix=fix + f"ecat import {shlex.quote(str(path))} MY_SESSION"
        if inside is None
        else f"name the folder that it belongs to: {inside}",
    )


def _session(session: Session) -> Data:
    manifest = session.manifest
    return {
        "kind": "session",
        "name": session.name,
        "revision": manifest.revision,
        "frames": manifest.n_frames,
        "duration_s": _duration_s(manifest),
        "clock": {"rule": manifest.clock.rule, "start": manifest.clock.start},
        "cameras": [_camera(camera) for camera in manifest.cameras],
        "streams": [
            {"name": s.name, "kind": s.kind, "file": s.file, "present": s.present, "codec": s.codec}
            | {"camera": s.camera, "frames": s.n_frames, "size_bytes": s.size_bytes}
            for s in manifest.streams
        ],
        "layers": [_layer(session.layer(record.name), record.revision) for record in manifest.layers],
        "tables": [{"name": t.name, "rows": t.rows, "stage": t.stage} for t in manifest.tables],
        "prototypes": [str(prototype.get("name", "")) for prototype in manifest.prototypes],
        **_origin(manifest.provenance),
    }


def _duration_s(manifest: Manifest) -> float | None:
    return None if manifest.clock.duration_ns is None else manifest.clock.duration_ns / 1e9


def _origin(provenance: Provenance) -> Data:
    where = {"format": provenance.format, "source": provenance.source, "software": provenance.software}
    return {"provenance": where, "notes": list(provenance.notes)}


def _camera(camera: Camera) -> Data:
    names = (
        "name",
        "width_px",
        "height_px",
        "fx_px",
        "fy_px",
        "cx_px",
        "cy_px",
        "mirrored",
        "reference",
        "source",
    )
    return {name: getattr(camera, name) for name in names}


def _layer(layer: Layer, revision: int) -> Data:
    return {
        "name": layer.name,
        "revision": revision,
        "scheme": layer.scheme,
        "objects": dict(Counter(thing.kind for thing in layer.objects)),
        "events": len(layer.events),
        "event_types": dict(Counter(event.type for event in layer.events if event.type)),
        "relations": len(layer.relations),
        "predicates": dict(Counter(relation.predicate for relation in layer.relations)),
    }


def _folder(path: Path, paths: list[Path], kind: str, name: str, provenance: Provenance) -> Data:
    sessions = [_brief(session, path) for session in paths]
    sound = [session for session in sessions if "error" not in session]
    known = [session["duration_s"] for session in sound if session["duration_s"] is not None]
    totals: Data = {"sessions": len(sessions), "duration_s": sum(known) if known else None}
    totals |= {key: sum(s[key] for s in sound) for key in ("frames", "objects", "events", "relations")}
    return {"kind": kind, "name": name, "totals": totals, "sessions": sessions, **_origin(provenance)}


def _brief(path: Path, root: Path) -> Data:
    place = {"path": path.relative_to(root).as_posix()}
    try:
        manifest = open_session(path).manifest
    except EcatError as error:
        return place | {"error": error.what}
    rows = {record.name: record.rows for record in manifest.tables}
    return {
        **place,
        "frames": manifest.n_frames,
        "duration_s": _duration_s(manifest),
        "objects": rows.get("objects", 0),
        "events": rows.get("events", 0),
        "relations": rows.get("relations", 0),
        "stages": sorted({record.stage for record in manifest.tables if record.stage} - {"publish"}),
    }
