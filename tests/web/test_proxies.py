"""Proxies: made once, kept within bounds, shared, and not made where the recording will do."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from ecat.errors import NotFoundError
from ecat.model import Clock, Manifest, Stream
from ecat.store import Draft, Session, create_session, open_session
from ecat.web import encode, proxies
from ecat.web.proxies import Proxies, Proxy, cache_folder, make_room
from tests.web.conftest import burnt, read_number

N = 40
Video = Callable[..., Session]


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    return tmp_path / "cache"


@pytest.fixture
def video(tmp_path: Path) -> Video:
    """Make a session of a small H.264 file."""

    def make(
        *,
        gop: int = 10,
        b_frames: int = 0,
        late: int = 0,
        name: str = "color.mp4",
        pix_fmt: str = "yuv420p",
        width: int = 96,
    ) -> Session:
        path = tmp_path / name
        with av.open(str(path), "w") as out:
            stream = out.add_stream("libx264", rate=25, options={"bf": str(b_frames), "preset": "veryfast"})
            stream.width, stream.height, stream.pix_fmt = width, 64, pix_fmt
            stream.codec_context.gop_size = gop
            stream.time_base = stream.codec_context.time_base = Fraction(1, 1000)
            for k in range(N):
                frame = av.VideoFrame.from_ndarray(
                    np.ascontiguousarray(np.resize(burnt(k), (64, width, 3))), format="bgr24"
                )
                if width == 96:
                    frame = av.VideoFrame.from_ndarray(burnt(k), format="bgr24")
                frame.pts, frame.time_base = 40 * k + (late if k > N // 2 else 0), Fraction(1, 1000)
                out.mux(stream.encode(frame))
            out.mux(stream.encode(None))
        recorded = Stream(name="color", kind="color", file=f"media/{name}", n_frames=N)
        clock = Clock(rule="uniform", duration_ns=10**9)
        manifest = Manifest(
            name="s", created="2024-01-01T00:00:00", n_frames=N, clock=clock, streams=(recorded,)
        )
        folder = tmp_path / f"s{len(list(tmp_path.iterdir()))}"
        return create_session(folder, Draft(manifest=manifest, files={"color": path}))

    return make


def finished(made: Proxies, session: Session, stream: str = "color") -> Proxy:
    for _ in range(400):
        proxy = made.get(session, stream)
        if proxy.state != "making":
            return proxy
        time.sleep(0.02)
    raise AssertionError("it was not made")


def numbers(path: Path) -> list[int]:
    with av.open(str(path), "r") as container:
        return [
            read_number(frame.to_ndarray(format="bgr24").astype(np.uint8))
            for frame in container.decode(video=0)
        ]


def test_a_recording_that_browsers_seek_well_is_played_itself(video: Video, cache: Path) -> None:
    session, made = video(), Proxies(cache)
    proxy = finished(made, session)
    assert proxy.path == session.stream_path("color")
    assert proxy.rate_hz == pytest.approx(25)
    assert not cache.exists()
    made.close()


@pytest.mark.parametrize(
    "odd", [{"gop": 40}, {"b_frames": 2}, {"late": 200}, {"name": "color.mkv"}, {"pix_fmt": "yuv444p"}]
)
def test_any_other_gets_a_proxy_with_the_same_images(
    video: Video, cache: Path, odd: dict[str, object]
) -> None:
    session, made = video(**odd), Proxies(cache)
    proxy = finished(made, session)
    assert proxy.state == "ready", proxy.why
    assert proxy.path is not None
    assert proxy.path.parent == cache
    assert proxy.rate_hz == encode.RATE_HZ
    assert numbers(proxy.path) == list(range(N))
    made.close()


def test_key_frames_are_so_near_that_seeking_is_quick(video: Video, cache: Path) -> None:
    made = Proxies(cache)
    path = finished(made, video(gop=40)).path
    with av.open(str(path), "r") as container:
        keys = [entry.is_keyframe for entry in container.streams.video[0].index_entries]
    assert [k for k, is_key in enumerate(keys) if is_key] == list(range(0, N, encode.GOP))
    made.close()


def test_copies_of_a_session_share_a_proxy_across_servers(video: Video, cache: Path, tmp_path: Path) -> None:
    session = video(gop=40)
    copy = open_session(shutil.copytree(session.path, tmp_path / "copy"))
    first, second = Proxies(cache), Proxies(cache)
    path = finished(first, session).path
    assert path is not None
    made_ns = path.stat().st_ctime_ns
    assert finished(second, copy).path == path
    assert len(list(cache.iterdir())) == 1
    assert path.stat().st_size
    assert made_ns <= path.stat().st_ctime_ns
    for made in (first, second):
        made.close()


def test_a_proxy_that_was_removed_is_made_again(video: Video, cache: Path) -> None:
    session, made = video(gop=40), Proxies(cache)
    path = finished(made, session).path
    assert path is not None
    path.unlink()
    assert finished(made, session).path == path
    assert path.is_file()
    made.close()


def test_a_recording_that_is_damaged_half_way_is_black_from_there_on(video: Video, cache: Path) -> None:
    session, made = video(gop=40, name="color.mkv"), Proxies(cache)
    recorded = session.stream_path("color")
    recorded.write_bytes(recorded.read_bytes()[: recorded.stat().st_size * 2 // 3])
    proxy = finished(made, session)
    assert proxy.path is not None, proxy.why
    shown = numbers(proxy.path)
    assert len(shown) == N
    readable = shown.index(0, 1)
    assert 0 < readable < N
    assert shown == [*range(readable), *[0] * (N - readable)]
    made.close()


def test_a_recording_without_a_readable_image_says_why(video: Video, cache: Path) -> None:
    session, made = video(gop=40), Proxies(cache)
    session.stream_path("color").write_bytes(b"no video at all")
    proxy = finished(made, session)
    assert proxy.state == "failed"
    assert "color" in proxy.why
    assert proxies.describe(proxy, "/x")["url"] is None
    made.close()


def test_a_cache_that_cannot_be_written_says_so(video: Video, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    made = Proxies(tmp_path / "file" / "cache")
    proxy = finished(made, video(gop=40))
    assert proxy.state == "failed"
    assert "file" in proxy.why
    made.close()


def test_ending_ends_the_work_and_leaves_nothing_half_made(
    video: Video, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = Proxies(cache)
    monkeypatch.setattr(encode, "_fitted", lambda *_: time.sleep(0.05))
    made.get(video(gop=40), "color")
    made.close()
    assert not cache.exists() or list(cache.iterdir()) == []


def test_what_has_no_images_has_no_proxy(cache: Path) -> None:
    with pytest.raises(NotFoundError):
        Proxies(cache).get(_skeleton(cache.parent), "skeleton")


def _skeleton(folder: Path) -> Session:
    stream = Stream(name="skeleton", kind="skeleton")
    manifest = Manifest(name="s", created="2024-01-01T00:00:00", streams=(stream,))
    return create_session(folder / "skeleton", Draft(manifest=manifest))


def test_the_oldest_go_first_but_none_that_is_in_use(tmp_path: Path) -> None:
    for i in range(5):
        path = tmp_path / f"{i}.mp4"
        path.write_bytes(bytes(100))
        os.utime(path, (1000 + i, 1000 + i))
    half_made = tmp_path / ".x.partial"
    half_made.write_bytes(b"")
    os.utime(half_made, (0, 0))
    (tmp_path / ".now.partial").write_bytes(b"")
    make_room(tmp_path, 250, keep={tmp_path / "0.mp4"})
    assert sorted(path.name for path in tmp_path.iterdir()) == [".now.partial", "0.mp4", "4.mp4"]


def test_the_cache_is_where_the_environment_says(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ECAT_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path / "proxies"
    monkeypatch.delenv("ECAT_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "ecat" / "proxies"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "ecat" / "proxies"


@pytest.mark.parametrize(
    ("size", "expected"),
    [((960, 540), (960, 540)), ((641, 481), (640, 480)), ((3840, 2160), (1920, 1080)), ((1, 1), (2, 2))],
)
def test_a_proxy_is_even_and_no_wider_than_a_screen(size: tuple[int, int], expected: tuple[int, int]) -> None:
    width, height = encode.proxy_size(*size)
    assert (width % 2, height % 2) == (0, 0)
    assert (width, height) == pytest.approx(expected, abs=2)
