"""The project, and what a session is made of."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response

from ecat.annotate import scheme_names
from ecat.store.media import annotated_stream
from ecat.web.answers import json_answer
from ecat.web.layers import SharedLayer
from ecat.web.proxies import Proxy, describe
from ecat.web.sessions import OpenSession, tables_sha256
from ecat.web.shapes import Invitation, ProjectShape, SessionShape
from ecat.web.site import TheSession, TheSite

router = APIRouter(prefix="/api", tags=["sessions"])


@router.get("/project", response_model=ProjectShape)
def project(site: TheSite, request: Request) -> Response:
    """The project and its sessions; the author is suggested to the first browser only: others say who they are."""
    author = site.author if site.access.is_first(request.headers) else ""
    return json_answer({**site.library.describe(), "author": author, "layer": site.layer})


@router.post("/invitations", response_model=Invitation)
async def invite(site: TheSite) -> Response:
    """An address for somebody else, or for another browser."""
    return json_answer({"path": f"/?token={site.access.invite()}"})


@router.get("/sessions/{sid}", response_model=SessionShape)
async def session(
    opened: TheSession,
    layer: Annotated[str | None, Query(max_length=200, description="whose coding scheme is meant")] = None,
) -> Response:
    """What there is to show of a session; its videos begin to be made."""
    shared = await opened.first_layer(layer)
    return json_answer(await asyncio.to_thread(_described, opened, shared))


def _described(opened: OpenSession, shared: SharedLayer | None) -> dict[str, Any]:
    # first of all: what follows is of this state or of a later one
    session = opened.session
    manifest, facts = session.manifest, opened.facts()
    video = annotated_stream(manifest)
    made = opened.proxies(make=True)
    streams = [
        {
            "name": stream.name,
            "kind": stream.kind,
            "n_frames": facts["images"].get(stream.name, 0),
            "width_px": stream.width_px,
            "height_px": stream.height_px,
            "camera": stream.camera,
            "present": stream.present,
            "proxy": describe(made.get(stream.name, Proxy()), opened.proxy_url(stream.name)),
        }
        for stream in manifest.streams
    ]
    ns = manifest.clock.duration_ns
    return {
        "id": opened.sid,
        "name": manifest.name,
        "n_frames": manifest.n_frames,
        "duration_s": None if ns is None else ns / 1e9,
        "clock": manifest.clock.rule,
        "video": None if video is None else video.name,
        "streams": streams,
        "layers": opened.describe_layers(),
        "tables": [record.name for record in manifest.tables],
        "tables_sha256": tables_sha256(session),
        "scheme": opened.describe_scheme(shared),
        "schemes": scheme_names(opened.session),
        **{
            name: facts[name]
            for name in ("frame_rate_median", "cameras", "bodies", "boxes", "plane", "problems")
        },
    }
