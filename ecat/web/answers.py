"""What goes out: JSON as bytes, and one shape for whatever goes wrong."""

from __future__ import annotations

import gzip
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, HTTPException, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse
from pydantic_core import to_json

from ecat.errors import (
    ConflictError,
    CorruptError,
    EcatError,
    ExistsError,
    InputError,
    LimitError,
    LockedError,
    NotFoundError,
    ReadOnlyError,
    StaleError,
    UsageError,
)

JSON = "application/json"
GZIP_FROM_BYTES = 1 << 16
"""Shorter answers are not worth packing."""
_STATUS: tuple[tuple[type[EcatError], int], ...] = (
    (NotFoundError, 404),
    (StaleError, 409),
    (ConflictError, 409),
    (ExistsError, 409),
    (LockedError, 409),
    (ReadOnlyError, 403),
    (LimitError, 413),
    (CorruptError, 500),
    (InputError, 422),
    (UsageError, 400),
)
_MOST_PROBLEMS = 20


class Binary(Response):
    """Columns of numbers; not compressed, since measured ones hardly become smaller."""

    media_type = "application/octet-stream"


class Jpeg(Response):
    """One image."""

    media_type = "image/jpeg"


class Video(FileResponse):
    """A file that is played, in parts."""

    media_type = "video/mp4"


class ForbiddenError(EcatError):
    """Somebody asks who may not."""

    usual_consequence = "nothing was done"


def status_of(error: EcatError) -> int:
    """The HTTP status that says the same as the error."""
    return next((status for kind, status in _STATUS if isinstance(error, kind)), 500)


def encoded(data: object) -> bytes:
    """JSON, with null for numbers that are missing."""
    return to_json(data, inf_nan_mode="null")


def json_answer(data: object, *, status: int = 200) -> Response:
    """An answer whose ``data`` is plain already, without FastAPI looking at every part of it."""
    return Response(encoded(data), status, media_type=JSON)


def packed_answer(request: Request, data: bytes) -> Response:
    """JSON, compressed if it is long and whoever asks takes it so."""
    if len(data) < GZIP_FROM_BYTES or "gzip" not in request.headers.get("accept-encoding", ""):
        return Response(data, media_type=JSON)
    headers = {"content-encoding": "gzip", "vary": "accept-encoding"}
    return Response(gzip.compress(data, 1, mtime=0), media_type=JSON, headers=headers)


def error_body(error: EcatError) -> dict[str, Any]:
    """The one shape: ``{"error": {"kind", "what", "where", "consequence", "fix"}}``, more beside it for some."""
    told: dict[str, Any] = {**error.to_dict()}
    told["kind"] = told.pop("error")
    return {"error": told}


def error_answer(
    error: EcatError, *, status: int | None = None, more: Mapping[str, Any] | None = None
) -> Response:
    """An error as an answer."""
    return json_answer(error_body(error) | dict(more or {}), status=status or status_of(error))


def install(app: FastAPI) -> None:
    """Give every error of the application the one shape."""
    app.add_exception_handler(EcatError, _of_ours)
    app.add_exception_handler(RequestValidationError, _of_the_request)
    # the router's own are of the class below FastAPI's
    app.add_exception_handler(HTTPException.__base__ or HTTPException, _of_http)
    app.add_exception_handler(Exception, _of_a_bug)


def _of_ours(_: Request, error: Exception) -> Response:
    assert isinstance(error, EcatError)
    more: dict[str, Any] = {}
    if isinstance(error, StaleError) and (records := getattr(error, "records", None)) is not None:
        more = {
            "revision": getattr(error, "revision", None),
            "records": [record.to_dict() for record in records],
        }
    return error_answer(error, more=more)


def _of_the_request(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    problems = [
        f"{'.'.join(map(str, problem['loc']))}: {problem['msg']}"
        for problem in error.errors()[:_MOST_PROBLEMS]
    ]
    made = InputError(
        f"cannot understand {request.method} {request.url.path}",
        where=tuple(problems),
        consequence="nothing was done",
        fix="send what web/openapi.json describes",
    )
    return error_answer(made)


def _of_http(request: Request, error: Exception) -> Response:
    status = int(getattr(error, "status_code", 500))
    call = f"{request.method} {request.url.path}"
    if status == HTTPStatus.NOT_FOUND:
        made: EcatError = NotFoundError(
            f"cannot {call}", where="there is nothing of that name", fix="check the address"
        )
    elif status == HTTPStatus.METHOD_NOT_ALLOWED:
        made = UsageError(
            f"cannot {call}", where="not a method of that address", fix="web/openapi.json has the methods"
        )
    else:
        made = InputError(
            f"cannot {call}",
            where=str(getattr(error, "detail", "")),
            consequence="nothing was done",
            fix="web/openapi.json describes every call",
        )
    answer = error_answer(made, status=status)
    answer.headers.update(getattr(error, "headers", None) or {})
    return answer


def _of_a_bug(request: Request, error: Exception) -> Response:
    made = EcatError(
        f"this is a bug in ecat: {type(error).__name__}",
        where=f"{request.method} {request.url.path}; the traceback is where ecat annotate runs",
        consequence="what was acknowledged before is kept",
        fix="report it with the traceback to ecat's issue tracker",
    )
    return error_answer(made, status=500)
