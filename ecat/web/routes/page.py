"""The page itself."""

from __future__ import annotations

from pathlib import Path

from fastapi import APIRouter, FastAPI, Response
from fastapi.responses import FileResponse, HTMLResponse
from fastapi.staticfiles import StaticFiles

from ecat.web.security import Message, Receive, Scope, Send

STATIC = Path(__file__).resolve().parents[1] / "static"
INDEX = STATIC / "index.html"
KEPT = "public, max-age=31536000, immutable"
_NOT_BUILT = """<!doctype html><html lang="en"><meta charset="utf-8"><title>ecat</title>
<h1>The page is not built</h1><p>This checkout has no <code>ecat/web/static/index.html</code>. Build it in the folder
<code>web</code>:</p><pre>npm ci
npm run build</pre>"""

router = APIRouter()


@router.get("/", include_in_schema=False)
def index() -> Response:
    """The page."""
    if not INDEX.is_file():
        return HTMLResponse(_NOT_BUILT, 503)
    return FileResponse(INDEX, media_type="text/html")


class _Assets(StaticFiles):
    """Built files, whose names change with their content."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start" and message["status"] == 200:
                message["headers"] = [*message["headers"], (b"cache-control", KEPT.encode())]
            await send(message)

        await super().__call__(scope, receive, sending)


def mount(app: FastAPI) -> None:
    """Serve the page and the files it is made of; folders are not listed."""
    app.include_router(router)
    app.mount("/assets", _Assets(directory=STATIC / "assets", check_dir=False))
    app.mount("/", StaticFiles(directory=STATIC, check_dir=False))
