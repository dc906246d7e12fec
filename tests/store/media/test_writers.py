"""What is written is what is read: depth to the bit, times to the microsecond, colour to the eye."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from ecat.errors import FormatError, UsageError
from ecat.store.media import ColorWriter, DepthWriter, remux
from ecat.store.media.container import Packets, decoded, scan
from ecat.store.media.writers import decoding_times
from tests.store.media.clips import PERIOD_NS, color_clip, color_image, depth_clip, depth_image, number_of

SHAPES = array_shapes(min_dims=3, max_dims=3, min_side=1, max_side=9)
DEPTHS = arrays(
    np.uint16, SHAPES, elements=st.sampled_from([0, 1, 255, 256, 1500, 32767, 32768, 65534, 65535])
)


def round_trip(images: np.ndarray) -> list[np.ndarray]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "depth.mkv"
        with DepthWriter(path, images.shape[2], images.shape[1]) as writer:
            for i, image in enumerate(images):
                writer.write(image, i * PERIOD_NS)
        return [frame.to_ndarray() for frame in decoded(path, "read")]


@pytest.mark.parametrize("kind", ["depth.mkv", "color.mkv", "color.mp4"])
@pytest.mark.parametrize(("n_images", "limit"), [(1, 3000), (3, 0), (400, 0), (400, 100_000)])
def test_a_full_disk_is_what_is_said_whenever_it_is_noticed(
    kind: str, n_images: int, limit: int, tmp_path: Path
) -> None:
    """Limits of a process are for good, so that it is another one that runs into them."""
    program = f"""
import resource, signal, sys
import numpy as np
from pathlib import Path
from ecat.errors import DiskError
from ecat.store.media import ColorWriter, DepthWriter
noise = np.random.default_rng(0)
def write(path):
    if path.name.startswith("depth"):
        with DepthWriter(path, 64, 64) as writer:
            for i in range({n_images}):
                writer.write(noise.integers(0, 4000, (64, 64)).astype(np.uint16), i * 33_000_000)
    else:
        with ColorWriter(path, 64, 64) as writer:
            for i in range({n_images}):
                writer.write(noise.integers(0, 255, (64, 64, 3)).astype(np.uint8), i * 33_000_000)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, resource.RLIM_INFINITY))
try:
    write(Path(sys.argv[1]))
except DiskError as error:
    print(error.consequence)
