"""The videos that the page plays: made once in the background, kept for all sessions and servers of this user.

The cache is ``proxies/`` in the folder that ``ECAT_CACHE`` names, else in ``ecat`` below ``XDG_CACHE_HOME`` or
``~/.cache``.  A file's name is the hash of the recorded stream it was made from, so that copies of a session share it;
when all of them take more than ``ECAT_CACHE_GB`` (20 by default), those not played for longest go first.
"""

from __future__ import annotations

import contextlib
import os
import queue
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

from ecat.errors import EcatError, NotFoundError
from ecat.store import Session, files
from ecat.store.times import count_images
from ecat.web import encode
from ecat.web.exact import DEPTH_KINDS, IMAGE_KINDS

State: TypeAlias = Literal["absent", "making", "ready", "failed"]
VERSION = 1
"""Part of the files' names: another way of encoding makes them anew."""
USUAL_GB = 20.0
_TELL_EVERY_S = 0.5
_STALE_S = 24 * 3600
_NICE = 10


@dataclass(frozen=True)
class Proxy:
    """The video of one stream: ``path`` and ``rate_hz`` once it is ``ready``, ``progress`` from 0 to 1 until then."""

    state: State = "absent"
    progress: float | None = None
    path: Path | None = None
    rate_hz: float | None = None
    why: str = ""


class CancelledError(Exception):
    """The server ends, and nobody is going to play what is being made."""


Changed: TypeAlias = Callable[[str, Proxy], None]


@dataclass(frozen=True)
class _Job:
    key: str
    session: Session
    stream: str


def cache_folder() -> Path:
    """Where proxies are kept."""
    if chosen := os.environ.get("ECAT_CACHE"):
        return Path(chosen) / "proxies"
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "ecat" / "proxies"


class Proxies:
    """Makes proxies one after the other, in a thread of low priority; ``changed`` is called there.

    Proxies are known by :func:`key_of`, so that several streams may share one.
    """

    def __init__(self, folder: Path | None = None, changed: Changed = lambda *_: None) -> None:
        self.folder = folder or cache_folder()
        self.changed = changed
        self._known: dict[str, Proxy] = {}
        self._lock = threading.Lock()
        self._jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        self._ends = threading.Event()
        self._worker: threading.Thread | None = None

    def get(self, session: Session, stream: str, *, make: bool = True) -> Proxy:
        """The proxy of a stream as it is now; one that is absent is going to be made if ``make`` is set."""
        key = key_of(session, stream)
        with self._lock:
            known = self._known.get(key, Proxy())
            if known.state == "ready" and known.path is not None and not known.path.is_file():
                known = Proxy()  # removed by somebody
            if known.state == "absent" and make and not self._ends.is_set():
                known = Proxy("making", 0.0)
                self._jobs.put(_Job(key, session, stream))
                if self._worker is None:
                    self._worker = threading.Thread(target=self._work, name="proxies", daemon=True)
                    self._worker.start()
            self._known[key] = known
        return known

    def close(self) -> None:
        """End the work, also half way, and wait for that."""
        self._ends.set()
        self._jobs.put(None)
        if self._worker is not None:
            self._worker.join()

    def _work(self) -> None:
        with contextlib.suppress(OSError, AttributeError):
            # of this thread and those that the encoder starts from it: an edit must not wait for a video
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)
        while (job := self._jobs.get()) is not None and not self._ends.is_set():
            try:
                done = self._made(job)
            except CancelledError:
                return
            except EcatError as error:
                done = Proxy("failed", why=str(error))
            except OSError as error:
                done = Proxy("failed", why=f"{self.folder}: {error.strerror or error}")
            self._set(job.key, done)

    def _set(self, key: str, proxy: Proxy) -> None:
        with self._lock:
            self._known[key] = proxy
        self.changed(key, proxy)

    def _made(self, job: _Job) -> Proxy:
        session, stream = job.session, job.session.stream(job.stream)
        recorded = session.stream_path(job.stream)
        name = f"{stream.sha256 or files.sha256_of(recorded)}-{'d' if stream.kind in DEPTH_KINDS else 'c'}{VERSION}.mp4"
        path = self.folder / name
        if not path.is_file():
            rate_hz = encode.direct_rate(session, job.stream, count_images(session, stream))
            if rate_hz is not None:
                return Proxy("ready", 1.0, recorded, rate_hz)
            self._encode(job, path)
            self._make_room(path)
        with contextlib.suppress(OSError):
            os.utime(path)  # played last of all
        return Proxy("ready", 1.0, path, encode.RATE_HZ)

    def _encode(self, job: _Job, path: Path) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f".{path.stem}.{secrets.token_hex(6)}.partial")
        count, told_s = count_images(job.session, job.session.stream(job.stream)), 0.0

        def tell(done: int) -> None:
            nonlocal told_s
            if self._ends.is_set():
                raise CancelledError
            if time.monotonic() - told_s > _TELL_EVERY_S:
                told_s = time.monotonic()
                self._set(job.key, Proxy("making", min(done / count, 1.0) if count else None))

        try:
            encode.write_proxy(job.session, job.stream, partial, tell)
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)

    def _make_room(self, new: Path) -> None:
        """Remove what was not played for longest, and what was left behind half made."""
        with contextlib.suppress(ValueError):
            most = float(os.environ.get("ECAT_CACHE_GB", USUAL_GB)) * 1e9
            with self._lock:
                ours = {proxy.path for proxy in self._known.values()} | {new}
            make_room(self.folder, most, keep=ours)


def make_room(folder: Path, most_bytes: float, *, keep: set[Path | None]) -> None:
    """Remove the oldest proxies of ``folder`` until the rest takes at most ``most_bytes``, but none to ``keep``."""
    found: list[tuple[float, int, Path]] = []
    for path in folder.iterdir():
        with contextlib.suppress(OSError):
            stat = path.stat()
            if path.name.endswith(".partial") and time.time() - stat.st_mtime > _STALE_S:
                path.unlink()
            elif path.suffix == ".mp4":
                found.append((stat.st_mtime, stat.st_size, path))
    total = sum(size for _, size, _ in found)
    for _, size, path in sorted(found):
        if total <= most_bytes:
            return
        if path not in keep:
            with contextlib.suppress(OSError):
                path.unlink()
                total -= size


def key_of(session: Session, stream: str) -> str:
    """What tells apart the proxies of a server.

    Raises
    ------
    NotFoundError : there is no such stream, it has no images, or its file is missing.
    """
    record = session.stream(stream)
    if record.kind not in IMAGE_KINDS:
        raise NotFoundError(
            f"cannot show stream {stream}",
            where=f"there are no images in a stream of the kind {record.kind}",
            fix="show a stream of colour, depth or infrared",
        )
    path = session.stream_path(stream)
    if not path.is_file():
        raise NotFoundError(
            f"cannot show stream {stream}", where=f"{path}: it is gone", fix="restore the file from a copy"
        )
    return f"{record.sha256 or path}/{record.kind}"


def describe(proxy: Proxy, url: str) -> dict[str, Any]:
    """As the page is told."""
    ready = proxy.state == "ready"
    return {
        "state": proxy.state,
        "progress": proxy.progress,
        "url": url if ready else None,
        "fps": proxy.rate_hz if ready else None,
    }
