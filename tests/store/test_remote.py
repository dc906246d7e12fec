"""Sessions and exports that lie elsewhere: in an S3-compatible store over HTTP, and in fsspec's own memory."""

from __future__ import annotations

import functools
import shutil
import socket
import threading
from collections.abc import Generator, Iterator
from dataclasses import replace
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from ecat.errors import (
    DiskError,
    EcatError,
    ExistsError,
    MissingExtraError,
    NotFoundError,
    StaleError,
    UsageError,
)
from ecat.model import Stream
from ecat.store import create_session, open_session, remote
from tests.store.sessions import MANIFEST, draft, make

fsspec = pytest.importorskip("fsspec", reason="fsspec is not installed: pip install 'ecat[remote]'")


@pytest.fixture(scope="module")
def s3() -> Iterator[str]:
    """The URL of a bucket of a server of our own."""
    pytest.importorskip("s3fs", reason="s3fs is not installed: pip install 'ecat[remote]'")
    server = pytest.importorskip("moto.server", reason="moto is not installed: pip install 'ecat[test]'")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    running = server.ThreadedMotoServer(ip_address="127.0.0.1", port=port, verbose=False)
    running.start()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ACCESS_KEY_ID", "test")
        patch.setenv("AWS_SECRET_ACCESS_KEY", "test")
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        patch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")
        # of a server before this one, where it was is kept, and here what it held
        fsspec.get_filesystem_class("s3").clear_instance_cache()
        fsspec.filesystem("s3").makedirs("lab", exist_ok=True)
        yield "s3://lab"
    running.stop()


