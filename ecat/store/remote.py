"""Sessions and exports that lie elsewhere: any URL that fsspec knows (``s3://bucket/project``, ``gs://...``, ...).

A session is fetched to this machine for as long as it is needed, with nothing but what its manifest names.  What is
written is made here, whole, and then sent; there is no way to make many objects appear at once, so the files at the
top, which say what the others are, are sent last, and if sending fails, what was sent is removed.
"""

from __future__ import annotations

import tempfile
from collections.abc import Generator, Iterable
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import Any, cast

from ecat.errors import (
    DiskError,
    EcatError,
    ExistsError,
    LimitError,
    MissingExtraError,
    NotFoundError,
    StaleError,
    UsageError,
)
from ecat.model import Manifest
from ecat.store import files
from ecat.store.manifest import MAX_BYTES, SESSION_FILE, journal_file, parse_manifest

_IN_PLACES = ("abfs", "abfss", "az", "ftp", "gcs", "gs", "http", "https", "s3", "s3a", "sftp", "ssh")
"""Protocols whose URLs name a bucket or host first; others, as ``hdfs:///folder``, may name none."""


def is_url(place: Path | str) -> bool:
    """Whether ``place`` is a URL and not a path."""
    return isinstance(place, str) and "://" in place


def place_of(text: Path | str) -> Path | str:
    """A URL as it is, anything else as a path."""
    if not is_url(text):
        return Path(text)
    protocol, _, place = str(text).partition("://")
    return f"{protocol}://{place.rstrip('/')}"


def is_own_memory(place: Path | str) -> bool:
    """Whether ``place`` is a URL of what fsspec holds in the memory of this process, where no other sees it."""
    return str(place).startswith("memory://")  # of a path one slash is left


def find_sessions(url: str) -> list[str]:
    """The URLs of all sessions at or below ``url``, in the order of their paths.

    Raises
    ------
    NotFoundError : there is none, or nothing at all.
    MissingExtraError, DiskError : the URL cannot be read.
    """
    url = str(place_of(url))
    with _typed(f"cannot find sessions at {url}", url):
        system, root = open_url(url)
        found = system.find(root) if system.exists(root) else []
    # no paths: of http://host they would make http:/host
    manifests = (name for name in found if name.endswith(f"/{SESSION_FILE}") and name != root)
    folders = sorted(name.rpartition("/")[0] for name in manifests)
    outer = [f for i, f in enumerate(folders) if i == 0 or not f.startswith(f"{folders[i - 1]}/")]
    if not outer:
        raise NotFoundError(
            f"cannot find sessions at {url}", where="no session.json at or below it", fix="check the URL"
        )
    return [url + folder.removeprefix(root.rstrip("/")) for folder in outer]


def read_manifest(url: str) -> bytes:
    """What the ``session.json`` of the session at ``url`` holds.

    Raises
    ------
    LimitError : it is too large to be one.
    """
    what = f"cannot read the session at {url}"
    with _typed(what, url):
        system, root = open_url(url)
        size = system.size(f"{root}/{SESSION_FILE}")
        if size is not None and size > MAX_BYTES:
            raise LimitError(what, where=f"{SESSION_FILE} has more than {MAX_BYTES:,} bytes")
        return system.cat_file(f"{root}/{SESSION_FILE}")


@contextmanager
def fetched(url: str, *, media: bool = True) -> Generator[Path]:
    """A copy of the session at ``url`` on this machine for the time of the block; without ``media`` but for its name.

    Raises
    ------
    StaleError : somebody changed the session while it was fetched.
    """
    with tempfile.TemporaryDirectory(prefix="ecat-") as scratch:
        folder = Path(scratch) / (PurePosixPath(url).name or "session")
        _fetch_session(url, folder, media=media)
        yield folder


def _fetch_session(url: str, folder: Path, *, media: bool) -> None:
    data = read_manifest(url)
    manifest = parse_manifest(data, Path(PurePosixPath(url).name) / SESSION_FILE, Manifest)
    folder.mkdir(parents=True)
    with _typed(f"cannot fetch the session at {url}", url):
        system, root = open_url(url)
        for name in _named(manifest, media=media):
            target = files.confined(folder, name)
            target.parent.mkdir(parents=True, exist_ok=True)
            system.get_file(f"{root}/{name}", str(target))
    (folder / SESSION_FILE).write_bytes(data)
    if read_manifest(url) != data:
        raise StaleError(
            f"cannot fetch the session at {url}",
            where="it was changed while it was fetched",
            consequence="nothing was taken from it",
            fix="try again",
        )


def _named(manifest: Manifest, *, media: bool) -> Iterable[str]:
    yield from (table.file for table in manifest.tables)
    yield from (layer.file for layer in manifest.layers)
    yield from (journal_file(layer.name) for layer in manifest.layers if layer.journal_bytes)
    if media:
        yield from (stream.file for stream in manifest.streams if stream.present)


@contextmanager
def at_hand(place: Path | str, *, media: bool = True) -> Generator[Path]:
    """The session at ``place`` as a folder of this machine, for the time of the block."""
    if isinstance(place, Path):
        yield place
        return
    with fetched(place, media=media) as folder:
        yield folder


