"""Streams whose files are written by functions into the session that is being made."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from ecat.errors import UsageError
from ecat.model import Manifest, Stream
from ecat.store import Draft, create_session, validate
from ecat.store.files import sha256_of
from tests.store.media.clips import COLOR, color_clip, session_of

MANIFEST = Manifest(name="s", created="2020-01-01T00:00:00", streams=(COLOR,))


def test_a_written_stream_is_recorded_like_a_copied_one(tmp_path: Path) -> None:
    session = session_of(tmp_path / "s", [COLOR], {"color": color_clip})
    stream, path = session.stream("color"), session.stream_path("color")
    assert stream.present
    assert stream.size_bytes == path.stat().st_size
    assert stream.sha256 == sha256_of(path)
    assert validate(session, deep=True) == []


def test_a_writer_that_fails_leaves_no_session(tmp_path: Path) -> None:
    def fail(path: Path) -> None:
        path.write_bytes(b"half")
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        session_of(tmp_path / "s", [COLOR], {"color": fail})
    assert list(tmp_path.iterdir()) == []


def test_the_manifest_is_finished_when_the_media_are_there(tmp_path: Path) -> None:
    counted: list[int] = []

    def write(path: Path) -> None:
        color_clip(path, 7)
        counted.append(7)

    def finish(manifest: Manifest) -> Manifest:
        assert manifest.streams[0].present
        return replace(manifest, n_frames=counted[0])

    session = create_session(tmp_path / "s", Draft(manifest=MANIFEST, media={"color": write}, finish=finish))
    assert session.manifest.n_frames == 7


def test_two_streams_do_not_write_the_same_file(tmp_path: Path) -> None:
    twice = [COLOR, replace(COLOR, name="other")]
    with pytest.raises(UsageError, match="cannot write the file of stream other"):
        session_of(tmp_path / "s", twice, {"color": color_clip, "other": color_clip})


def test_a_stream_s_file_is_in_media(tmp_path: Path) -> None:
    astray = Stream(name="color", kind="color", file="color.mp4")
    with pytest.raises(UsageError, match="cannot write the file of stream color"):
        session_of(tmp_path / "s", [astray], {"color": color_clip})
