"""Bounded reads and durable writes: every call of the store that changes the disk is in this module.
 A file is durable once its content and the folder entry that names it are synced.  :data:`step` is called
before each change, so that tests can let the disk fill up or the process die at any of them.
"""

from __future__ import annotations

import errno
import hashlib
import io
import os
import shutil
import stat
import tempfile
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, cast

from ecat.errors import FormatError, LimitError, SchemaError, os_error

_CHUNK = 1 << 20
_SYNCS_AT_ONCE = 4


def _go_on(action: str, path: Path) -> None:
    del action, path


step: Callable[[str, Path], None] = _go_on
"""Called with what is about to be done (write, sync, rename, remove, make) and to which path."""


@contextmanager
def typed_errors(what: str, path: Path, consequence: str = "it was not read") -> Generator[None]:
    """Turn an ``OSError`` of the block into the typed error that says ``what`` could not be done; see
    :func:`ecat.errors.os_error`.
    """
    try:
        yield
    except OSError as error:
        raise os_error(error, what, error.filename or path, consequence) from error


def open_regular(path: Path) -> io.BufferedReader:
    """Open for reading what must be a regular file; a pipe or a device would block or never end."""
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    descriptor = os.open(path, flags)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise FormatError(
            f"cannot read {path.name}",
            where=f"{path}: not a regular file",
            consequence="it was not read",
            fix="put the file itself there, not a folder, a pipe or a device",
        )
    return os.fdopen(descriptor, "rb")


def read_bytes(path: Path, limit: int) -> bytes:
    """The whole file.

    Raises
    ------
    LimitError : the file has more than ``limit`` bytes.
    """
    with open_regular(path) as file:
        data = file.read(limit + 1)
    if len(data) > limit:
        raise LimitError(
            f"cannot read {path.name}",
            where=f"{path}: more than {limit:,} bytes",
            consequence="it was not read",
            fix="check that this is the right file",
        )
    return data


def sha256_of(path: Path) -> str:
    """SHA-256 of a file, as 64 hexadecimal digits."""
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def confined(root: Path, target: str) -> Path:
    """``root / target``, where no symbolic link on the way leads out of ``root``.

    Raises
    ------
    SchemaError : a link leaves the folder.
    """
    path = root / target
    if not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(root)):
        raise SchemaError(
            f"cannot use {target} of {root.name}",
            where=f"{path}: a symbolic link leads out of the session's folder",
            consequence="nothing outside of the session was read or written",
            fix="replace the link by the file or folder that it points to",
        )
    return path


def scratch_file(folder: Path) -> BinaryIO:
    """A file that is gone when it is closed, or with the process; on Linux it has no name in ``folder``."""
    step("write", folder)
    return cast("BinaryIO", tempfile.TemporaryFile(dir=folder))


class NewFile(io.RawIOBase):
    """A file being written, with the SHA-256 and the size of what was written so far."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        step("write", path)
        self.path = path
        self.size = 0
        self._digest = hashlib.sha256()
        self._file = path.open("wb")

    @property
    def sha256(self) -> str:
        """SHA-256 of the bytes written so far."""
        return self._digest.hexdigest()

    def writable(self) -> bool:
        """Yes."""
        return True

    def tell(self) -> int:
        """The number of bytes written."""
        return self.size

    def write(self, data: object, /) -> int:
        """Append ``data`` (anything with the buffer protocol)."""
        step("write", self.path)
        view = memoryview(data).cast("B")  # pyright: ignore[reportArgumentType]
        self._digest.update(view)
        self._file.write(view)
        self.size += len(view)
        return len(view)

    def close(self) -> None:
        """Hand the rest to the operating system; not durable before :func:`sync`."""
        if not self.closed:
            try:
                self._file.close()
            finally:
                super().close()


def copy(source: Path, file: NewFile) -> None:
    """Append the content of ``source`` to ``file``."""
    with open_regular(source) as reader:
        while chunk := reader.read(_CHUNK):
            file.write(chunk)


def sync(path: Path) -> None:
    """Wait until a file's content, or a folder's entries, are on the disk."""
    step("sync", path)
    if os.name == "nt" and path.is_dir():  # pragma: no cover - Windows syncs folder entries by itself
        return
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_all(paths: Sequence[Path]) -> None:
    """:func:`sync` each of ``paths``, several at a time: a disk can bring many to an end together."""
    if len(paths) == 1:
        return sync(paths[0])
    with ThreadPoolExecutor(_SYNCS_AT_ONCE) as pool:
        for _ in pool.map(sync, paths):
            pass
    return None


def rename(source: Path, target: Path) -> None:
    """Give ``source`` the name ``target``, in one instant, replacing what had it."""
    step("rename", target)
    source.replace(target)


def remove(path: Path) -> None:
    """Remove a file, or a folder with all that is in it; nothing happens if it is not there."""
    step("remove", path)
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def make_folder(path: Path) -> None:
    """Make one folder, unless it is there."""
    if not path.is_dir():
        step("make", path)
        # another process may have made it since it was looked for
        path.mkdir(exist_ok=True)


def make_folders(path: Path) -> None:
    """Make a folder, and those around it that are not there."""
    for folder in reversed([path, *path.parents]):
        make_folder(folder)


def sync_tree(path: Path) -> None:
    """:func:`sync` a file, or a folder with all that is in it."""
    if not path.is_dir():
        return sync(path)
    inside = list(path.rglob("*"))
    sync_all([inner for inner in inside if not inner.is_symlink() and inner.is_file()])
    sync_all([inner for inner in inside if not inner.is_symlink() and inner.is_dir()])
    return sync(path)


def link_or_copy(source: Path, target: Path) -> None:
    """Make ``target``, which is not there, the same file or folder as ``source``; without a copy if the disk can."""
    step("write", target)
    if source.is_dir():
        shutil.copytree(source, target, copy_function=_link_or_copy)
    else:
        _link_or_copy(source, target)


def _link_or_copy(source: str | Path, target: str | Path) -> None:
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


def open_journal(path: Path) -> BinaryIO:
    """Open a file for reading and appending; it is made if it is not there."""
    step("write", path)
    flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    return os.fdopen(os.open(path, flags, 0o644), "r+b", buffering=0)


def append(file: BinaryIO, path: Path, data: bytes) -> None:
    """Write ``data`` where ``file`` stands, and wait until it is on the disk."""
    step("write", path)
    if file.write(data) != len(data):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    step("sync", path)
    os.fsync(file.fileno())
