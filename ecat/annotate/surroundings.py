"""What an edit may look at beside its layer: the clock, other layers, other sessions, coding schemes."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from functools import cached_property

import numpy as np

from ecat.annotate.schemes import find_scheme
from ecat.errors import EcatError, LockedError, NotFoundError, StaleError
from ecat.model import CodingScheme, Layer
from ecat.store import Place, Session, open_session
from ecat.store.manifest import SESSION_FILE, is_plain_name, layer_file
from ecat.store.media import annotated_stream
from ecat.store.snapshot import Snapshot

_TRIES = 10


class Surroundings:
    """The session around the layer called ``layer``; ``sessions`` gives the layer of another session by its name."""

    def __init__(self, session: Session, layer: str, sessions: Callable[[str], Layer] | None) -> None:
        self._session = session
        self._layer = layer
        self._sessions = sessions
        self._layers: dict[str, tuple[str, Layer]] = {}
        self._schemes: dict[str, CodingScheme] = {}
        self._seen = (0, "")

    @property
    def n_frames(self) -> int:
        """How many images the recording has; 0 if nobody knows."""
        return self._session.manifest.n_frames

    @cached_property
    def stream(self) -> str:
        """The name of the video whose images frames count, if there is one."""
        video = annotated_stream(self._session.manifest)
        return "" if video is None else video.name

    def t_ns(self, frame: int) -> int | None:
        """Time of a frame, nanoseconds since the session's start; that of the end is one step after the last image."""
        manifest = self._session.manifest
        if manifest.clock.rule != "recorded":
            return manifest.clock.t_ns(frame, manifest.n_frames)
        return self._recorded.get(frame)

    @cached_property
    def _recorded(self) -> dict[int, int]:
        if not self._session.has_table("frames"):
            return {}
        rows = self._session.table("frames").to_arrow()
        mine = np.array([name == self.stream for name in rows["stream"].to_pylist()], bool)
        frames, times = (np.asarray(rows[name])[mine] for name in ("frame", "t_ns"))
        known = dict(zip(frames.tolist(), times.tolist(), strict=True))
        if len(known) > 1:
            last = max(known)
            step = int(np.median(np.diff(np.sort(times))))
            known.setdefault(last + 1, known[last] + step)
        return known

    # ------------------------------------------------------------------------------------------ layers

    def make_layer(self, scheme: str) -> None:
        """Make the layer, empty, unless somebody else does at this moment.

        Its objects are numbered after those that are there: tables name a thing by its id alone, and what somebody
        draws would go by the name of what was recorded.
        """
        if scheme:
            find_scheme(self._session, scheme)
        for _ in range(_TRIES):
            with contextlib.suppress(StaleError, LockedError), self._session.write() as commit:
                commit.put_layer(Layer(name=self._layer, scheme=scheme, object_counter=self._objects()))
            if self._session.refresh().manifest.layer(self._layer) is not None:
                return
        raise LockedError(
            f"cannot make layer {self._layer}",
            where=f"{self._session.path}: others keep writing to it",
            consequence="nothing was written",
            fix="do it again when they have finished",
        )

    def _objects(self) -> int:
        """The highest number of an object of any layer."""
        layers = (self._session.layer(record.name) for record in self._session.manifest.layers)
        numbers = (re.fullmatch(r"o([0-9]{1,9})", thing.id) for layer in layers for thing in layer.objects)
        return max((int(number[1]) for number in numbers if number), default=0)

    def read_layer(self) -> tuple[Layer, Place, str]:
        """The layer as it was last saved, how much of its journal it contains, and the sha256 of its XML."""
        for _ in range(_TRIES):
            record = self._session.manifest.layer(self._layer)
            if record is not None:
                with contextlib.suppress(StaleError):
                    layer = self._session.layer(self._layer)
                    return layer, Place(record.journal_revision, record.journal_bytes), record.sha256
            self._session.reread()
        return self._session.layer(self._layer), Place(), ""

    def xml_bytes(self) -> int:
        """How long the layer's XML is; 0 if it is not there."""
        try:
            return (self._session.path / layer_file(self._layer)).stat().st_size
        except OSError:
            return 0

    def sha256_now(self) -> str:
        """The sha256 that the layer's XML has by now; the manifest is read again only if it was written again."""
        written = (self._session.path / SESSION_FILE).stat().st_mtime_ns
        if self._seen[0] != written:
            record = Snapshot.read(self._session.path).manifest.layer(self._layer)
            self._seen = written, "" if record is None else record.sha256
        return self._seen[1]

    def layer_of(self, name: str) -> Layer:
        """Another layer of the session as it is now.

        Raises
        ------
        NotFoundError : there is none of that name.
        """
        snapshot = Snapshot.read(self._session.path)
        record = snapshot.manifest.layer(name)
        known = self._layers.get(name)
        if known is None or record is None or known[0] != record.sha256:
            known = ("" if record is None else record.sha256, snapshot.layer(name))
            self._layers[name] = known
        return known[1]

    def session_of(self, name: str) -> Layer:
        """The layer of this name of another session of the project; that session's ``main`` if it has none.

        Raises
        ------
        NotFoundError : there is no such session.
        """
        if self._sessions is not None:
            return self._sessions(name)
        folder = self._session.path.resolve().parent / name
        if not is_plain_name(name):
            where = f"{name!r:.80}: not the name of a session"
            raise NotFoundError("cannot open another session", where=where, fix="name one of the project")
        other = open_session(folder)
        return other.layer(self._layer if other.manifest.layer(self._layer) is not None else "main")

    # ------------------------------------------------------------------------------------------ schemes

    def find_scheme(self, name: str) -> CodingScheme:
        """The coding scheme called ``name``; read once."""
        if name not in self._schemes:
            self._schemes[name] = find_scheme(self._session, name)
        return self._schemes[name]

    def scheme(self, name: str) -> CodingScheme | None:
        """The coding scheme called ``name``, or ``None``: annotations may follow one that is not at hand."""
        if not name:
            return None
        try:
            return self.find_scheme(name)
        except EcatError:
            return None

    def forget_schemes(self) -> None:
        """Read the coding schemes again when they are next asked for."""
        self._schemes.clear()
