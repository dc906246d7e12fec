"""A session that somebody looks at: its layers, its videos, and what follows from its tables."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json
import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import quote

from ecat.annotate import find_scheme, scheme_names
from ecat.errors import EcatError, NotFoundError
from ecat.model import Stream
from ecat.model.annotation import MACHINE
from ecat.model.scheme import BUILT_IN_SCHEMES
from ecat.store import Session, open_session
from ecat.store.media import annotated_stream
from ecat.store.times import count_images, image_times_s, median_rate_hz
from ecat.web import proxies, scene
from ecat.web.exact import IMAGE_KINDS
from ecat.web.layers import SharedLayer
from ecat.web.live import Hub
from ecat.web.proxies import Proxy
from ecat.web.series import Curves

if TYPE_CHECKING:
    from ecat.web.site import Site

T = TypeVar("T")

USUAL_SCHEME = "blocks"
_NOTHING = {"n_objects": 0, "n_events": 0, "n_relations": 0}


class OpenSession:
    """One session that somebody looks at; made before anything of it is told: no later change goes unnoticed."""

    def __init__(self, sid: str, site: Site) -> None:
        self.sid = sid
        self.site = site
        self.hub = Hub()
        self._layers: dict[str, SharedLayer] = {}
        self._opening = asyncio.Lock()
        self._looking = asyncio.Lock()
        self._curves: tuple[str, Curves] | None = None
        self._facts: tuple[str, dict[str, Any]] | None = None
        self._computing = threading.Lock()
        self._tables = dict[str, str]()
        with contextlib.suppress(EcatError):  # whoever asks is told
            self._tables = _tables_of(self.session)

    @property
    def session(self) -> Session:
        """As it is on disk now."""
        return self.site.library.session(self.sid)

    async def layer(self, name: str, *, make: bool = False) -> SharedLayer:
        """The layer of this name, opened for editing.

        Raises
        ------
        NotFoundError : there is none, and it is not to be made.
        """
        shared = self._layers.get(name)
        if shared is not None:
            return shared
        async with self._opening:
            if name not in self._layers:
                self._layers[name] = await asyncio.to_thread(self._open_layer, name, make=make)
        return self._layers[name]

    def _open_layer(self, name: str, *, make: bool) -> SharedLayer:
        session = self.session
        if session.manifest.layer(name) is None and not make:
            known = ", ".join(record.name for record in session.manifest.layers) or "none"
            raise NotFoundError(
                f"cannot find layer {name[:80]}",
                where=f"{session.name}: the layers are: {known}",
                fix="make it first",
            )
        # an editor moves its session on as it saves
        return SharedLayer(open_session(session.path), name, self.hub, self.site.author)

    @property
    def layers(self) -> dict[str, SharedLayer]:
        """The layers that were opened, by name."""
        return dict(self._layers)

    def revisions(self) -> dict[str, int]:
        """The revision of every layer that was opened."""
        return {name: layer.revision for name, layer in self._layers.items()}

    @property
    def tables_sha256(self) -> str:
        """Of the tables, as the pages were last told of them."""
        return _sha256(self._tables)

    def describe_layers(self) -> list[dict[str, Any]]:
        """Every layer: as it is now if it was opened, else as it was last saved."""
        manifest, counted = self.session.manifest, self.facts()["layers"]
        found: list[dict[str, Any]] = []
        for record in manifest.layers:
            shared = self._layers.get(record.name)
            revision = record.journal_revision if shared is None else shared.revision
            counts = counted.get(record.name, _NOTHING) if shared is None else shared.counts()
            found.append({"name": record.name, "revision": revision, **counts})
        return found

    async def first_layer(self, name: str | None) -> SharedLayer | None:
        """The layer called ``name``, else the one to begin with, else the first that is not the machine's; None if none
        of them is there.
        """
        session = await asyncio.to_thread(lambda: self.session)
        there = [record.name for record in session.manifest.layers]
        people = [other for other in there if other != MACHINE]
        chosen = next((n for n in (name, self.site.layer, *people[:1]) if n is not None and n in there), None)
        return None if chosen is None else await self.layer(chosen)

    def describe_scheme(self, layer: SharedLayer | None) -> dict[str, Any]:
        """The coding scheme of a layer; where it names none, the project's first, else the one for blocks."""
        session = self.session
        own = [name for name in scheme_names(session) if name not in BUILT_IN_SCHEMES]
        found = None if layer is None else layer.scheme
        return asdict(found or find_scheme(session, own[0] if own else USUAL_SCHEME))

    async def look(self) -> None:
        """Look whether another process has written to a layer, or a stage tables."""
        async with self._looking:
            await self._look()

    async def _look(self) -> None:
        session: Session | None = None
        with contextlib.suppress(EcatError):  # whoever asks is told
            session = await asyncio.to_thread(lambda: self.session)
        for name, layer in self.layers.items():
            record = None if session is None else session.manifest.layer(name)
            if record is not None and layer.was_replaced(record):
                self._layers[name] = await asyncio.to_thread(self._open_layer, name, make=False)
                self.hub.tell({"type": "replaced", "layer": name, "revision": self._layers[name].revision})
            else:
                await layer.look()
        if session is not None:
            self._look_at_tables(session)

    def _look_at_tables(self, session: Session) -> None:
        """Tell whether a stage has written tables."""
        before, now = self._tables, _tables_of(session)
        self._tables = now
        if before != now:
            changed = sorted(name for name in before.keys() | now.keys() if before.get(name) != now.get(name))
            self.hub.tell({"type": "tables", "tables": changed})

    async def save(self) -> None:
        """Let XML and tables of every layer be as they are now."""
        for layer in self.layers.values():
            await layer.save()

    async def close(self) -> None:
        """Save every layer, and end every connection."""
        for layer in self.layers.values():
            await layer.close()
        self.hub.close()

    def curves(self) -> Curves:
        """Its curves over time."""
        session = self.session
        with self._computing:
            if self._curves is None or self._curves[0] != session.snapshot.sha256:
                self._curves = session.snapshot.sha256, Curves(session)
            return self._curves[1]

    def facts(self) -> dict[str, Any]:
        """What the page needs to know that takes looking into tables."""
        session = self.session
        with self._computing:
            if self._facts is None or self._facts[0] != session.snapshot.sha256:
                self._facts = session.snapshot.sha256, _facts(session)
            return self._facts[1]

    def proxy_url(self, stream: str) -> str:
        """Where the page gets the video of a stream from."""
        return f"/api/sessions/{self.sid}/media/{quote(stream, safe='')}"

    def proxies(self, *, make: bool) -> dict[str, Proxy]:
        """The proxy of every stream that has images, the annotated one's first."""
        session, found = self.session, dict[str, Proxy]()
        video = annotated_stream(session.manifest)
        for stream in sorted(session.manifest.streams, key=lambda s: s != video):
            with contextlib.suppress(EcatError):
                if stream.present and stream.kind in IMAGE_KINDS:
                    found[stream.name] = self.site.proxies.get(session, stream.name, make=make)
        return found

    def tell_proxy(self, key: str, proxy: Proxy) -> None:
        """Tell the open pages that a proxy has come to something."""
        if not len(self.hub):
            return
        session = self.session
        for stream in session.manifest.streams:
            with contextlib.suppress(EcatError):
                if stream.kind in IMAGE_KINDS and proxies.key_of(session, stream.name) == key:
                    told = proxies.describe(proxy, self.proxy_url(stream.name))
                    self.hub.tell({"type": "proxy", "stream": stream.name, **told})


