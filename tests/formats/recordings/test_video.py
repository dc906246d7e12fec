"""Plain videos: kept as they are where browsers play them, with the times that their images carry."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

from ecat.errors import FormatError, LimitError
from ecat.formats import import_source, registry
from ecat.store import open_session, validate
from ecat.store.media import open_images
from tests.formats.recordings.k4a import recording, write
from tests.store.media.clips import PERIOD_NS, color_clip, color_image, number_of

if TYPE_CHECKING:
    from av import VideoStream

N = 20


def clip(
    path: Path,
    codec: str = "libx264",
    *,
    pix_fmt: str = "yuv420p",
    rate: int = 25,
    times_ms: list[int] | None = None,
    audio: bool = False,
    options: dict[str, str] | None = None,
    size: tuple[int, int] = (64, 48),
) -> Path:
    """A video as another program would write it."""
    import av

    with av.open(str(path), "w") as out:
        stream = cast("VideoStream", out.add_stream(codec, rate=rate, options=options or {}))
        (stream.width, stream.height), stream.pix_fmt = size, pix_fmt
        unit = Fraction(1, 1000) if times_ms else Fraction(1, rate)
        stream.codec_context.time_base = unit
        sound = out.add_stream("aac", rate=48_000) if audio else None
        for i in range(N):
            image = color_image(i, size[1], size[0])
            frame = av.VideoFrame.from_ndarray(image, format="bgr24").reformat(format=pix_fmt)
            frame.pts, frame.time_base = times_ms[i] if times_ms else i, unit
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
        if sound is not None:
            for i in range(20):
                tone = av.AudioFrame.from_ndarray(
                    np.zeros((2, 1024), np.float32), format="fltp", layout="stereo"
                )
                tone.sample_rate, tone.pts, tone.time_base = 48_000, 1024 * i, Fraction(1, 48_000)
                out.mux(sound.encode(tone))
            out.mux(sound.encode(None))
    return path


def numbers(path: Path) -> list[int]:
    return [number_of(image) for image in open_images(open_session(path), "color")]


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv"])
def test_what_a_browser_plays_is_kept_to_the_last_byte(tmp_path: Path, name: str) -> None:
    source = clip(tmp_path / name)
    report = import_source(source, tmp_path / "s")
    session = open_session(report.path)
    assert report.format == "video"
    assert report.findings == ()
    assert session.stream_path("color").read_bytes() == source.read_bytes()
    assert numbers(report.path) == list(range(N))
    t_ns = open_images(session, "color").t_ns
    assert t_ns is not None
    assert np.abs(t_ns - np.arange(N) * 40_000_000).max() <= 500_000


@pytest.mark.parametrize("name", ["a.mov", "a.ts", "a.flv"])
def test_a_codec_that_browsers_play_changes_only_its_container(tmp_path: Path, name: str) -> None:
    report = import_source(clip(tmp_path / name), tmp_path / "s")
    session = open_session(report.path)
    assert session.stream("color").file == "media/color.mp4"
    assert any("undecoded" in finding for finding in report.findings)
    assert numbers(report.path) == list(range(N))


@pytest.mark.parametrize(
    ("name", "codec", "pix_fmt"),
    [
        ("a.avi", "mjpeg", "yuvj420p"),
        ("a.avi", "mpeg4", "yuv420p"),
        ("a.mkv", "libx264", "yuv444p"),
        ("a.mkv", "ffv1", "bgr0"),
        ("a.mov", "libx265", "yuv420p"),
    ],
)
def test_what_no_browser_plays_is_transcoded_and_said_so(
    tmp_path: Path, name: str, codec: str, pix_fmt: str
) -> None:
    report = import_source(clip(tmp_path / name, codec, pix_fmt=pix_fmt), tmp_path / "s")
    session = open_session(report.path)
    assert session.stream("color").codec == "h264"
    assert any("transcoded" in finding for finding in report.findings)
    assert numbers(report.path) == list(range(N))
    t_ns = open_images(session, "color").t_ns
    assert t_ns is not None
    assert np.abs(np.diff(t_ns) - 40_000_000).max() <= 1_000_000
    assert validate(session, deep=True) == []


def test_a_variable_rate_is_fine_and_a_declared_one_that_lies_is_reported(tmp_path: Path) -> None:
    times = [i * 100 + (i % 3) * 7 for i in range(N)]
    report = import_source(clip(tmp_path / "a.mkv", rate=24, times_ms=times), tmp_path / "s")
    t_ns = open_images(open_session(report.path), "color").t_ns
    np.testing.assert_array_equal(t_ns, np.array(times) * 1_000_000)
    assert any("declares 24 images a second" in f for f in report.findings)


def test_sound_is_a_stream_of_its_own(tmp_path: Path) -> None:
    kept = open_session(import_source(clip(tmp_path / "a.mp4", audio=True), tmp_path / "kept").path)
    assert [stream.kind for stream in kept.manifest.streams] == ["color", "audio"]
    assert kept.stream("audio").file == kept.stream("color").file
    moved = open_session(
        import_source(clip(tmp_path / "a.mov", "libx265", audio=True), tmp_path / "moved").path
    )
    assert moved.stream("audio").file == "media/audio.mka"
    assert moved.stream("audio").present
    assert validate(moved, deep=True) == []


def test_turned_videos_stay_as_stored_and_are_reported(tmp_path: Path) -> None:
    import av

    source = tmp_path / "a.mp4"
    with av.open(str(color_clip(tmp_path / "plain.mp4", 5))) as plain, av.open(str(source), "w") as out:
        stream = out.add_stream_from_template(plain.streams.video[0])
        for packet in plain.demux(plain.streams.video[0]):
            if packet.dts is not None:
                packet.stream = stream
                out.mux(packet)
    # the display matrix in the track header: a quarter turn
    data = bytearray(source.read_bytes())
    one = bytes.fromhex("00010000")
    upright = one + bytes(12) + one + bytes(12) + bytes.fromhex("40000000")
    at = data.index(upright, data.index(b"tkhd"))
    minus = bytes.fromhex("ffff0000")
    data[at : at + 36] = bytes(4) + one + bytes(4) + minus + bytes(16) + bytes.fromhex("40000000")
    source.write_bytes(data)
    report = import_source(source, tmp_path / "s")
    assert any("90 degrees" in finding for finding in report.findings)
    assert next(iter(open_images(open_session(report.path), "color"))).shape == (48, 64, 3)


# --- damage


def test_a_truncated_video_gives_what_it_holds(tmp_path: Path) -> None:
    source = clip(tmp_path / "a.mkv")
    data = source.read_bytes()
    source.write_bytes(data[: len(data) * 3 // 4])
    report = import_source(source, tmp_path / "s")
    assert any("not complete" in finding for finding in report.findings)
    found = numbers(report.path)
    assert 5 <= len(found) < N
    assert found == list(range(len(found)))


def test_an_mp4_that_lost_its_index_is_an_error(tmp_path: Path) -> None:
    source = clip(tmp_path / "a.mp4")
    source.write_bytes(source.read_bytes()[:-200])
    with pytest.raises(FormatError, match="cannot import"):
        import_source(source, tmp_path / "s")
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    "content", [b"", b"x" * 1000, b"#EXTM3U\n/etc/passwd\n", b"ffconcat version 1.0\nfile a\n"]
)
def test_what_is_no_video_is_a_format_error(tmp_path: Path, content: bytes) -> None:
    source = tmp_path / "a.mp4"
    source.write_bytes(content)
    with pytest.raises(FormatError, match="cannot import"):
        import_source(source, tmp_path / "s")


def test_a_hundred_megapixels_are_refused_before_anything_is_decoded(tmp_path: Path) -> None:
    source = write(
        tmp_path / "huge.mkv",
        recording(1, fourcc=b"BGRA", color=[bytes(99)], color_px=(12_000, 9_000), tags=False),
    )
    with pytest.raises(LimitError, match="cannot import") as caught:
        import_source(source, tmp_path / "s", format="video")
    assert "12000 x 9000" in caught.value.where
    with pytest.raises(LimitError, match="cannot import"):
        import_source(source, tmp_path / "s", format="azure-mkv")


@pytest.mark.parametrize("codec", ["mpeg2video", "libx264"])
def test_pictures_of_another_size_midway_are_left_out(tmp_path: Path, codec: str) -> None:
    parts = [clip(tmp_path / "a.ts", codec), clip(tmp_path / "b.ts", codec, size=(128, 96))]
    source = tmp_path / "both.ts"
    source.write_bytes(b"".join(part.read_bytes() for part in parts))
    report = import_source(source, tmp_path / "s")
    assert f"stream color: {N} images of another size than 64 x 48 were left out" in report.findings
    # the seam damages a packet before it; what builds on that is kept, and said to be in doubt
    sure = N - 4  # images are decoded in another order than they are shown in
    assert numbers(report.path)[:sure] == list(range(sure))
    assert any("1 images could not be decoded" in finding for finding in report.findings)
    assert any("images that build on missing ones may look wrong" in finding for finding in report.findings)
    assert len(numbers(report.path)) <= N - 1


@pytest.mark.parametrize(
    ("name", "magic", "program"), [("a.xef", b"EVENTS1", "Kinect Studio"), ("a.oni", b"NI10", "OpenNI2")]
)
def test_formats_of_their_makers_say_what_to_do(
    tmp_path: Path, name: str, magic: bytes, program: str
) -> None:
    for file in (tmp_path / name, tmp_path / "unnamed"):
        file.write_bytes(magic + bytes(100))
        with pytest.raises(FormatError) as caught:
            import_source(file, tmp_path / "s")
        assert program in caught.value.fix
        assert "16-bit PNG" in caught.value.fix
    assert registry.sniff(tmp_path / name).name in {"kinect-studio-xef", "openni-oni"}


def test_times_start_with_the_first_of_the_streams(tmp_path: Path) -> None:
    times = [1_000_000_000 + i * PERIOD_NS for i in range(10)]
    report = import_source(color_clip(tmp_path / "a.mkv", 10, times), tmp_path / "s")
    t_ns = open_images(open_session(report.path), "color").t_ns
    assert t_ns is not None
    assert t_ns[0] == 0
    assert np.abs(np.diff(t_ns) - PERIOD_NS).max() <= 1000