"""
    done = subprocess.run(
        [sys.executable, "-c", program, tmp_path / kind], capture_output=True, text=True, check=False
    )
    assert (done.stdout.strip(), done.stderr) == ("it was not written", "")


@settings(max_examples=60)
@given(DEPTHS | arrays(np.uint16, SHAPES, elements=st.integers(0, 65535), fill=st.nothing()))
def test_depth_is_lossless(images: np.ndarray) -> None:
    np.testing.assert_array_equal(round_trip(images), images)


@settings(max_examples=25)
@given(st.lists(st.integers(1_000, 10**12), min_size=1, max_size=20))
@pytest.mark.parametrize("kind", ["depth.mkv", "color.mkv", "color.mp4"])
def test_times_are_kept_to_the_microsecond(kind: str, steps: list[int]) -> None:
    times = np.cumsum([0, *steps])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / kind
        if kind.startswith("depth"):
            with DepthWriter(path, 4, 4) as depth:
                for i, t in enumerate(times):
                    depth.write(np.full((4, 4), i, np.uint16), int(t) + i * 1000)
        else:
            with ColorWriter(path, 64, 48) as color:
                for i, t in enumerate(times):
                    color.write(color_image(i), int(t) + i * 1000)
        found = scan(path, "read")
    assert found.stopped == ""
    assert np.abs(found.packets[0].t_ns - (times + 1000 * np.arange(len(times)))).max() <= 500


def ffv1_size(image: np.ndarray, table: str) -> int:
    """Bytes of the image with this table for differences."""
    import av

    encoder = av.VideoCodecContext.create("ffv1", "w")
    encoder.height, encoder.width = image.shape
    encoder.pix_fmt, encoder.time_base = "gray16le", Fraction(1, 30)
    encoder.options = {"level": "3", "slicecrc": "1", "slices": "4", "qtable": table}
    frame = av.VideoFrame.from_ndarray(image, format="gray16le")
    return sum(packet.size for packet in [*encoder.encode(frame), *encoder.encode(None)])


@pytest.mark.parametrize(("noise", "smaller"), [(0.5, "greater8bit"), (20, "8bit")])
def test_depth_is_packed_by_the_table_that_suits_it(tmp_path: Path, noise: float, smaller: str) -> None:
    slope = 1500 + 2.0 * np.arange(160)
    image = (slope + np.random.default_rng(0).normal(0, noise, (120, 160))).astype(np.uint16)
    sizes = {table: ffv1_size(image, table) for table in ("8bit", "greater8bit")}
    assert min(sizes, key=lambda table: sizes[table]) == smaller
    written: list[int] = []
    with DepthWriter(tmp_path / "depth.mkv", 160, 120) as writer:
        writer.write(image, 0)
    scan(tmp_path / "depth.mkv", "read", each=lambda packet: written.append(packet.size))
    assert written == [min(sizes.values())]


def test_every_depth_image_stands_for_itself(tmp_path: Path) -> None:
    found = scan(depth_clip(tmp_path / "depth.mkv"), "read").packets[0]
    assert found.is_key.all()


def packets_of(
    path: Path, images: list[np.ndarray], *, decode: bool, threads: int
) -> list[tuple[object, ...]]:
    """What the packets of a depth video say, written from arrays or from decoded images."""
    import av

    mine = np.zeros_like(images[0])
    with DepthWriter(path, mine.shape[1], mine.shape[0], threads=threads) as writer:
        for i, image in enumerate(images):
            mine[:] = image  # whoever writes may use the same array for the next image
            frame = av.VideoFrame.from_ndarray(image, format="gray16le")
            writer.write(frame if decode else mine, i * PERIOD_NS)
    found: list[tuple[object, ...]] = []
    scan(path, "read", each=lambda p: found.append((p.pts, p.dts, p.duration, p.is_keyframe, bytes(p))))
    return found


@pytest.mark.parametrize("n_images", [1, 2, 30])
def test_depth_packed_by_several_threads_is_the_same_and_in_order(tmp_path: Path, n_images: int) -> None:
    images = [depth_image(i, 96, 128) for i in range(n_images)]
    alone = packets_of(tmp_path / "1.mkv", images, decode=False, threads=1)
    assert len(alone) == n_images
    for threads in (2, 3):
        for decode in (False, True):
            path = tmp_path / f"{threads}{decode}.mkv"
            assert packets_of(path, images, decode=decode, threads=threads) == alone
            for image, frame in zip(images, decoded(path, "read"), strict=True):
                np.testing.assert_array_equal(frame.to_ndarray(), image)


@pytest.mark.parametrize("order", ["le", "be"])
def test_decoded_depth_of_either_byte_order_is_kept_to_the_bit(order: str) -> None:
    import av

    image = np.random.default_rng(0).integers(0, 65536, (24, 34)).astype(np.uint16)
    image[0, :2] = 0, 65535
    frame = av.VideoFrame.from_ndarray(image, format=f"gray16{order}")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "depth.mkv"
        with DepthWriter(path, 34, 24) as writer:
            writer.write(frame.reformat(format="gray16le"), 0)
        (kept,) = decoded(path, "read")
    np.testing.assert_array_equal(kept.to_ndarray(), image)


def test_color_has_a_key_frame_every_15_images_and_no_others_out_of_order(tmp_path: Path) -> None:
    found = scan(color_clip(tmp_path / "color.mp4", 60), "read").packets[0]
    assert np.diff(np.flatnonzero(found.is_key)).max() <= 15
    assert (np.diff(found.pts) > 0).all()


def test_decoded_images_are_packed_like_others(tmp_path: Path) -> None:
    """Trap: every image of a JPEG video is a key frame, and the encoder would make it one again."""
    import av
    import cv2

    decoder = av.VideoCodecContext.create("mjpeg", "r")
    with ColorWriter(tmp_path / "color.mp4", 64, 48) as writer:
        for i in range(45):
            jpeg = cv2.imencode(".jpg", color_image(i % 60))[1].tobytes()
            (frame,) = decoder.decode(av.Packet(jpeg))
            writer.write(frame, i * PERIOD_NS)
    found = scan(tmp_path / "color.mp4", "read").packets[0]
    assert np.flatnonzero(found.is_key).tolist() == [0, 15, 30]


@pytest.mark.parametrize("size", [(64, 48), (65, 49), (2, 2)])
def test_color_keeps_its_colors_and_odd_sizes_lose_one_line(tmp_path: Path, size: tuple[int, int]) -> None:
    width, height = size
    image = np.zeros((height, width, 3), np.uint8)
    image[:] = (180, 90, 40)
    with ColorWriter(tmp_path / "color.mp4", width, height) as writer:
        writer.write(image, 0)
    (frame,) = decoded(tmp_path / "color.mp4", "read")
    assert (frame.width, frame.height) == (width - width % 2, height - height % 2)
    found = frame.to_ndarray(format="bgr24").astype(int)
    assert np.abs(found - (180, 90, 40)).max() < 6


@pytest.mark.parametrize(
    "image",
    [np.zeros((24, 33), np.uint16), np.zeros((24, 34), np.int32), np.zeros((24, 34, 1), np.uint16)],
)
def test_another_size_or_type_is_refused_and_what_was_written_stays(
    tmp_path: Path, image: np.ndarray
) -> None:
    with DepthWriter(tmp_path / "depth.mkv", 34, 24) as writer:
        writer.write(depth_image(0), 0)
        with pytest.raises(UsageError, match="cannot write depth"):
            writer.write(image, PERIOD_NS)
    (frame,) = decoded(tmp_path / "depth.mkv", "read")
    np.testing.assert_array_equal(frame.to_ndarray(), depth_image(0))


@pytest.mark.parametrize("times", [[5, 5], [PERIOD_NS, 0], [-1_000_000]])
def test_times_ascend_from_zero(tmp_path: Path, times: list[int]) -> None:
    with DepthWriter(tmp_path / "depth.mkv", 34, 24) as writer:
        for t_ns in times[:-1]:
            writer.write(depth_image(0), t_ns)
        with pytest.raises(UsageError, match="cannot write"):
            writer.write(depth_image(0), times[-1])


def test_a_killed_writer_leaves_a_file_that_can_be_read_with_the_right_times(tmp_path: Path) -> None:
    code = """
