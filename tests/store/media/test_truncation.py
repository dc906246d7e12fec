"""A file that was cut off is known by the lengths that its parts declare."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.store.media.truncation import bytes_missing
from tests.store.media.clips import color_clip, depth_clip


def missing(data: bytes) -> int:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "file"
        path.write_bytes(data)
        return bytes_missing(path)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Small files of each container."""
    import av

    folder = tmp_path_factory.mktemp("whole")
    files = {
        "mkv": depth_clip(folder / "a.mkv", 3).read_bytes(),
        "mp4": color_clip(folder / "a.mp4", 3).read_bytes(),
    }
    with av.open(str(folder / "a.avi"), "w") as out:
        stream = out.add_stream("mjpeg", rate=10)
        stream.width, stream.height, stream.pix_fmt = 32, 32, "yuvj420p"
        for _ in range(3):
            out.mux(stream.encode(av.VideoFrame(32, 32, "yuvj420p")))
        out.mux(stream.encode(None))
    return files | {"avi": (folder / "a.avi").read_bytes()}


@pytest.mark.parametrize("kind", ["mkv", "mp4", "avi"])
def test_a_whole_file_misses_nothing(whole: dict[str, bytes], kind: str) -> None:
    assert missing(whole[kind]) == 0


@pytest.mark.parametrize("kind", ["mkv", "avi"])
@settings(max_examples=30)
@given(share=st.floats(0.3, 0.999))
def test_what_was_cut_off_is_missing(whole: dict[str, bytes], kind: str, share: float) -> None:
    data = whole[kind]
    kept = data[: int(len(data) * share)]
    assert missing(kept) == len(data) - len(kept)


def test_a_cut_box_of_an_mp4_is_noticed(whole: dict[str, bytes]) -> None:
    assert missing(whole["mp4"][:-5]) == 5


@given(st.binary(max_size=64) | st.binary(max_size=32).map(lambda rest: b"\x1a\x45\xdf\xa3" + rest))
def test_any_bytes_give_a_number(data: bytes) -> None:
    assert missing(data) >= 0


@given(st.binary(max_size=40))
def test_boxes_that_lead_nowhere_end(data: bytes) -> None:
    assert missing(b"\x00\x00\x00\x08ftyp" + data) >= 0
    assert missing(b"RIFF" + data) >= 0
