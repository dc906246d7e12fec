"""Work that is done side by side comes to its end, or fails as one."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

from ecat.errors import UsageError
from ecat.model import Manifest, Stream
from ecat.store import Draft, create_session
from ecat.store.media import DepthWriter
from ecat.store.together import GivenUp, go_on, run_together

PATIENCE_S = 30.0


def test_all_of_it_is_done() -> None:
    done: list[int] = []
    run_together([lambda number=number: done.append(number) for number in range(20)])
    assert sorted(done) == list(range(20))
    run_together([])


def test_one_alone_is_done_in_the_thread_that_asks() -> None:
    threads: list[int] = []
    run_together([lambda: threads.append(threading.get_ident())])
    assert threads == [threading.get_ident()]


def test_streams_are_written_when_a_session_is_made_and_not_into_one(tmp_path: Path) -> None:
    manifest = Manifest(
        name="s", created="2020-01-01T00:00:00", streams=(Stream(name="d", kind="depth", file="media/d.mkv"),)
    )

    def film(path: Path) -> None:
        with DepthWriter(path, 4, 4) as writer:
            writer.write(np.ones((4, 4), np.uint16), 0)

    session = create_session(tmp_path / "s", Draft(manifest=manifest, media={"d": film}))
    recorded = (session.path / "media/d.mkv").read_bytes()
    called: list[Path] = []
    with session.write() as commit, pytest.raises(UsageError, match="before"):
        commit.write_streams({"d": called.append})
    assert not called
    assert (session.path / "media/d.mkv").read_bytes() == recorded


def test_the_first_failure_is_raised_and_ends_the_rest() -> None:
    started, ended = threading.Event(), threading.Event()

    def endless() -> None:
        started.set()
        try:
            while True:
                go_on()
        except GivenUp:
            ended.set()
            raise

    def failing() -> None:
        assert started.wait(PATIENCE_S)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run_together([endless, failing])
    assert ended.is_set()


def test_what_has_not_begun_does_not_begin_after_a_failure() -> None:
    begun: list[int] = []

    def failing() -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run_together([failing, *[lambda: begun.append(1)] * 1000])
    assert len(begun) < 1000


def test_work_that_is_done_alone_always_goes_on() -> None:
    go_on()


def test_a_stream_that_fails_stops_the_video_beside_it(tmp_path: Path) -> None:
    first = threading.Event()

    def endless(path: Path) -> None:
        with DepthWriter(path, 32, 32) as writer:
            for number in range(10_000_000):
                writer.write(np.zeros((32, 32), np.uint16), number * 1000)
                first.set()

    def failing(path: Path) -> None:
        assert first.wait(PATIENCE_S)
        raise UsageError(f"cannot write {path.name}", where="it fails", fix="nothing")

    streams = tuple(
        Stream(name=name, kind="depth", file=f"media/{name}.mkv", codec="ffv1 gray16le", depth_unit_m=0.001)
        for name in ("far", "near")
    )
    manifest = Manifest(name="s", created="2020-01-01T00:00:00", streams=streams)
    with pytest.raises(UsageError, match=r"cannot write near\.mkv"):
        create_session(tmp_path / "s", Draft(manifest=manifest, media={"far": endless, "near": failing}))
    assert list(tmp_path.iterdir()) == []
