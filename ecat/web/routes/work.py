"""Work that goes on behind the page, and the files that are sent for it."""

from __future__ import annotations

import asyncio

from fastapi import APIRouter, Request, Response

from ecat.errors import UsageError
from ecat.formats import skeletons
from ecat.process import process_session, require_stages
from ecat.progress import Progress
from ecat.store import open_session, streams
from ecat.web.answers import json_answer
from ecat.web.asked import AddFiles, AddSkeletons, Process, Removal
from ecat.web.sessions import OpenSession
from ecat.web.shapes import JobShape, Json, Received, UploadShape
from ecat.web.site import TheSession, TheSite, require_peoples

router = APIRouter(prefix="/api", tags=["work"])


@router.get("/jobs/{job}", response_model=JobShape)
async def job(site: TheSite, job: str) -> Response:
    """How far it is."""
    return json_answer(site.jobs.get(job).describe())


@router.delete("/jobs/{job}", response_model=JobShape)
async def stop(site: TheSite, job: str) -> Response:
    """Let it end at its next step."""
    return json_answer(site.jobs.stop(job).describe())


@router.post("/uploads", response_model=UploadShape)
def begin_upload(site: TheSite) -> Response:
    """A place to put files, until something is made of them."""
    return json_answer({"id": site.uploads.begin()})


@router.put("/uploads/{upload}/{path:path}", response_model=Received)
async def put_file(site: TheSite, upload: str, path: str, request: Request) -> Response:
    """A file, by its name or its path below the folder that was chosen."""
    return json_answer({"bytes": await site.uploads.put(upload, path, request.stream())})


@router.delete("/uploads/{upload}", response_model=Json)
def discard_upload(site: TheSite, upload: str) -> Response:
    """Forget what was sent."""
    site.uploads.discard(upload)
    return json_answer({})


@router.post("/sessions/{sid}/process", response_model=JobShape)
async def process(opened: TheSession, asked: Process) -> Response:
    """Run the stages that are out of date, with what was drawn until now."""
    require_stages(asked.stages or ())
    path = await asyncio.to_thread(lambda: opened.session.path)

    def work(progress: Progress) -> Json:
        opened.site.wait_for(opened.save())
        report = process_session(path, stages=asked.stages, force=asked.force, progress=progress)
        opened.site.wait_for(opened.look())
        return {
            "ran": list(report.ran),
            "up_to_date": list(report.skipped),
            "not_applicable": dict(report.not_applicable),
            "findings": list(report.findings),
        }

    return json_answer(
        opened.site.jobs.start(f"processing {opened.sid}", work, opened.sid).describe(), status=202
    )


@router.post("/sessions/{sid}/skeletons", response_model=JobShape)
async def add_skeletons(opened: TheSession, asked: AddSkeletons) -> Response:
    """Add the skeletons of a file that was sent: a rig for each body, in one step of undo, and their joints."""
    require_peoples(asked.layer)

    def work(progress: Progress) -> Json:
        with opened.site.uploads.taken(asked.upload) as source:
            progress(f"reading {source.name}", 0, 2)
            session = open_session(opened.session.path)
            found = skeletons.read_skeletons(source, session)
            if not found.bodies:
                raise UsageError(
                    f"cannot add {source.name}",
                    where="there is not a single body in it",
                    fix="choose another file",
                )
            progress("adding the rigs", 1, 2)
            objects = opened.site.wait_for(_add_rigs(opened, asked, found))
            try:
                skeletons.put_skeletons(session.refresh(), found, objects)
            except BaseException:
                opened.site.wait_for(_take_back(opened, asked))
                raise
            opened.site.wait_for(opened.look())
        return {
            "objects": list(objects.values()),
            "rows": found.rows.num_rows,
            "findings": list(found.findings),
        }

    return json_answer(
        opened.site.jobs.start(f"adding skeletons to {opened.sid}", work, opened.sid).describe(), status=202
    )


@router.post("/sessions/{sid}/files", response_model=JobShape)
async def add_files(opened: TheSession, asked: AddFiles) -> Response:
    """Keep files that were sent with the session, as they are."""

    def work(progress: Progress) -> Json:
        with opened.site.uploads.taken(asked.upload) as source:
            paths = [source] if source.is_file() else sorted(p for p in source.rglob("*") if p.is_file())
            added: list[str] = []
            for i, path in enumerate(paths):
                progress(f"adding {path.name}", i, len(paths))
                added.append(streams.add_file(open_session(opened.session.path), path).name)
            opened.site.wait_for(opened.look())
        return {"streams": added}

    return json_answer(
        opened.site.jobs.start(f"adding files to {opened.sid}", work, opened.sid).describe(), status=202
    )


@router.post("/sessions/{sid}/files/{stream}/removal", response_model=Json)
def remove_file(opened: TheSession, stream: str, asked: Removal) -> Response:
    """Take a file out that was not recorded; its name confirms."""
    if asked.name != stream:
        raise UsageError(
            f"cannot remove {stream[:80]}",
            where=f"{asked.name[:80]}: another name",
            fix="type the stream's name",
        )
    streams.remove_file(open_session(opened.session.path), stream)
    return json_answer({})


async def _add_rigs(opened: OpenSession, asked: AddSkeletons, found: skeletons.Skeletons) -> dict[int, str]:
    layer = await opened.layer(asked.layer, make=True)
    record = await layer.edit(skeletons.add_operations(found), None, asked.author)
    added = [change.id for change in record.changes if change.kind == "object"]
    return dict(zip(found.bodies, added, strict=True))


async def _take_back(opened: OpenSession, asked: AddSkeletons) -> None:
    await (await opened.layer(asked.layer)).undo(None, asked.author)
