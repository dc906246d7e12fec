"""Videos, single images, distances, and when images were taken."""

from __future__ import annotations

import re
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import FileResponse

from ecat.errors import NotFoundError, UsageError
from ecat.store.times import image_times_s
from ecat.web.answers import Binary, Jpeg, Video, error_answer, json_answer
from ecat.web.shapes import DepthAnswer, DepthRange
from ecat.web.site import TheSession

router = APIRouter(prefix="/api/sessions/{sid}", tags=["media"])
_RANGE = re.compile(r"bytes=(\d{0,18})-(\d{0,18})", re.ASCII)
REVALIDATED = {"cache-control": "private, no-cache"}


@router.get("/times/{stream}", response_class=Binary)
def times(opened: TheSession, stream: str) -> Response:
    """Seconds since the session's start, float64, one for each image of the stream."""
    session = opened.session
    seconds = image_times_s(session, session.stream(stream)).astype("<f8")
    return Binary(seconds.tobytes())


@router.get("/media/{stream}", response_class=Video)
def media(opened: TheSession, stream: str, request: Request) -> Response:
    """The video to play; it begins to be made if it is not there."""
    proxy = opened.site.proxies.get(opened.session, stream)
    if proxy.state != "ready" or proxy.path is None:
        failed = proxy.state == "failed"
        error = NotFoundError(
            f"cannot play stream {stream}",
            where=proxy.why if failed else "its video is being made",
            fix="show the images one by one" if failed else "try again soon, or show the images one by one",
        )
        answer = error_answer(error)
        if not failed:
            answer.headers["retry-after"] = "1"
        return answer
    stat = proxy.path.stat()
    tag = f'"{stat.st_ino:x}-{stat.st_size:x}-{stat.st_mtime_ns:x}"'
    if request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers={"etag": tag, **REVALIDATED})
    if (beyond := _checked_range(request, stat.st_size)) is not None:
        return beyond
    return Video(proxy.path, stat_result=stat, headers={"etag": tag, **REVALIDATED})


def _checked_range(request: Request, size: int) -> Response | None:
    """A refusal for a range that begins behind the end; what is no range is forgotten, as RFC 9110 §14.2 allows."""
    found = _RANGE.fullmatch(request.headers.get("range", ""))
    start, end = (int(part) if part else None for part in found.groups()) if found else (None, None)
    if found is None or start is None is end or (start is not None and end is not None and end < start):
        request.scope["headers"] = [item for item in request.scope["headers"] if item[0] != b"range"]
    elif end == 0 if start is None else start >= size:
        where = f"{found[0]} of {size:,} bytes"
        error = UsageError("cannot send this part", where=where, fix="ask for a part that there is")
        answer = error_answer(error, status=416)
        answer.headers["content-range"] = f"bytes */{size}"
        return answer
    return None


@router.get("/frames/{stream}/{frame}.jpg", response_class=Jpeg)
def frame(opened: TheSession, stream: str, frame: int) -> Response:
    """Image ``frame`` of the stream, exactly, as a JPEG."""
    return Jpeg(opened.site.exact.jpeg(opened.session, stream, frame))


@router.get("/depth/{stream}/range", response_model=DepthRange)
def depth_range(opened: TheSession, stream: str) -> Response:
    """How far away the first and the last colour of a depth stream's images are."""
    return json_answer(opened.site.exact.depth_range(opened.session, stream))


@router.get("/files/{stream}", response_class=FileResponse)
def file(opened: TheSession, stream: str, request: Request) -> Response:
    """The file of a stream as it was recorded, to keep."""
    path = opened.session.stream_path(stream)
    if not path.is_file():
        raise NotFoundError(
            f"cannot find the file of stream {stream}",
            where=f"{path.name}: it is gone",
            fix="import the recording again",
        )
    if (beyond := _checked_range(request, path.stat().st_size)) is not None:
        return beyond
    return FileResponse(path, media_type="application/octet-stream", filename=path.name)


@router.get("/depth/{stream}/{frame}", response_model=DepthAnswer)
def depth(
    opened: TheSession,
    stream: str,
    frame: int,
    u: Annotated[float, Query(description="column of the depth image, pixels")],
    v: Annotated[float, Query(description="row of the depth image, pixels")],
) -> Response:
    """How far it is to what a pixel of image ``frame`` shows."""
    return json_answer(opened.site.exact.depth(opened.session, stream, frame, u, v))