@contextmanager
def all_at_hand(place: Path | str) -> Generator[Path]:
    """All sessions at or below ``place`` on this machine, for the time of the block; of those at a URL without media.

    Raises
    ------
    NotFoundError : there is none at the URL.
    """
    if isinstance(place, Path):
        yield place
        return
    with tempfile.TemporaryDirectory(prefix="ecat-") as scratch:
        top = Path(scratch) / (PurePosixPath(place).name or "sessions")
        for url in find_sessions(place):
            _fetch_session(url, files.confined(top, url.removeprefix(place).strip("/") or "."), media=False)
        yield top


@contextmanager
def sent(url: str) -> Generator[Path]:
    """A path on this machine where nothing is yet; what the block makes there is sent to ``url`` when it ends.

    Raises
    ------
    ExistsError : there is something at ``url`` already.
    """
    refuse_taken(url)
    with tempfile.TemporaryDirectory(prefix="ecat-") as scratch:
        path = Path(scratch) / (PurePosixPath(url).name or "export")
        yield path
        send(path, url)


def refuse_taken(url: str) -> None:
    """Return if nothing is at ``url``.

    Raises
    ------
    ExistsError : there is something.
    UsageError : nothing can be written there.
    """
    if url.startswith(("http://", "https://")):
        raise UsageError(
            f"cannot write {url}",
            where="from http:// and https:// sessions can be read, but nothing can be written there",
            fix="s3://bucket/folder, or a folder here",
        )
    with _typed(f"cannot write {url}", url, "nothing was written"):
        system, root = open_url(url)
        _require_bucket(system, root)
        taken = system.exists(root)
    if taken:
        raise ExistsError(
            f"cannot write {url}",
            where="there is something already",
            consequence="it was left as it is",
            fix="choose another destination, or remove it first",
        )


def send(path: Path, url: str) -> None:
    """Copy the file or folder at ``path`` to ``url``; what was sent is removed again if that fails."""
    inside = [path] if path.is_file() else sorted(inner for inner in path.rglob("*") if inner.is_file())
    names = {inner: inner.relative_to(path).as_posix() if inner != path else "" for inner in inside}
    with _typed(f"cannot write {url}", url, f"nothing is left at {url}"):
        system, root = open_url(url)
        _require_bucket(system, root)
        try:
            # what says what the others are comes last
            for inner in sorted(inside, key=lambda inner: (-names[inner].count("/"), names[inner])):
                target = f"{root}/{names[inner]}".rstrip("/")
                system.makedirs(str(PurePosixPath(target).parent), exist_ok=True)
                system.put_file(str(inner), target)
        except BaseException:
            _forget(system, root)
            raise


def _require_bucket(system: Any, root: str) -> None:
    """Return if there is the bucket to write to, where there are buckets: s3fs makes one of a name that is misspelt."""
    bucket = root.partition("/")[0]
    if bucket and not system.exists(bucket):
        with suppress(FileNotFoundError):
            system.info(bucket)  # says so, where the store does not answer
        raise FileNotFoundError(f"there is no bucket {bucket}")


def fetch(url: str, path: Path) -> None:
    """Copy the file or folder at ``url`` to ``path``, which is not there."""
    with _typed(f"cannot fetch {url}", url):
        system, root = open_url(url)
        if system.isfile(root):
            system.get_file(root, str(path))
            return
        for name in system.find(root):
            target = files.confined(path, name.removeprefix(root).lstrip("/"))
            target.parent.mkdir(parents=True, exist_ok=True)
            system.get_file(name, str(target))


def read(url: str) -> bytes | None:
    """What the file at ``url`` holds, if there is one."""
    with _typed(f"cannot read {url}", url):
        system, root = open_url(url)
        return system.cat_file(root) if system.exists(root) else None


def remove(url: str) -> None:
    """Remove all that is at ``url``, if anything is."""
    with _typed(f"cannot remove {url}", url):
        system, root = open_url(url)
        _forget(system, root)


def _forget(system: Any, root: str) -> None:
    if system.exists(root):
        system.rm(root, recursive=True)


def open_url(url: str) -> tuple[Any, str]:
    """The file system of a URL, and the path in it; nothing is remembered of what is there."""
    protocol, _, place = url.partition("://")
    if protocol in _IN_PLACES and place[:1] in ("", "/"):
        raise NotFoundError(
            f"cannot use {url}", where="it names no bucket or host", fix="s3://bucket/folder, or a path"
        )
    try:
        from fsspec.core import url_to_fs  # pyright: ignore[reportMissingTypeStubs]
    except ImportError:
        raise _missing(url, "fsspec is not installed") from None
    try:
        system, root = cast("tuple[Any, str]", url_to_fs(url, use_listings_cache=False))
    except ImportError as error:
        raise _missing(url, str(error)) from None
    except ValueError as error:
        raise NotFoundError(
            f"cannot use {url}", where=str(error), fix="s3://bucket/folder, gs://..., or a path"
        ) from None
    return system, root.rstrip("/")


def _missing(url: str, why: str) -> MissingExtraError:
    return MissingExtraError(f"cannot use {url}", where=why, fix="pip install 'ecat[remote]', or a path")


@contextmanager
def _typed(what: str, url: str, consequence: str = "nothing was taken from it") -> Generator[None]:
    try:
        yield
    except EcatError:
        raise
    except FileNotFoundError as error:
        raise NotFoundError(
            what, where=str(error) or url, consequence=consequence, fix="check the URL"
        ) from error
    except Exception as error:  # every file system has errors of its own
        raise DiskError(
            what,
            where=f"{type(error).__name__}: {error}",
            consequence=consequence,
            fix="check the URL, the credentials and the network",
        ) from error
