"""Images come out as they went in, each by its own number, and a damaged file says how far it could be read."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import CorruptError, NotFoundError, UsageError
from ecat.formats.ecat2018.depth_file import write_depth_file
from ecat.geometry.cameras import KINECT_V2_COLOR
from ecat.geometry.nearest import nearest_in_time
from ecat.geometry.records import camera_record
from ecat.model import Stream
from ecat.stages.images import Images
from ecat.store import Session
from ecat.store.media import open_images
from ecat.store.media.container import Packets
from ecat.store.media.sources import runs
from ecat.store.together import GivenUp, run_together
from tests.store.media.clips import (
    COLOR,
    DEPTH,
    PERIOD_NS,
    color_clip,
    color_image,
    depth_clip,
    depth_image,
    number_of,
    session_of,
)

N = 40
FILES = Path("/dev/fd")


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """Forty images of colour, and of depth 10 ms later."""
    times = {
        "color": [i * PERIOD_NS for i in range(N)],
        "depth": [i * PERIOD_NS + 10_000_000 for i in range(N)],
    }
    media = {"color": color_clip, "depth": depth_clip}
    return session_of(tmp_path_factory.mktemp("pixels") / "s", [COLOR, DEPTH], media, times)


def with_bframes(path: Path, n: int = N) -> Path:
    """H.264 with B-frames and open groups, as cameras and editors write it: decoded in another order than shown."""
    import av

    with av.open(str(path), "w") as out:
        options = {"x264-params": "keyint=8:min-keyint=8:scenecut=0:bframes=3:b-pyramid=normal:open-gop=1"}
        stream = out.add_stream("libx264", rate=30, options=options)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        for i in range(n):
            frame = av.VideoFrame.from_ndarray(color_image(i), format="bgr24")
            frame.pts, frame.time_base = 40 * i + i % 3, Fraction(1, 1000)
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    return path


def test_a_session_s_images_are_what_stages_ask_for(session: Session) -> None:
    images: Images = open_images(session, "color")
    assert len(images) == N
    assert [number_of(image) for image in images] == list(range(N))


def test_color_is_blue_green_red_and_grey_is_the_luma(session: Session) -> None:
    image = next(iter(open_images(session, "color")))
    assert image.shape == (48, 64, 3)
    assert np.abs(image[2, 5].astype(int) - (200, 30, 60)).max() < 8
    grey = next(iter(open_images(session, "color", gray=True)))
    assert grey.shape == (48, 64)
    assert grey.dtype == np.uint8
    assert not grey.flags.owndata, "the luma is looked at, not copied"
    assert abs(int(grey[24, 2]) - (16 + 30 * 219 / 255)) < 4


def test_depth_is_the_same_to_the_last_bit(session: Session) -> None:
    with open_images(session, "depth") as images:
        assert images.unit_m == 0.00025
        found = list(images)
    np.testing.assert_array_equal(found, [depth_image(i) for i in range(N)])


@given(st.sets(st.integers(0, N - 1)))
@pytest.mark.parametrize("name", ["color", "depth"])
def test_any_images_can_be_asked_for(session: Session, name: str, wanted: set[int]) -> None:
    images = list(open_images(session, name).read(sorted(wanted)))
    if name == "color":
        assert [number_of(image) for image in images] == sorted(wanted)
    else:
        assert all((a == depth_image(i)).all() for a, i in zip(images, sorted(wanted), strict=True))


def test_images_are_found_where_decoding_order_is_another(tmp_path: Path) -> None:
    session = session_of(tmp_path / "s", [COLOR], {"color": with_bframes})
    images = open_images(session, "color")
    assert [number_of(image) for image in images] == list(range(N))
    for wanted in ([3], [7, 8, 9], [0, 15, 16, 39], list(range(1, N, 5)), [38, 39]):
        assert [number_of(image) for image in images.read(wanted)] == wanted


def test_far_jumps_lead_to_the_image_asked_for(tmp_path: Path) -> None:
    session = session_of(tmp_path / "s", [DEPTH], {"depth": lambda path: depth_clip(path, 400)}, n_frames=400)
    images = open_images(session, "depth")
    for wanted in ([399], [0, 200, 399], [100, 101, 300]):
        for image, i in zip(images.read(wanted), wanted, strict=True):
            np.testing.assert_array_equal(image, depth_image(i))


@pytest.mark.parametrize("codec", ["color", "depth"])
def test_images_can_be_asked_for_again_and_again_in_any_direction(tmp_path: Path, codec: str) -> None:
    n = 200
    stream, clip = (COLOR, color_clip) if codec == "color" else (DEPTH, depth_clip)
    session = session_of(tmp_path / "s", [stream], {codec: lambda path: clip(path, n)}, n_frames=n)
    fresh = {i: image.copy() for i, image in enumerate(open_images(session, codec))}
    with open_images(session, codec, threads=2) as images:
        for wanted in ([150], [151], [3], [199], [0, 120, 130], [130]):
            for image, i in zip(images.read(wanted), wanted, strict=True):
                np.testing.assert_array_equal(image, fresh[i])
        given_up, other = images.read([10, 20, 30]), images.read([10, 150])
        np.testing.assert_array_equal(next(given_up), fresh[10])
        np.testing.assert_array_equal(next(other), fresh[10])
        del given_up
        np.testing.assert_array_equal(next(other), fresh[150])
        np.testing.assert_array_equal(next(images.read([20])), fresh[20])


@pytest.mark.skipif(not FILES.is_dir(), reason="this system does not list the files that a process has open")
@pytest.mark.parametrize("stream", ["color", "depth"])
def test_what_is_given_up_half_way_keeps_no_file_open(session: Session, stream: str) -> None:
    with open_images(session, stream) as images:
        next(images.read([0]))
        before = len(list(FILES.iterdir()))
        for first in (30, 3, 20, 8):
            next(images.read([first, N - 1]))
        assert len(list(FILES.iterdir())) <= before


@pytest.mark.parametrize("wanted", [[3, 2], [5, 5], [-1], [N]])
def test_indices_ascend_and_stay_inside(session: Session, wanted: list[int]) -> None:
    with pytest.raises(UsageError, match="cannot read images"):
        open_images(session, "color").read(wanted)


def test_every_iteration_starts_anew_and_two_do_not_disturb_each_other(session: Session) -> None:
    images = open_images(session, "color")
    first, second = iter(images), iter(images)
    assert [number_of(next(first)) for _ in range(5)] == [0, 1, 2, 3, 4]
    assert number_of(next(second)) == 0
    assert number_of(next(first)) == 5
    images.close()
    assert next(first, None) is None


def test_times_are_the_recorded_ones_and_frames_the_nearest_of_the_video(session: Session) -> None:
    color, depth = open_images(session, "color"), open_images(session, "depth")
    assert color.t_ns is not None
    assert depth.t_ns is not None
    assert (depth.t_ns - color.t_ns == 10_000_000).all()
    np.testing.assert_array_equal(color.frame, np.arange(N))
    np.testing.assert_array_equal(depth.frame, np.arange(N))


def test_without_a_clock_images_are_spread_over_the_video(tmp_path: Path) -> None:
    media = {"color": color_clip, "depth": lambda path: depth_clip(path, 20)}
    session = session_of(tmp_path / "s", [COLOR, DEPTH], media)
    depth = open_images(session, "depth")
    assert depth.t_ns is None
    np.testing.assert_array_equal(depth.frame, np.arange(0, 40, 2))


@given(st.lists(st.integers(0, 1000), min_size=1, unique=True), st.lists(st.integers(-50, 1100)))
def test_nearest_is_nearest(times: list[int], asked: list[int]) -> None:
    known = np.sort(np.array(times, np.int64))
    found = nearest_in_time(known, np.array(asked, np.int64))
    distance = np.abs(known[None, :] - np.array(asked, np.int64).reshape(-1, 1))
    assert (np.abs(known[found] - asked) == distance.min(axis=1, initial=10**9)).all()


def test_the_camera_comes_with_the_images(session: Session, tmp_path: Path) -> None:
    assert open_images(session, "color").camera is None
    made = session_of(tmp_path / "s", [replace(COLOR, camera="color")], {"color": color_clip})
    with made.write() as commit:
        commit.update(cameras=(camera_record(KINECT_V2_COLOR),))
    camera = open_images(made, "color").camera
    assert camera is not None
    assert camera.fx == KINECT_V2_COLOR.fx


def test_kinect_depth_files_are_images_too(tmp_path: Path) -> None:
    stream = Stream(name="depth", kind="depth", file="media/depth_1.dep")

    def write(path: Path) -> None:
        path.unlink()  # that writer wants to make the file itself
        write_depth_file(path, [(33 * i, depth_image(i)) for i in range(5)])

    images = open_images(session_of(tmp_path / "s", [stream], {"depth": write}, n_frames=5), "depth")
    assert len(images) == 5
    assert images.unit_m == 0.001
    for i, image in enumerate(images):
        np.testing.assert_array_equal(image, depth_image(i))
    np.testing.assert_array_equal(next(images.read([3])), depth_image(3))


# --- damage


def damaged(tmp_path: Path, keep: float) -> Session:
    times = {"depth": [i * PERIOD_NS for i in range(N)]}
    session = session_of(tmp_path / "s", [DEPTH], {"depth": depth_clip}, times)
    file = session.stream_path("depth")
    data = file.read_bytes()
    file.write_bytes(data[: int(len(data) * keep)])
    return session


def test_a_truncated_file_gives_what_it_holds_then_says_how_much_that_was(tmp_path: Path) -> None:
    images = open_images(damaged(tmp_path, 0.5), "depth")
    seen = 0
    with pytest.raises(CorruptError, match="cannot read stream depth any further") as caught:  # noqa: PT012
        for image in images:
            np.testing.assert_array_equal(image, depth_image(seen))
            seen += 1
    assert 10 < seen < 30
    assert f"{seen} of {N} images were readable" in caught.value.where
    assert "depth.mkv" in caught.value.where


def test_damaged_bytes_are_noticed(tmp_path: Path) -> None:
    session = damaged(tmp_path, 1.0)
    file = session.stream_path("depth")
    data = bytearray(file.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 40] = bytes(40)
    file.write_bytes(data)
    seen = 0
    with pytest.raises(CorruptError, match="any further"):  # noqa: PT012
        for image in open_images(session, "depth"):
            np.testing.assert_array_equal(image, depth_image(seen))
            seen += 1
    assert 10 < seen < 30


@pytest.mark.parametrize("content", [b"", b"no video", b"\x1a\x45\xdf\xa3" + bytes(100)])
def test_what_is_no_video_is_corrupt(tmp_path: Path, content: bytes) -> None:
    session = session_of(tmp_path / "s", [DEPTH], {"depth": lambda path: path.write_bytes(content)})
    with pytest.raises(CorruptError, match="cannot read stream depth"):
        open_images(session, "depth")


def test_a_playlist_is_not_followed(tmp_path: Path) -> None:
    secret = color_clip(tmp_path / "secret.mp4", 3)
    text = f"ffconcat version 1.0\nfile '{secret}'\n"
    session = session_of(tmp_path / "s", [COLOR], {"color": lambda path: path.write_text(text)})
    with pytest.raises(CorruptError, match="cannot read stream color"):
        open_images(session, "color")


def test_a_file_that_is_gone_is_not_found(session: Session, tmp_path: Path) -> None:
    made = session_of(tmp_path / "s", [COLOR], {"color": color_clip})
    made.stream_path("color").unlink()
    with pytest.raises(NotFoundError, match="cannot read stream color"):
        open_images(made, "color")
    with pytest.raises(NotFoundError, match="cannot find stream infrared"):
        open_images(session, "infrared")


def test_sound_has_no_images(tmp_path: Path) -> None:
    session = session_of(tmp_path / "s", [replace(COLOR, name="audio", kind="audio")], {"audio": color_clip})
    with pytest.raises(UsageError, match="cannot read stream audio"):
        open_images(session, "audio")


def test_never_more_than_a_few_images_are_held(tmp_path: Path) -> None:
    session = session_of(tmp_path / "s", [DEPTH], {"depth": lambda path: depth_clip(path, 300)}, n_frames=300)
    tracemalloc.start()
    count = sum(1 for _ in open_images(session, "depth"))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert count == 300
    assert peak < 100 * depth_image(0).nbytes


# --- which packets


@given(st.data())
def test_runs_start_where_decoding_can_and_hold_every_image_wanted(data: st.DataObject) -> None:
    n = data.draw(st.integers(1, 60))
    keys = data.draw(st.lists(st.booleans(), min_size=n, max_size=n))
    keys[0] = True
    # decoding order: within a group the images after the key frame may come in any order
    order: list[int] = []
    start = 0
    for end in [*[i for i in range(1, n) if keys[i]], n]:
        order += [start, *data.draw(st.permutations(range(start + 1, end)))]
        start = end
    packets = Packets(np.array(order) * 10, np.array(keys), np.ones(n, bool), Fraction(1, 1000))
    wanted = sorted(data.draw(st.sets(st.integers(0, n - 1))))
    given_out: list[int] = []
    before = -1
    for first, last, times in runs(packets, wanted):
        assert before < first <= last < n
        assert keys[first]
        inside = packets.pts[first : last + 1]
        assert times <= set(inside.tolist())
        given_out += [int(t) // 10 for t in np.sort(inside) if int(t) in times]
        before = last
    assert given_out == wanted


def test_reading_ends_once_work_beside_it_has_failed(session: Session) -> None:
    first, ended = Event(), Event()

    def endless() -> None:
        try:
            while True:
                for _ in open_images(session, "depth"):
                    first.set()
        except GivenUp:
            ended.set()
            raise

    def failing() -> None:
        assert first.wait(30.0)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run_together([endless, failing])
    assert ended.is_set()
