"""Projects and what is in them: made, brought in, put away, edited as a whole; and what sessions see of each other."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Response

from ecat.annotate.surroundings import Surroundings
from ecat.errors import NotFoundError
from ecat.model.shapes import shape_at
from ecat.progress import Progress
from ecat.web import project
from ecat.web.answers import json_answer
from ecat.web.asked import EditAll, Import, NewProject, Removal
from ecat.web.shapes import Archived, JobShape, Json, Made, Neighbour, OtherObjects, Removed, Restored
from ecat.web.site import TheSession, TheSite, require_peoples

router = APIRouter(prefix="/api", tags=["project"])


@router.post("/project/projects", response_model=Made)
def make(site: TheSite, asked: NewProject) -> Response:
    """An empty project."""
    made = project.make_project(site, asked.name, asked.inside)
    return json_answer({"path": made.path.relative_to(site.library.root).as_posix()})


@router.post("/project/imports", response_model=JobShape)
async def bring_in(site: TheSite, asked: Import) -> Response:
    """Turn what was sent into a session or project."""

    def work(progress: Progress) -> Json:
        return project.import_upload(
            site, asked.upload, asked.name, asked.inside, format_=asked.format, progress=progress
        )

    return json_answer(site.jobs.start(f"importing {asked.name}", work).describe(), status=202)


@router.post("/project/operations", response_model=JobShape)
async def edit_all(site: TheSite, asked: EditAll) -> Response:
    """Do operations in many sessions, one step of undo in each."""
    require_peoples(asked.layer)

    def work(progress: Progress) -> Json:
        sids = list(site.library.find()) if asked.sessions is None else asked.sessions
        return project.edit_all(
            site, sids, asked.layer, asked.author, asked.operations, make=asked.make, progress=progress
        )

    return json_answer(site.jobs.start("editing the sessions", work).describe(), status=202)


@router.get("/project/archive", response_model=list[Archived])
def archive(site: TheSite) -> Response:
    """The sessions that were put away."""
    return json_answer(project.archived(site))


@router.post("/project/archive/{name}/restore", response_model=Restored)
def restore(site: TheSite, name: str) -> Response:
    """Bring a session back to where it was."""
    return json_answer({"id": project.restore(site, name)})


@router.post("/project/archive/{name}/removal", response_model=Removed)
def drop(site: TheSite, name: str, asked: Removal) -> Response:
    """Delete an archived session for good."""
    project.drop(site, name, asked.name)
    return json_answer({"archived": None})


@router.post("/sessions/{sid}/removal", response_model=Removed)
async def remove(site: TheSite, sid: str, asked: Removal) -> Response:
    """Put a session into the archive, or delete it for good; refused while somebody is in it."""
    return json_answer({"archived": await project.remove(site, sid, asked.name, keep=asked.keep)})


@router.get("/sessions/{sid}/others", response_model=list[Neighbour])
def others(opened: TheSession) -> Response:
    """The sessions that this one can name, in their order."""
    found = opened.site.library.beside(opened.sid)
    return json_answer([{"id": sid, "name": name} for name, sid in found.items()])


@router.get("/sessions/{sid}/others/{name}", response_model=OtherObjects)
def other_objects(
    opened: TheSession, name: str, layer: Annotated[str, Query(max_length=200)] = "main"
) -> Response:
    """The objects of another session, as they can be copied or named from here."""
    if name not in opened.site.library.beside(opened.sid):
        where = f"{name[:80]}: not beside {opened.sid}"
        raise NotFoundError("cannot find the other session", where=where, fix="name one of the same folder")
    session = opened.session
    theirs = Surroundings(session, layer, None).session_of(name)
    end = max((key.frame for thing in theirs.objects for key in thing.key_frames), default=0)
    objects = [
        {
            "id": thing.id,
            "name": thing.name,
            "kind": thing.kind,
            "color": thing.color,
            "drawn": any(key.present for key in thing.key_frames),
            "at_end": shape_at(thing, end) is not None,
        }
        for thing in theirs.objects
    ]
    return json_answer({"session": name, "layer": theirs.name, "objects": objects})
