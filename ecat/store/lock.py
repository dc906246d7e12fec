"""One writer at a time: ``session.lock`` in the session's folder.
 The operating system holds the lock on behalf of the writing process and releases it when that process ends,
however it ends: a lock file left behind is not a lock, and is never an obstacle.  The content only tells a
person who is writing.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import time
from collections.abc import Generator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from ecat.errors import LockedError
from ecat.store import files

LOCK_FILE = "session.lock"
_PAUSE_S = 0.01

try:
    import fcntl

    def _take(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def _give(descriptor: int) -> None:
        # unlocks for forked children too, which share the descriptor
        fcntl.flock(descriptor, fcntl.LOCK_UN)

except ImportError:  # pragma: no cover - Windows
    import msvcrt

    # a byte far behind the content, which stays readable
    _FAR = 1 << 30

    def _take(descriptor: int) -> None:
        os.lseek(descriptor, _FAR, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        except OSError as error:
            raise BlockingIOError(error.errno, error.strerror) from error

    def _give(descriptor: int) -> None:
        os.lseek(descriptor, _FAR, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_UNLCK, 1)  # type: ignore[attr-defined]


@contextmanager
def locked(folder: Path, *, what: str = "", wait_s: float = 0.0) -> Generator[None]:
    """Hold the write lock of a session's folder; ``what`` is the first line of an error.

    Raises
    ------
    LockedError : another process, or another thread of this one, holds it for longer than ``wait_s``.
    ReadOnlyError, DiskError, NotFoundError : the lock file cannot be made.
    """
    path = folder / LOCK_FILE
    what = what or f"cannot write to {folder.name}"
    with files.typed_errors(what, path, "nothing was written"):
        descriptor = _acquire(path, what, time.monotonic() + wait_s)
    try:
        yield
    finally:
        # removed while held: a waiting process finds that its file is gone and opens the next one
        with contextlib.suppress(OSError):
            if _names(path, descriptor):
                path.unlink()
        with contextlib.suppress(OSError):
            _give(descriptor)
        os.close(descriptor)


@contextmanager
def exclusive(descriptor: int, path: Path, *, wait_s: float = 5.0) -> Generator[None]:
    """Hold the lock on one open file.

    Raises
    ------
    LockedError : somebody else holds it for longer than ``wait_s``.
    """
    _wait(descriptor, path, f"cannot write to {path.name}", time.monotonic() + wait_s)
    try:
        yield
    finally:
        _give(descriptor)


def _acquire(path: Path, what: str, deadline: float) -> int:
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o644)
        try:
            _wait(descriptor, path, what, deadline)
            if _names(path, descriptor):
                _sign(descriptor)
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


def _wait(descriptor: int, path: Path, what: str, deadline: float) -> None:
    while True:
        try:
            _take(descriptor)
            return
        except BlockingIOError:
            if time.monotonic() >= deadline:
                raise LockedError(
                    what,
                    where=f"{path}: {_holder(path)}",
                    consequence="nothing was written",
                    fix="wait until the other program has finished, or end it",
                ) from None
        time.sleep(_PAUSE_S)


def _names(path: Path, descriptor: int) -> bool:
    # the last holder may have removed the file between our open and our lock
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _sign(descriptor: int) -> None:
    now = datetime.now(UTC).isoformat(timespec="seconds")
    content = json.dumps({"pid": os.getpid(), "host": socket.gethostname(), "since": now})
    os.ftruncate(descriptor, 0)
    os.write(descriptor, content.encode())


def _holder(path: Path) -> str:
    try:
        content = json.loads(files.read_bytes(path, 4096))
        return f"held by process {content['pid']} on {content['host']} since {content['since']}"
    except (OSError, ValueError, LookupError, TypeError):
        return "held by another process"
