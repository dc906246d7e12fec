"""Rows of tables, and curves, as columns of numbers."""

from __future__ import annotations

from typing import Annotated

import pyarrow as pa
import pyarrow.compute as pc
from fastapi import APIRouter, Query, Response

from ecat.errors import UsageError
from ecat.tables import TABLES
from ecat.web.answers import Binary, json_answer
from ecat.web.binary import columns_of, pack, wanted
from ecat.web.shapes import SeriesShape
from ecat.web.site import TheSession

router = APIRouter(prefix="/api/sessions/{sid}", tags=["rows"])
Frame = Annotated[int | None, Query(ge=-(2**31), lt=2**31)]


@router.get("/columns/{table}", response_class=Binary)
def columns(  # noqa: PLR0917 - FastAPI calls it by names
    opened: TheSession,
    table: str,
    columns: Annotated[str, Query(max_length=2000)] = "",
    object_id: Annotated[str | None, Query(max_length=200)] = None,
    start_frame: Frame = None,
    end_frame: Frame = None,
) -> Response:
    """Columns of a table, all rows or those of an object and of frames ``[start_frame, end_frame)``.

    See :mod:`ecat.web.binary` for the bytes.
    """
    session = opened.session
    record = session.table(table)  # there is one, or the error says which stage makes it
    schema = TABLES[record.name].arrow
    names = wanted(schema, [name for name in columns.split(",") if name])
    if object_id is not None and "object_id" not in schema.names:
        raise UsageError(
            f"cannot choose an object in table {table}",
            where="its rows belong to none",
            fix="leave out object_id",
        )
    needed = names if object_id is None or "object_id" in names else [*names, "object_id"]
    view = session.table(table, start_frame=start_frame, end_frame=end_frame, columns=needed)
    rows = view.to_arrow()
    if object_id is not None:
        rows = rows.filter(pc.equal(rows["object_id"].cast(pa.string()), pa.scalar(object_id)))
    return Binary(pack(columns_of(rows.select(names))))


@router.get("/series", response_model=list[SeriesShape])
def series(opened: TheSession) -> Response:
    """The curves over time that there are."""
    return json_answer(opened.curves().describe())


@router.get("/series/{name}", response_class=Binary)
def curve(opened: TheSession, name: str) -> Response:
    """A curve: columns ``frame`` and ``value``, where it is known."""
    return Binary(pack(opened.curves().columns(name)))