def tables_sha256(session: Session) -> str:
    """Of the tables that stages wrote: another one as soon as one of them is."""
    return _sha256(_tables_of(session))


def _tables_of(session: Session) -> dict[str, str]:
    # those that follow from the layers are told of as records
    return {table.name: table.sha256 for table in session.manifest.tables if table.stage != "publish"}


def _sha256(tables: dict[str, str]) -> str:
    return hashlib.sha256(json.dumps(tables, sort_keys=True).encode()).hexdigest()


def _facts(session: Session) -> dict[str, Any]:
    video, problems = annotated_stream(session.manifest), list[str]()

    def found(look: Callable[[], T], otherwise: T) -> T:
        # one damaged table must not keep anybody from annotating
        try:
            return look()
        except EcatError as error:
            problems.append(str(error))
            return otherwise

    rate: float | None = None
    if video is not None:
        rate = found(lambda: _rate_hz(session, video), None)
    return {
        "frame_rate_median": rate,
        "layers": found(lambda: _counted(session), {}),
        "images": found(lambda: {s.name: count_images(session, s) for s in session.manifest.streams}, {}),
        "cameras": [scene.describe_camera(camera) for camera in session.manifest.cameras],
        "bodies": found(lambda: scene.describe_bodies(session), []),
        "boxes": found(lambda: scene.describe_boxes(session), []),
        "plane": found(lambda: scene.describe_plane(session), None),
        "problems": list(dict.fromkeys(problems)),
    }


def _rate_hz(session: Session, video: Stream) -> float | None:
    with contextlib.suppress(NotFoundError):
        return median_rate_hz(image_times_s(session, video))
    return None


def _counted(session: Session) -> dict[str, dict[str, int]]:
    """How many objects, events and relations each layer has in the published tables."""
    found: dict[str, dict[str, int]] = {}
    for name in ("objects", "events", "relations"):
        if not session.has_table(name):
            continue
        columns = ["layer"] if name != "relations" else ["layer", "relation"]
        rows = session.table(name, columns=columns).to_arrow()
        # a relation that is interrupted has several rows
        layers = rows["layer"] if name != "relations" else rows.group_by(columns).aggregate([])["layer"]
        for layer, n in Counter(map(str, layers.to_pylist())).items():
            found.setdefault(layer, dict(_NOTHING))[f"n_{name}"] = n
    return found
