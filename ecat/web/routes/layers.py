"""Layers: looked at, edited, undone, restored, saved."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from ecat.web.answers import JSON, encoded, json_answer, packed_answer
from ecat.web.asked import Edit, Restore, Save, Signed, Step
from ecat.web.shapes import EditAnswer, HistoryAnswer, LayerAnswer, SavedAnswer
from ecat.web.site import EDITED, TheLayer, TheSession

router = APIRouter(prefix="/api/sessions/{sid}/layers/{layer}", tags=["layers"])
Author = Annotated[str | None, Query(max_length=200, description="whose undo and redo are asked about")]
MOST_RECORDS = 10_000


@router.get("", response_model=LayerAnswer)
def layer(layer: TheLayer, request: Request, author: Author = None) -> Response:
    """The layer as it is now."""
    return packed_answer(request, layer.answer(author))


@router.post("", response_model=LayerAnswer, dependencies=EDITED)
async def create(opened: TheSession, layer: str, signed: Signed, request: Request) -> Response:
    """Make the layer, empty, unless it is there."""
    made = await opened.layer(layer, make=True)
    return packed_answer(request, made.answer(signed.author))


@router.post("/operations", response_model=EditAnswer, dependencies=EDITED)
async def operations(layer: TheLayer, edit: Edit) -> Response:
    """Do operations as one step of undo, all or none; what is answered is on the disk."""
    return Response(await layer.apply(edit.operations, edit.base, edit.author), media_type=JSON)


@router.post("/undo", response_model=EditAnswer, dependencies=EDITED)
async def undo(layer: TheLayer, step: Step) -> Response:
    """Undo this author's last step."""
    return Response(await layer.undo(step.base, step.author), media_type=JSON)


@router.post("/redo", response_model=EditAnswer, dependencies=EDITED)
async def redo(layer: TheLayer, step: Step) -> Response:
    """Do again what this author undid last."""
    return Response(await layer.redo(step.base, step.author), media_type=JSON)


@router.post("/restore", response_model=EditAnswer, dependencies=EDITED)
async def restore(layer: TheLayer, restore: Restore) -> Response:
    """Let the layer be as it was at a revision, as one more step."""
    return Response(await layer.restore(restore.revision, restore.author), media_type=JSON)


@router.post("/save", response_model=SavedAnswer)
async def save(layer: TheLayer, asked: Save | None = None) -> Response:
    """Write XML and tables now."""
    del asked
    await layer.save()
    return json_answer(layer.saved())


@router.get("/history", response_model=HistoryAnswer)
def history(
    layer: TheLayer,
    request: Request,
    start: Annotated[int, Query(ge=1, lt=2**31)] = 1,
    limit: Annotated[int, Query(ge=0, le=MOST_RECORDS)] = 100,
) -> Response:
    """Records from revision ``start`` on, oldest first."""
    return packed_answer(request, encoded(layer.history(start, limit)))


@router.get("/at/{revision}", response_model=LayerAnswer)
def at(layer: TheLayer, revision: int, request: Request, author: Author = None) -> Response:
    """The layer as it was at a revision."""
    return packed_answer(request, layer.answer_at(revision, author))