@pytest.fixture(params=["memory", "s3"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Generator[str]:
    """The URL of a folder that is empty."""
    root = "memory://lab" if request.param == "memory" else request.getfixturevalue("s3")
    url = f"{root}/{tmp_path.name}"
    yield url
    remote.remove(url)


def tree(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }


def test_a_session_comes_back_as_it_went(place: str, tmp_path: Path) -> None:
    make(tmp_path / "project" / "a" / "one", 7)
    remote.send(tmp_path / "project", f"{place}/project")
    [url] = remote.find_sessions(f"{place}/project")
    assert url == f"{place}/project/a/one"
    with remote.fetched(url) as folder:
        assert tree(folder) == tree(tmp_path / "project" / "a" / "one")
        assert open_session(folder).table("poses").num_rows == 30
    assert not folder.exists()


def test_sessions_are_found_in_order_and_not_inside_of_others(place: str, tmp_path: Path) -> None:
    for name in ("b", "a/two", "a/one"):
        make(tmp_path / "p" / name)
    (tmp_path / "p" / "b" / "copy").mkdir()
    shutil.copy(tmp_path / "p" / "b" / "session.json", tmp_path / "p" / "b" / "copy")
    remote.send(tmp_path / "p", f"{place}/p")
    assert remote.find_sessions(f"{place}/p") == [f"{place}/p/{name}" for name in ("a/one", "a/two", "b")]
    assert remote.find_sessions(f"{place}/p/b") == [f"{place}/p/b"]
    assert remote.find_sessions(f"{place}/p/b/") == [f"{place}/p/b"]
    with pytest.raises(NotFoundError, match="cannot find sessions"):
        remote.find_sessions(f"{place}/p/b/session.json")


def test_media_can_be_left_where_they_are(place: str, tmp_path: Path) -> None:
    manifest = replace(MANIFEST, streams=(Stream(name="color", file="media/color.mp4", present=True),))
    (tmp_path / "color.mp4").write_bytes(b"images")
    media = {"color": tmp_path / "color.mp4"}
    create_session(tmp_path / "s", replace(draft(), manifest=manifest, files=media))
    remote.send(tmp_path / "s", f"{place}/s")
    with remote.fetched(f"{place}/s") as folder:
        assert (folder / "media" / "color.mp4").read_bytes() == b"images"
    with remote.fetched(f"{place}/s", media=False) as folder:
        assert not (folder / "media").exists()
        assert open_session(folder).events.num_rows == 1


def test_all_sessions_are_brought_without_their_media(place: str, tmp_path: Path) -> None:
    for name in ("b", "a/two", "a/one"):
        make(tmp_path / "p" / name)
    remote.send(tmp_path / "p", f"{place}/p")
    with remote.all_at_hand(f"{place}/p") as folder:
        assert folder.name == "p"
        assert tree(folder) == tree(tmp_path / "p")
    assert not folder.exists()
    with remote.all_at_hand(f"{place}/p/b") as folder:
        assert open_session(folder).events.num_rows == 1
    with pytest.raises(NotFoundError), remote.all_at_hand(f"{place}/q"):
        pass
    with remote.all_at_hand(tmp_path) as folder:
        assert folder == tmp_path


def test_what_is_written_appears_when_it_is_whole(place: str, tmp_path: Path) -> None:
    with remote.sent(f"{place}/out") as path:
        (path / "inner").mkdir(parents=True)
        (path / "inner" / "file").write_text("content")
        (path / "top").write_text("says what there is")
        assert remote.read(f"{place}/out/top") is None
    remote.fetch(f"{place}/out", tmp_path / "back")
    assert tree(tmp_path / "back") == {"inner/file": b"content", "top": b"says what there is"}
    with remote.sent(f"{place}/single.txt") as path:
        path.write_text("one file")
    assert remote.read(f"{place}/single.txt") == b"one file"


def test_what_is_there_is_not_replaced(place: str) -> None:
    with remote.sent(f"{place}/out") as path:
        path.write_text("precious")
    with pytest.raises(ExistsError, match="cannot write"), remote.sent(f"{place}/out"):
        pass
    assert remote.read(f"{place}/out") == b"precious"


def test_an_exception_sends_nothing(place: str) -> None:
    def fill() -> None:
        with remote.sent(f"{place}/out") as path:
            path.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fill()
    assert remote.read(f"{place}/out") is None


def test_half_of_what_was_to_be_sent_is_removed_again(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("a", "b"):
        (tmp_path / name).write_text(name)
    whole, seen = remote.open_url, list[str]()

    class Failing:
        def __init__(self, system: Any) -> None:
            self._system = system

        def __getattr__(self, name: str) -> Any:
            return getattr(self._system, name)

        def put_file(self, source: str, target: str) -> None:
            seen.append(target)
            if len(seen) == 2:
                raise ConnectionResetError("the network is gone")
            self._system.put_file(source, target)

    monkeypatch.setattr(remote, "open_url", lambda url: (Failing(whole(url)[0]), whole(url)[1]))
    with pytest.raises(DiskError, match="cannot write") as caught:
        remote.send(tmp_path, f"{place}/out")
    assert "nothing is left" in caught.value.consequence
    monkeypatch.undo()
    assert remote.read(f"{place}/out/a") is None


def test_a_session_that_changes_while_it_is_fetched_is_not_taken(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make(tmp_path / "one")
    remote.send(tmp_path / "one", f"{place}/one")
    read, seen = remote.read_manifest, list[bytes]()

    def changing(url: str) -> bytes:
        seen.append(read(url) + b" " * len(seen))
        return seen[-1]

    monkeypatch.setattr(remote, "read_manifest", changing)
    with pytest.raises(StaleError, match="cannot fetch"), remote.fetched(f"{place}/one"):
        pass


def test_nothing_there_and_no_such_bucket_are_told(place: str, s3: str) -> None:
    for url in (f"{place}/nowhere", "s3://no-such-bucket-anywhere/x"):
        with pytest.raises(NotFoundError, match="cannot find sessions"):
            remote.find_sessions(url)
    with pytest.raises(EcatError, match="cannot read the session"):
        remote.read_manifest(f"{place}/nowhere")


@pytest.mark.parametrize("url", ["s3://", "s3:///lab/x"])
def test_a_url_without_a_bucket_is_refused_and_none_is_made(s3: str, url: str) -> None:
    for use in (remote.find_sessions, remote.refuse_taken, remote.remove):
        with pytest.raises(NotFoundError, match="names no bucket"):
            use(url)
    assert fsspec.filesystem("s3", use_listings_cache=False).ls("") == [s3.removeprefix("s3://")]


def test_a_url_of_what_has_no_buckets_needs_none(tmp_path: Path) -> None:
    (tmp_path / "there").touch()
    system, root = remote.open_url(f"simplecache::file://{tmp_path}")
    assert system.exists(f"{root}/there")
    for url in ("http://", "https:///x"):
        with pytest.raises(NotFoundError, match="names no bucket or host"):
            remote.open_url(url)


def test_an_unknown_protocol_or_a_missing_library_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(EcatError) as caught:
        remote.find_sessions("nonsense://x/y")
    assert "nonsense" in str(caught.value)
    monkeypatch.setitem(__import__("sys").modules, "fsspec.core", None)
    with pytest.raises(MissingExtraError) as missing:
        remote.find_sessions("memory://x")
    assert "ecat[remote]" in missing.value.fix


def test_a_manifest_that_names_files_outside_is_refused(place: str, tmp_path: Path) -> None:
    make(tmp_path / "one")
    manifest = tmp_path / "one" / "session.json"
    manifest.write_text(manifest.read_text().replace("tables/poses.parquet", "../../poses.parquet"))
    remote.send(tmp_path / "one", f"{place}/one")
    with pytest.raises(EcatError), remote.fetched(f"{place}/one"):
        pass


@pytest.fixture
def site(tmp_path: Path) -> Iterator[str]:
    """The URL of a web server that lists the files of ``tmp_path``."""
    pytest.importorskip("aiohttp", reason="aiohttp is not installed: pip install 'ecat[remote]'")
    handler = functools.partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        running = threading.Thread(target=server.serve_forever)
        running.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        running.join()


def test_sessions_are_read_from_a_web_server(site: str, tmp_path: Path) -> None:
    for name in ("two", "one"):
        make(tmp_path / "p" / name)
    assert remote.find_sessions(f"{site}/p") == [f"{site}/p/one", f"{site}/p/two"]
    assert remote.find_sessions(f"{site}/p/one") == [f"{site}/p/one"]
    with remote.fetched(f"{site}/p/one") as folder:
        assert tree(folder) == tree(tmp_path / "p" / "one")


@pytest.mark.parametrize("url", ["http://host/out", "https://host/out.csv"])
def test_nothing_is_written_to_a_web_server(url: str) -> None:
    with pytest.raises(UsageError, match="nothing can be written there"), remote.sent(url):
        pass


def test_a_store_that_refuses_the_credentials_is_said(s3: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(url: str) -> None:
        raise PermissionError("Forbidden")

    monkeypatch.setattr(remote, "open_url", refuse)
    with pytest.raises(DiskError, match="PermissionError: Forbidden") as caught:
        remote.refuse_taken(f"{s3}/out")
    assert "credentials" in caught.value.fix
    assert caught.value.consequence == "nothing was written"


def test_paths_and_urls_are_told_apart() -> None:
    assert remote.place_of("s3://lab/x/") == "s3://lab/x"
    assert remote.place_of("s3://") == "s3://"
    assert remote.place_of("a/b") == Path("a/b")
    assert not remote.is_url(Path("s3:/lab"))
