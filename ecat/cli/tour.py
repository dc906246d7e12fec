"""What ``ecat demo`` does."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from filecmp import cmp
from pathlib import Path
from typing import Any

from ecat import formats, process, store
from ecat.check import check
from ecat.checkout import ROOT
from ecat.cli.describe import describe
from ecat.cli.info import project_text
from ecat.cli.output import Output
from ecat.cli.text import count, shell
from ecat.errors import ExistsError, os_error

SHIPPED = ROOT / "sample_sessions"
MARK = ".ecat-demo"
"""Marks a folder that a demo made, and may therefore empty."""
MADE = (
    *("recording", "project", "poses.parquet", "session.rrd", "ecat-2018"),
    *("cameras", "video_session", "video_session.rrd"),
)


def tour(dest: Path, out: Output) -> dict[str, Any]:
    """Import, describe, process, check and export a small project in ``dest``; returns where everything is.

    Raises
    ------
    ExistsError : ``dest`` holds something that no demo made.
    """
    _prepare(dest)
    source, project = _source(dest / "recording"), dest / "project"
    out.say(f"1. import   {source}, a project in the format of 2018")
    with out.progress() as progress:
        formats.import_source(source, project, format="ecat-2018", progress=progress)
    sessions = store.find_sessions(project)
    out.say(f"            -> {project}, {count(len(sessions), 'session')}")
    out.say(f"2. info     {project_text(describe(project))}")
    for session in sessions:
        with out.progress() as progress:
            report = process.process_session(session, smooth=True, progress=progress)
        out.say(f"3. process  {session.name}: {', '.join(report.ran)}")
    findings = check(project)
    out.say(f"4. check    {count(len(findings), 'finding')}")
    for finding in findings:
        out.say(f"            {finding.severity}: {finding.session}, {finding.place}: {finding.message}")
    exported = _export(dest, project, sessions[0], out)
    different = list(_differences(source, exported["exported"]))
    verdict = "byte for byte what was imported" if not different else f"DIFFERENT: {', '.join(different)}"
    out.say(f"            {exported['exported']}: {verdict}")
    filmed = _filmed(dest, out)
    places = {"source": source, "project": project, "session": sessions[0], **exported, **filmed}
    return {
        **{name: str(path) for name, path in places.items()},
        "sessions": len(sessions),
        "findings": [finding.to_dict() for finding in findings],
        "identical": not different,
    }


def _export(dest: Path, project: Path, session: Path, out: Output) -> dict[str, Path]:
    from ecat.view import save_rrd

    poses, recording, exported = dest / "poses.parquet", dest / "session.rrd", dest / "ecat-2018"
    with out.progress() as progress:
        formats.export(project, poses, format="poses", progress=progress)
        save_rrd(store.open_session(session), recording, progress=progress)
        formats.export(project, exported, format="ecat-2018", progress=progress)
    out.say(f"5. export   {poses}: the poses of all boxes")
    out.say(f"            {recording}: {session.name} for the Rerun viewer")
    return {"poses": poses, "recording": recording, "exported": exported}


def _filmed(dest: Path, out: Output) -> dict[str, Path]:
    """The same from what cameras wrote: markers are found in the video, the table in the depth."""
    from ecat.view import save_rrd

    source = _cameras(dest)
    session, shown = dest / "video_session", dest / "video_session.rrd"
    out.say(f"6. video    {source}, colour and depth of another recording")
    with out.progress() as progress:
        formats.import_source(source, session, format="rgbd-video", progress=progress)
        boxes = process.read_prototypes(source / "boxes.json")
        report = process.process_session(session, smooth=True, prototypes=boxes, progress=progress)
        save_rrd(store.open_session(session), shown, progress=progress)
    out.say(f"            imported, then {', '.join(report.ran)}")
    out.say(f"            {session}, and {shown} for the Rerun viewer")
    return {"cameras": source, "video_session": session, "video_recording": shown}


def _prepare(dest: Path) -> None:
    """An empty ``dest``, save for the mark."""
    try:
        if dest.exists() and not (dest / MARK).is_file() and (not dest.is_dir() or any(dest.iterdir())):
            raise ExistsError(
                "cannot make the demo",
                where=f"{dest}: there is something that no demo made",
                consequence="it was left as it is",
                fix=shell("ecat", "demo", "ANOTHER_FOLDER"),
            )
        dest.mkdir(parents=True, exist_ok=True)
        (dest / MARK).touch()
        for name in MADE:
            if (dest / name).is_dir():
                shutil.rmtree(dest / name)
            else:
                (dest / name).unlink(missing_ok=True)
    except OSError as error:
        raise os_error(error, "cannot make the demo", dest, "the demo was not run") from error


def _source(dest: Path) -> Path:
    """The project that comes with a checkout; an installed package has none, so one is generated."""
    sniff = formats.registry.find("ecat-2018").sniff
    shipped = (
        path for path in sorted(SHIPPED.glob("*")) if path.is_dir() and sniff is not None and sniff(path)
    )
    return next(shipped, None) or _generated(dest)


def _cameras(dest: Path) -> Path:
    """The recording that comes with a checkout, or the same generated."""
    from ecat.sample.shipped import WITH_PIXELS, write_recording

    shipped = SHIPPED / "recorded" / WITH_PIXELS
    if not shipped.is_dir():
        write_recording(dest / "cameras")
        return dest / "cameras" / "recorded" / WITH_PIXELS
    return shipped


def _generated(dest: Path) -> Path:
    from tempfile import TemporaryDirectory

    from ecat.model import ProjectManifest
    from ecat.sample import sample_session

    with TemporaryDirectory() as folder:
        project = Path(folder) / "project"
        store.create_project(project, ProjectManifest(name="project", created="2024-03-05T10:00:00"))
        draft, _ = sample_session(seed=0, actions=("next", "past"), name="Session1")
        store.create_session(project / "Session1", draft)
        formats.export(project, dest, format="ecat-2018")
    return dest


def _differences(source: Path, back: Path) -> Iterator[str]:
    """Files of ``source`` that ``back`` has not, or with other bytes."""
    for path in sorted(source.rglob("*")):
        name = path.relative_to(source)
        if path.is_file() and not ((back / name).is_file() and cmp(path, back / name, shallow=False)):
            yield name.as_posix()
