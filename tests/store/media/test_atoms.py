"""MP4 and MOV files that claim more than they can hold are refused before a player makes room for it."""

from __future__ import annotations

import struct
import subprocess
import sys
import zlib
from contextlib import suppress
from pathlib import Path

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import EcatError, LimitError
from ecat.store.media.atoms import refuse_hollow

MANY = 30_000_000


def box(kind: str, *content: bytes) -> bytes:
    body = b"".join(content)
    return struct.pack(">I4s", 8 + len(body), kind.encode()) + body


def full(kind: str, *numbers: int, version: int = 0, flags: int = 0) -> bytes:
    """A box with a version, flags, and numbers of 32 bits."""
    return box(kind, struct.pack(f">{1 + len(numbers)}I", version << 24 | flags, *numbers))


def track(*tables: bytes) -> bytes:
    """A video track of motion JPEG with these tables of samples."""
    entry = (
        bytes(7) + b"\1" + bytes(16) + struct.pack(">HHIIIH", 64, 64, 72 << 16, 72 << 16, 0, 1) + bytes(32)
    )
    entries = box("stsd", struct.pack(">II", 0, 1), box("mjpg", entry, struct.pack(">Hh", 24, -1)))
    header = full("tkhd", 0, 0, 1, 0, 1000, *[0] * 13, 64 << 16, 64 << 16, flags=3)
    handler = box("hdlr", bytes(8), b"vide", bytes(13))
    media = box("minf", full("vmhd", 0, 0, flags=1), box("stbl", entries, *tables))
    return box("trak", header, box("mdia", full("mdhd", 0, 0, 1000, 1000, 0), handler, media))


def movie(*content: bytes) -> bytes:
    return box("moov", full("mvhd", 0, 0, 1000, 1000, *[0] * 20), *content)


FIRST = box("ftyp", b"qt  ", bytes(4), b"qt  ")
DATA = box("mdat", bytes(64))
SAME_SIZE = track(
    full("stts", 1, MANY, 10), full("stsc", 1, 1, MANY, 1), full("stsz", 1, MANY), full("stco", 1, 40)
)
HOLLOW_MOVIE = movie(SAME_SIZE)
EMPTY = track(full("stts", 0), full("stsc", 0), full("stsz", 0, 0), full("stco", 0))


def fragment(*runs: bytes) -> bytes:
    extends = box("mvex", full("trex", 1, 1, 10, 1, 0))
    parts = box("traf", full("tfhd", 1, flags=0x020000), *runs)
    return FIRST + movie(EMPTY, extends) + box("moof", full("mfhd", 1), parts) + DATA


def still(table: bytes) -> bytes:
    handler = box("hdlr", bytes(8), b"pict", bytes(13))
    return box("ftyp", b"heic", bytes(4), b"mif1heic") + box("meta", bytes(4), handler, table) + DATA


PACKED = zlib.compress(HOLLOW_MOVIE)
BOMB = zlib.compress(bytes(100_000_000), 9)
HOLLOW = {
    "samples of one size": FIRST + HOLLOW_MOVIE + DATA,
    "the same before anything else": HOLLOW_MOVIE + DATA,
    "the same after what nobody knows": box("abcd", bytes(16)) + FIRST + HOLLOW_MOVIE + DATA,
    "the same in another box": FIRST + box("udta", HOLLOW_MOVIE) + DATA,
    "the same in a box that says it is longer": FIRST + struct.pack(">I", 1 << 30) + HOLLOW_MOVIE[4:],
    "the same in a box without an end": FIRST + bytes(4) + HOLLOW_MOVIE[4:],
    "the same in a box with a long size": FIRST
    + b"\0\0\0\1moov"
    + struct.pack(">Q", 1 << 40)
    + HOLLOW_MOVIE[8:],
    "the same called free": FIRST + HOLLOW_MOVIE.replace(b"moov", b"free") + DATA,
    "the same called free, and large": FIRST
    + box("free", HOLLOW_MOVIE[8:], box("free", bytes(300_000)))
    + DATA,
    "the same compressed": FIRST
    + box(
        "moov", box("cmov", box("dcom", b"zlib"), box("cmvd", struct.pack(">I", len(HOLLOW_MOVIE)), PACKED))
    )
    + DATA,
    "a compressed movie of 100 MB": FIRST
    + box("moov", box("cmov", box("dcom", b"zlib"), box("cmvd", struct.pack(">I", 100_000_000), BOMB)))
    + DATA,
    "among the descriptions of samples": FIRST + movie(EMPTY, box("stsd", full("stsz", 1, MANY))) + DATA,
    "tracks that claim little each": FIRST + movie(*[track(full("stsz", 1, 1000)) for _ in range(8)]) + DATA,
    "a run of samples": fragment(full("trun", MANY)),
    "a run of samples that says of the first what it is": fragment(full("trun", MANY, 0, flags=4)),
    "many runs that read on to the end": fragment(*[full("trun", 300, flags=0x100)] * 40),
    "items of a still image": still(full("iinf", MANY, version=1)),
    "places of the items": still(box("iloc", b"\2\0\0\0\x44\x40", struct.pack(">I", MANY))),
    "keys": FIRST
    + movie(box("meta", bytes(4), box("hdlr", bytes(8), b"mdta", bytes(13)), full("keys", MANY)))
    + DATA,
}


