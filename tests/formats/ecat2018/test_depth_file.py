"""Raw Kinect depth, complete or from a recording that crashed."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from ecat.errors import ExistsError, FormatError, NotFoundError, UsageError
from ecat.formats.ecat2018.depth_file import DepthFile, write_depth_file

videos = st.tuples(st.integers(1, 4), st.integers(1, 5), st.integers(1, 5)).flatmap(
    lambda shape: st.tuples(arrays(np.uint16, shape), arrays(np.uint32, shape[0]))
)


def noise(n: int, height: int = 6, width: int = 8) -> NDArray[np.uint16]:
    return np.random.default_rng(0).integers(500, 4500, (n, height, width)).astype(np.uint16)


def recorded(path: Path, frames: NDArray[np.uint16], times: list[int] | None = None) -> Path:
    write_depth_file(path, zip(times or range(0, 33 * len(frames), 33), frames, strict=False))
    return path


@settings(deadline=None)  # it writes to disk
@given(video=videos)
def test_reading_a_written_file_gives_it_back(
    tmp_path_factory: pytest.TempPathFactory, video: tuple[NDArray[np.uint16], NDArray[np.uint32]]
) -> None:
    frames, times = video
    path = recorded(tmp_path_factory.mktemp("depth") / "a.dep", frames, times.tolist())
    with DepthFile(path) as depth:
        assert len(depth) == len(frames)
        assert (depth.height, depth.width) == frames.shape[1:]
        np.testing.assert_array_equal(np.stack(list(depth)), frames)
        np.testing.assert_array_equal(depth.times_ms, times)


def test_the_bytes_are_those_of_the_format(tmp_path: Path) -> None:
    frame = np.array([[1, 2, 3], [4, 5, 6]], np.uint16)
    data = recorded(tmp_path / "a.dep", frame[None], [7]).read_bytes()
    assert data == struct.pack("<2h6H2I", 3, 2, 1, 2, 3, 4, 5, 6, 7, 1)


def test_a_frame_beyond_two_gibibytes_is_found(tmp_path: Path) -> None:
    """Trap: the original's 32-bit offset fails from frame 4947 on."""
    frame_bytes, count = 2 * 512 * 424, 4948
    path = tmp_path / "long.dep"
    last = noise(1, 424, 512)[0]
    with path.open("wb") as file:
        file.write(struct.pack("<2h", 512, 424))
        file.seek(4 + (count - 1) * frame_bytes)
        file.write(last.tobytes())
        file.write(np.arange(count, dtype="<u4").tobytes() + struct.pack("<I", count))
    assert 4 + (count - 1) * frame_bytes > 2**31
    with DepthFile(path) as depth:
        assert len(depth) == count
        np.testing.assert_array_equal(depth.frame(count - 1), last)
        assert not depth.frame(0).any()
        assert depth.findings == ()


@pytest.mark.parametrize("cut", [1, 4, 11, 12, 13, 108])
def test_a_crashed_recording_keeps_its_complete_frames(tmp_path: Path, cut: int) -> None:
    """Trap: without a clean stop there is no index, and the last bytes are not a count."""
    frames = noise(2)
    path = recorded(tmp_path / "a.dep", frames)
    os.truncate(path, path.stat().st_size - cut)
    complete = 2 if cut <= 12 else 1
    with DepthFile(path) as depth:
        assert depth.times_ms is None
        assert len(depth) == complete
        np.testing.assert_array_equal(np.stack(list(depth)), frames[:complete])
        assert f"{complete} complete frames" in depth.findings[0]


@pytest.mark.parametrize(
    ("times", "told"),
    [
        ([0, 33, 66, 99], ()),
        ([0, 66, 33, 99], ("frame 2 is earlier than frame 1; 1 such times",)),
        ([0, 33, 33, 33], ("frame 2 has the time of frame 1; 2 such times",)),
    ],
)
def test_times_out_of_order_or_repeated_are_told(
    tmp_path: Path, times: list[int], told: tuple[str, ...]
) -> None:
    """Trap: frames were stored by tasks that did not wait for each other."""
    with DepthFile(recorded(tmp_path / "a.dep", noise(4), times)) as depth:
        assert depth.findings == told


def test_repeated_and_torn_frames_are_told(tmp_path: Path) -> None:
    """Trap: the tasks shared one buffer."""
    frames = noise(5)
    frames[2] = frames[1]
    frames[4, :2] = frames[3, :2]
    with DepthFile(recorded(tmp_path / "a.dep", frames)) as depth:
        assert list(depth.frame_findings()) == [
            "frame 2 repeats frame 1",
            "frame 4 is torn: 2 of its rows are those of frame 3",
        ]


def test_rows_without_any_measurement_are_not_torn(tmp_path: Path) -> None:
    frames = noise(3)
    frames[:, :3] = 0
    with DepthFile(recorded(tmp_path / "a.dep", frames)) as depth:
        assert list(depth.frame_findings()) == []


@pytest.mark.parametrize(
    "data", [b"", b"abc", struct.pack("<2h", 0, 4), struct.pack("<2h", -512, 424) + bytes(99)]
)
def test_what_is_no_depth_file_is_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "a.dep"
    path.write_bytes(data)
    with pytest.raises(FormatError, match=r"a\.dep"):
        DepthFile(path)


def test_a_huge_image_in_a_small_file_costs_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.dep"
    path.write_bytes(struct.pack("<2h", 32767, 32767) + bytes(100))
    with DepthFile(path) as depth:
        assert len(depth) == 0
        with pytest.raises(NotFoundError, match="frame 0 of 0"):
            depth.frame(0)


def test_a_missing_file_is_not_found_and_leaves_nothing_open(tmp_path: Path) -> None:
    with pytest.raises(NotFoundError):
        DepthFile(tmp_path / "a.dep")


def test_a_file_appears_only_when_it_is_complete(tmp_path: Path) -> None:
    def frames() -> Iterator[tuple[int, NDArray[np.uint16]]]:
        yield 0, noise(1)[0]
        assert [path.name for path in tmp_path.iterdir()] != ["a.dep"]
        raise RuntimeError("the camera went away")

    with pytest.raises(RuntimeError):
        write_depth_file(tmp_path / "a.dep", frames())
    assert list(tmp_path.iterdir()) == []


def test_an_existing_file_is_not_overwritten(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.dep", noise(1))
    with pytest.raises(ExistsError):
        recorded(path, noise(2))


@pytest.mark.parametrize(
    "frames",
    [
        [],
        [(0, np.zeros((2, 2), np.uint16)), (1, np.zeros((2, 3), np.uint16))],
        [(0, np.zeros((2, 2), np.float32))],
        [(-1, np.zeros((2, 2), np.uint16))],
        [(0, np.zeros(4, np.uint16))],
    ],
)
def test_frames_that_do_not_fit_the_format_are_not_written(tmp_path: Path, frames: list[object]) -> None:
    with pytest.raises(UsageError):
        write_depth_file(tmp_path / "a.dep", frames)  # pyright: ignore[reportArgumentType]
    assert list(tmp_path.iterdir()) == []