import os, sys
from pathlib import Path
from ecat.store.media import DepthWriter
from tests.store.media.clips import PERIOD_NS, depth_image
writer = DepthWriter(Path(sys.argv[1]), 640, 480)
for i in range(30):
    writer.write(depth_image(i, 480, 640), i * PERIOD_NS)
os._exit(1)
"""
    path = tmp_path / "depth.mkv"
    subprocess.run([sys.executable, "-c", code, str(path)], check=False, cwd=Path(__file__).parents[3])
    images = [frame.to_ndarray() for frame in decoded(path, "read")]
    assert len(images) >= 25
    for i, image in enumerate(images):
        np.testing.assert_array_equal(image, depth_image(i, 480, 640))
    assert abs(int(scan(path, "read").packets[0].t_ns[20]) - 20 * PERIOD_NS) <= 500


# --- remux


def test_packets_pass_on_undecoded_with_their_times(tmp_path: Path) -> None:
    source = color_clip(tmp_path / "color.mkv")
    assert remux(source, tmp_path / "copy.mp4") == 40
    before, after = scan(source, "read").packets[0], scan(tmp_path / "copy.mp4", "read").packets[0]
    assert np.abs(before.t_ns - after.t_ns).max() <= 100_000
    assert [number_of(f.to_ndarray(format="bgr24")) for f in decoded(tmp_path / "copy.mp4", "read")] == list(
        range(40)
    )


def test_a_truncated_source_is_passed_on_as_far_as_it_goes(tmp_path: Path) -> None:
    source = color_clip(tmp_path / "color.mkv")
    data = source.read_bytes()
    source.write_bytes(data[: len(data) * 2 // 3])
    copied = remux(source, tmp_path / "copy.mp4")
    assert 10 < copied < 40
    assert len(list(decoded(tmp_path / "copy.mp4", "read"))) == copied


def test_what_a_container_cannot_hold_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="cannot copy depth"):
        remux(depth_clip(tmp_path / "depth.mkv"), tmp_path / "depth.webm")


@given(st.lists(st.integers(-100, 100), min_size=1, unique=True))
def test_decoding_never_comes_after_showing_and_ascends(pts: list[int]) -> None:
    n = len(pts)
    times = decoding_times(Packets(np.array(pts), np.ones(n, bool), np.ones(n, bool), Fraction(1)))
    decoding = [times[t] for t in pts]
    assert decoding == sorted(decoding)
    assert all(a <= b for a, b in zip(decoding, pts, strict=True))


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="there is no ffmpeg program here")
def test_ffmpeg_reads_the_depth(tmp_path: Path) -> None:
    path = depth_clip(tmp_path / "depth.mkv", 3)
    command = ["ffmpeg", "-v", "error", "-i", str(path), "-f", "rawvideo", "-pix_fmt", "gray16le", "-"]
    done = subprocess.run(command, capture_output=True, check=True)
    assert done.stdout == b"".join(depth_image(i).astype("<u2").tobytes() for i in range(3))
