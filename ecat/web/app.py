"""The application: routes, errors, and the guard around them."""

from __future__ import annotations

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from fastapi import FastAPI

from ecat.web import answers
from ecat.web.routes import layers, live, media, page, project, rows, second_look, sessions, work
from ecat.web.security import App, Guard
from ecat.web.shapes import Refusal
from ecat.web.site import Site

_REFUSALS = {
    400: "a wrong call",
    403: "not allowed",
    404: "nothing of that name",
    409: "a conflict: what the call was based on has changed",
    413: "too large",
    422: "not what it should be",
    500: "the disk, a damaged session, or a bug",
}


def application(site: Site | None = None) -> FastAPI:
    """The routes, without anybody to keep out; without a ``site``, only to be described."""

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncGenerator[None]:
        assert site is not None
        await site.start()
        yield
        await site.stop()

    app = FastAPI(
        title="ecat annotate",
        version="1",
        summary="HTTP over the annotation of sessions.",
        lifespan=lifespan,
        # their pages would load scripts from elsewhere
        docs_url=None,
        redoc_url=None,
        openapi_url=None,
        responses={code: {"model": Refusal, "description": text} for code, text in _REFUSALS.items()},
        # what has a default may be left out, in answers too
        separate_input_output_schemas=False,
        redirect_slashes=False,
    )
    app.state.site = site
    answers.install(app)
    for part in (sessions, project, layers, media, rows, second_look, work, live):
        app.include_router(part.router)
    page.mount(app)
    return app


def guarded(site: Site) -> App:
    """The application as it is served."""
    return Guard(application(site), site.access)