@pytest.mark.parametrize("data", HOLLOW.values(), ids=HOLLOW)
def test_more_entries_than_bytes_are_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "a.mov"
    path.write_bytes(data)
    with pytest.raises(LimitError, match="cannot import it") as caught:
        refuse_hollow(path, "cannot import it")
    assert caught.value.where == f"a.mov: it has {len(data):,} bytes, and claims more samples than that"


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="asks Linux what a process used")
def test_it_is_the_claim_that_costs_the_memory(tmp_path: Path) -> None:
    """The reason for all this: when a later FFmpeg is more careful, this test says so."""
    path = tmp_path / "a.mov"
    path.write_bytes(HOLLOW["samples of one size"])
    # ru_maxrss would do, were it not inherited from the process that started this one
    script = (
        "import av, re, sys\n"
        "peak = lambda: int(re.search('VmHWM:\\\\s*(\\\\d+)', open('/proc/self/status').read())[1])\n"
        "before = peak()\n"
        "av.open(sys.argv[1]).close()\n"
        "print(peak() - before)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=True
    )
    assert int(done.stdout) > 500_000, "kilobytes, for a file of one"


def clip(path: Path, options: dict[str, str]) -> Path:
    """Half a second of video and sound."""
    with av.open(str(path), "w", options=options) as file:
        video = file.add_stream("libx264", rate=30)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        sound = file.add_stream("pcm_s16le" if path.suffix == ".mov" else "aac", rate=8000)
        sound.layout = "mono"
        for i in range(15):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), i, np.uint8), format="rgb24")
            file.mux(video.encode(frame))
        wave = av.AudioFrame.from_ndarray(np.zeros((1, 4000), np.int16), format="s16", layout="mono")
        wave.sample_rate = 8000
        file.mux(sound.encode(wave))
        for stream in (video, sound):
            file.mux(stream.encode(None))
    return path


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("a.mp4", {}),
        ("a.mov", {}),
        ("fast.mp4", {"movflags": "faststart"}),
        ("fragments.mp4", {"movflags": "frag_keyframe+empty_moov"}),
        ("pieces.mp4", {"movflags": "frag_every_frame+empty_moov+default_base_moof"}),
        ("a.mkv", {}),
        ("a.ts", {}),
    ],
)
def test_what_was_recorded_is_not_refused(tmp_path: Path, name: str, options: dict[str, str]) -> None:
    refuse_hollow(clip(tmp_path / name, options), "cannot import it")


def test_a_table_that_the_file_has_is_not_refused(tmp_path: Path) -> None:
    n = 100_000
    sizes = full("stsz", 0, n, *[1] * n)
    (tmp_path / "a.mov").write_bytes(FIRST + movie(track(sizes)) + DATA)
    refuse_hollow(tmp_path / "a.mov", "cannot import it")


def test_a_recording_reserves_as_much_as_it_likes(tmp_path: Path) -> None:
    with (tmp_path / "a.mov").open("wb") as file:
        file.write(FIRST + struct.pack(">I4s", 1 << 31, b"free"))
        file.seek(1 << 31, 1)
        file.write(b"\0")
    refuse_hollow(tmp_path / "a.mov", "cannot import it")


@pytest.mark.parametrize(
    "data", [b"", b"\0", b"RIFF" + bytes(99), bytes(1000), b"\0\0\0\7moov", b"\xff" * 99]
)
def test_what_is_no_mp4_is_somebody_elses_business(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "a").write_bytes(data)
    refuse_hollow(tmp_path / "a", "cannot import it")


@given(st.data())
def test_any_bytes_are_read_or_refused(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    source = bytearray(data.draw(st.sampled_from(list(HOLLOW.values())[:3] + list(HOLLOW.values())[-4:])))
    for _ in range(data.draw(st.integers(0, 6))):
        at = data.draw(st.integers(0, len(source) - 1))
        new = data.draw(st.binary(max_size=8))
        source[at : at + data.draw(st.integers(0, 8))] = new
        if not source:
            break
    path = tmp_path_factory.getbasetemp() / "any.mov"
    path.write_bytes(bytes(source))
    with suppress(EcatError):
        refuse_hollow(path, "cannot import it")
