"""ROS bags, and RealSense recordings, which are such."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from ecat.check import check
from ecat.errors import EcatError, FormatError, LimitError
from ecat.formats import import_source, registry
from ecat.formats.recordings.ros_messages import Rounding, chain, fits, image_of
from ecat.geometry.transforms import Rigid
from ecat.store import Session, open_session
from ecat.store.media import open_images
from tests.formats.recordings.bags import PERIOD_NS, START_NS, Messages, write_bag
from tests.store.media.clips import color_image, depth_image, number_of

N = 5
COLOR, DEPTH = "/camera/color/image_raw", "/camera/depth/image_rect_raw"
Content = list[tuple[str, int, Any]]


def stamp(i: int) -> int:
    return START_NS + i * PERIOD_NS


def rgbd(messages: Messages, *, lag_ns: int = 4_000_000) -> Content:
    """Colour and depth as a driver publishes them; the recorder notes them a little later."""
    content: Content = [
        ("/camera/color/camera_info", stamp(0), messages.camera_info((64, 48), 60.0, [0.1, 0, 0, 0, 0])),
        ("/camera/depth/camera_info", stamp(0), messages.camera_info((34, 24), 40.0)),
        (
            "/tf_static",
            stamp(0),
            messages.tf("depth_optical", "color_optical", messages.transform((0.015, 0, 0))),
        ),
    ]
    for i in range(N):
        color = messages.image(stamp(i), color_image(i), "bgr8", "color_optical", padding=3)
        depth = messages.image(stamp(i) + 1000, depth_image(i), "16UC1", "depth_optical")
        content += [(COLOR, stamp(i) + lag_ns, color), (DEPTH, stamp(i) + lag_ns + 1, depth)]
    return content


def imported(path: Path, messages: Messages, content: Content) -> tuple[Session, str]:
    report = import_source(write_bag(path, messages, content), path.with_name("session"))
    assert report.format == "rosbag"
    assert [f for f in check(report.path) if f.severity == "error"] == []
    return open_session(report.path), "\n".join(report.findings)


@pytest.mark.parametrize("name", ["a.bag", "ros2", "a.mcap"])
def test_colour_depth_cameras_and_transforms_of_any_version(tmp_path: Path, name: str) -> None:
    messages = Messages(ros2=name != "a.bag")
    session, told = imported(tmp_path / name, messages, rgbd(messages))
    color, depth = open_images(session, "color"), open_images(session, "depth")
    np.testing.assert_array_equal(color.t_ns, np.arange(N) * PERIOD_NS)
    np.testing.assert_array_equal(depth.t_ns, np.arange(N) * PERIOD_NS + 1000)
    assert [number_of(image) for image in color] == list(range(N))
    for i, image in enumerate(depth):
        np.testing.assert_array_equal(image, depth_image(i))
    camera = session.manifest.camera("color")
    assert camera is not None
    assert (camera.fx_px, camera.distortion, camera.reference) == (60, (0.1, 0, 0, 0, 0), "depth")
    assert camera.translation_m == pytest.approx((0.015, 0, 0))
    assert session.stream("depth").depth_unit_m == 0.001
    assert session.manifest.clock.start == "2020-09-13T12:26:40.000000+00:00"
    assert session.manifest.foreign["rosbag:topic:color"] == COLOR
    assert told == ""


def test_a_realsense_recording(tmp_path: Path) -> None:
    messages = Messages(ros2=False)
    color, depth = "/device_0/sensor_1/Color_0", "/device_0/sensor_0/Depth_0"
    quarter = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))
    # the transform stored takes points of the reference into the stream's camera
    content: Content = [
        (f"{color}/info/camera_info", 0, messages.camera_info((64, 48), 60.0)),
        (f"{depth}/info/camera_info", 0, messages.camera_info((34, 24), 40.0)),
        (f"{depth}/tf/0", 0, messages.transform((0, 0, 0))),
        (f"{color}/tf/0", 0, messages.transform((1, 0, 0), quarter)),
        (
            "/device_0/sensor_0/option/Depth_Units/value",
            0,
            messages.make("std_msgs/msg/Float32", data=0.00025),
        ),
    ]
    for i in range(N):
        content += [
            (
                f"{color}/image/data",
                i * PERIOD_NS,
                messages.image(stamp(i), color_image(i)[..., ::-1], "rgb8"),
            ),
            (f"{depth}/image/data", i * PERIOD_NS, messages.image(stamp(i), depth_image(i), "mono16")),
            (
                "/device_0/sensor_2/Accel_0/imu/data",
                i * PERIOD_NS,
                messages.imu(stamp(i), (i, 0, 9.8), (0, 0, 0)),
            ),
            (
                "/device_0/sensor_2/Gyro_0/imu/data",
                i * PERIOD_NS,
                messages.imu(stamp(i), (0, 0, 0), (0, i, 0)),
            ),
        ]
    session, told = imported(tmp_path / "d435.bag", messages, content)
    assert told == ""
    assert session.stream("depth").depth_unit_m == 0.00025
    assert [number_of(image) for image in open_images(session, "color")] == list(range(N))
    camera = session.manifest.camera("color")
    assert camera is not None
    place = Rigid.from_quaternion(np.array(camera.rotation), np.array(camera.translation_m))
    in_depth = np.array([0.3, 0.2, 1.0])
    in_color = Rigid.from_quaternion(np.array(quarter), np.array([1.0, 0, 0])).apply(in_depth)
    np.testing.assert_allclose(place.apply(in_color), in_depth, atol=1e-9)
    imu = session.table("imu").to_arrow().to_pylist()
    assert [(row["sensor"], row["x"], row["y"]) for row in imu[-2:]] == [
        ("accelerometer", N - 1, 0),
        ("gyroscope", 0, N - 1),
    ]
    assert len(imu) == 2 * N


def test_distances_in_metres_become_millimetres_and_rounding_is_told(tmp_path: Path) -> None:
    messages = Messages(ros2=True)
    exact = (depth_image(0).astype(np.float64) / 1000).astype(np.float32)
    content = [("/depth/image", stamp(i), messages.image(stamp(i), exact, "32FC1")) for i in range(2)]
    session, told = imported(tmp_path / "exact", messages, content)
    np.testing.assert_array_equal(next(iter(open_images(session, "depth"))), depth_image(0))
    assert "rounded" not in told
    odd = np.array([[1.2344, np.nan], [70.0, -1.0]], np.float32)
    rounding = Rounding()
    image = image_of(messages.image(0, odd, "32FC1"), "sensor_msgs/msg/Image", "depth", "what", rounding)
    np.testing.assert_array_equal(image, [[1234, 0], [0, 0]])
    assert rounding.worst_m == pytest.approx(0.0004, rel=1e-3)
    assert rounding.too_far == 1


@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("rgb8", color_image(5)[..., ::-1]),
        ("bgra8", np.dstack([color_image(5), np.full((48, 64), 255, np.uint8)])),
        ("yuv422_yuy2", cv2.cvtColor(color_image(5), cv2.COLOR_BGR2YUV_YUY2)),
        ("uyvy", cv2.cvtColor(color_image(5), cv2.COLOR_BGR2YUV_UYVY)),
        ("mono8", cv2.cvtColor(color_image(5), cv2.COLOR_BGR2GRAY)),
    ],
)
def test_colour_in_any_encoding(encoding: str, pixels: NDArray[np.uint8]) -> None:
    message = Messages(ros2=True).image(0, np.ascontiguousarray(pixels), encoding, padding=5)
    image = image_of(message, "sensor_msgs/msg/Image", "color", "what", Rounding())
    assert image.shape == (48, 64, 3)
    assert number_of(image) == 5


@pytest.mark.parametrize(
    ("pattern", "at"), [("rggb", (0, 0)), ("grbg", (0, 1)), ("gbrg", (1, 0)), ("bggr", (1, 1))]
)
def test_bayer_patterns_put_red_where_it_is(pattern: str, at: tuple[int, int]) -> None:
    pixels = np.zeros((48, 64), np.uint8)
    pixels[at[0] :: 2, at[1] :: 2] = 200
    message = Messages(ros2=True).image(0, pixels, f"bayer_{pattern}8")
    image = image_of(message, "sensor_msgs/msg/Image", "color", "what", Rounding())
    np.testing.assert_array_equal(image[20, 20], [0, 0, 200])


def test_compressed_images(tmp_path: Path) -> None:
    messages = Messages(ros2=False)
    content: Content = []
    for i in range(N):
        jpeg = cv2.imencode(".jpg", color_image(i))[1].tobytes()
        png = cv2.imencode(".png", depth_image(i))[1].tobytes()
        content += [
            (
                "/rgb/image/compressed",
                stamp(i),
                messages.compressed(stamp(i), jpeg, "bgr8; jpeg compressed bgr8"),
            ),
            (
                "/d/image/compressedDepth",
                stamp(i),
                messages.compressed(stamp(i), bytes(12) + png, "16UC1; compressedDepth"),
            ),
        ]
    session, told = imported(tmp_path / "a.bag", messages, content)
    assert [number_of(image) for image in open_images(session, "color")] == list(range(N))
    np.testing.assert_array_equal(list(open_images(session, "depth"))[3], depth_image(3))
    assert "no camera_info" in told


def test_the_compressed_copy_of_a_raw_topic_is_passed_over(tmp_path: Path) -> None:
    messages = Messages(ros2=False)
    jpeg = cv2.imencode(".jpg", color_image(0))[1].tobytes()
    copy = (f"{COLOR}/compressed", stamp(0), messages.compressed(stamp(0), jpeg, "jpeg"))
    session, _ = imported(tmp_path / "a.bag", messages, [*rgbd(messages), copy])
    assert [stream.name for stream in session.manifest.streams] == ["color", "depth"]


def test_infrared_stays_infrared(tmp_path: Path) -> None:
    messages = Messages(ros2=False)
    grey = np.arange(48 * 64, dtype=np.uint8).reshape(48, 64)
    content = [("/camera/infra1/image_rect_raw", stamp(0), messages.image(stamp(0), grey, "mono8"))]
    session, told = imported(tmp_path / "a.bag", messages, content)
    assert session.stream("infrared").kind == "infrared"
    np.testing.assert_array_equal(next(iter(open_images(session, "infrared"))), grey)
    assert "no topic of color images" in told


# --- clocks


def test_without_stamps_the_recorders_times_count(tmp_path: Path) -> None:
    messages = Messages(ros2=False)
    content = [(COLOR, stamp(i), messages.image(0, color_image(i), "bgr8")) for i in range(N)]
    session, told = imported(tmp_path / "a.bag", messages, content)
    np.testing.assert_array_equal(open_images(session, "color").t_ns, np.arange(N) * PERIOD_NS)
    assert "without a time of their own" in told


def test_a_clock_that_jumps_back_is_told_and_order_kept(tmp_path: Path) -> None:
    messages = Messages(ros2=False)
    content = rgbd(messages)
    back = messages.image(stamp(1), color_image(N), "bgr8", "color_optical")
    content.append((COLOR, stamp(N) + 4_000_000, back))
    session, told = imported(tmp_path / "a.bag", messages, content)
    images = open_images(session, "color")
    assert [number_of(image) for image in images] == list(range(N + 1))
    assert images.t_ns is not None
    assert (np.diff(images.t_ns) > 0).all()
    # the other stream keeps its own times, and both stay on one time line
    assert np.abs(images.t_ns - np.arange(N + 1) * PERIOD_NS).max() < 10_000
    assert "jumps back 1 times" in told


def test_streams_of_different_clocks_are_put_on_the_recorders(tmp_path: Path) -> None:
    messages = Messages(ros2=False)
    content = rgbd(messages, lag_ns=0)
    for i in range(N):
        content[4 + 2 * i] = (
            DEPTH,
            stamp(i),
            messages.image(10**9 * 50 + i, depth_image(i), "16UC1", "depth_optical"),
        )
    session, told = imported(tmp_path / "a.bag", messages, content)
    np.testing.assert_array_equal(open_images(session, "depth").t_ns, np.arange(N) * PERIOD_NS)
    assert "different clocks" in told


# --- what is missing or damaged


def test_a_bag_with_nothing_to_see_names_its_topics(tmp_path: Path) -> None:
    messages = Messages(ros2=False)
    path = write_bag(tmp_path / "a.bag", messages, [("/imu", 0, messages.imu(0, (0, 0, 0), (0, 0, 0)))])
    with pytest.raises(FormatError, match="cannot import") as caught:
        import_source(path, tmp_path / "s")
    assert "/imu" in caught.value.where
    assert not (tmp_path / "s").exists()


def test_messages_that_do_not_fit_are_left_out_and_told(tmp_path: Path) -> None:
    messages = Messages(ros2=False)
    content = rgbd(messages)
    short = messages.image(stamp(N), depth_image(0), "16UC1", "depth_optical")
    short.height = 1000
    content.append((DEPTH, stamp(N), short))
    session, told = imported(tmp_path / "a.bag", messages, content)
    assert len(open_images(session, "depth")) == N
    assert "stream depth: 1 images could not be read" in told


def test_an_unknown_lens_and_a_camera_without_focal_length_are_told(tmp_path: Path) -> None:
    messages = Messages(ros2=True)
    content = rgbd(messages)
    content[0] = (
        "/camera/color/camera_info",
        stamp(0),
        messages.camera_info((64, 48), 60.0, [0.1] * 4, "equidistant"),
    )
    content[1] = ("/camera/depth/camera_info", stamp(0), messages.camera_info((34, 24), 0.0))
    session, told = imported(tmp_path / "bag", messages, content)
    assert [camera.name for camera in session.manifest.cameras] == ["color"]
    assert session.manifest.cameras[0].distortion == ()
    assert "lens model 'equidistant'" in told
    assert "positive focal length" in told


def test_too_many_pixels_are_refused(tmp_path: Path) -> None:
    messages = Messages(ros2=False)
    huge = messages.image(stamp(0), color_image(0), "bgr8")
    huge.width, huge.height = 12_000, 9_000
    path = write_bag(tmp_path / "a.bag", messages, [(COLOR, stamp(0), huge)])
    with pytest.raises(LimitError, match="cannot import"):
        import_source(path, tmp_path / "s")
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize("keep", [13, 0.3, 0.7, 0.99])
@pytest.mark.parametrize("name", ["a.bag", "a.mcap"])
def test_a_truncated_bag_is_saved_in_part_or_one_typed_error(tmp_path: Path, name: str, keep: float) -> None:
    messages = Messages(ros2=name != "a.bag")
    path = write_bag(tmp_path / name, messages, rgbd(messages))
    if path.is_dir():
        path = next(path.glob("*.mcap"))
    data = path.read_bytes()
    path.write_bytes(data[: int(keep if keep > 1 else keep * len(data))])
    assert registry.sniff(path).name == "rosbag"
    try:
        report = import_source(path, tmp_path / "s")
    except EcatError:
        assert not (tmp_path / "s").exists()
        return
    assert report.findings


def test_a_damaged_byte_anywhere_is_no_traceback(tmp_path: Path) -> None:
    messages = Messages(ros2=False)
    data = write_bag(tmp_path / "a.bag", messages, rgbd(messages)).read_bytes()
    rng = np.random.default_rng(0)
    for i in range(12):
        damaged = bytearray(data)
        for at in rng.integers(13, len(data), 30):
            damaged[at] = rng.integers(256)
        path = tmp_path / f"{i}.bag"
        path.write_bytes(damaged)
        try:
            import_source(path, tmp_path / f"s{i}", format="rosbag")
        except EcatError:
            assert not (tmp_path / f"s{i}").exists()


@pytest.mark.parametrize("ros2", [False, True])
def test_a_type_that_a_bag_defines_in_another_way_is_not_read(ros2: bool) -> None:
    messages = Messages(ros2=ros2)
    for message in (messages.camera_info((64, 48), 60.0), messages.image(0, color_image(0), "bgr8")):
        kind = message.__msgtype__
        assert fits(message, kind)
        name = "distortion_model" if "CameraInfo" in kind else "encoding"
        others = {
            key: getattr(message, key)
            for key in message.__dataclass_fields__
            if key not in {name, "__msgtype__"}
        }
        assert not fits(SimpleNamespace(**others), kind)
        assert not fits(SimpleNamespace(**others, **{name: 3}), kind)
    assert not fits(messages.header(0), "std_msgs/msg/Header")


def test_transforms_are_followed_in_both_directions() -> None:
    shift = [Rigid(np.eye(3), np.array([x, 0.0, 0.0])) for x in (1, 2)]
    edges = [("base", "color", shift[0]), ("base", "depth", shift[1])]
    found = chain(edges, "color", "depth")
    assert found is not None
    np.testing.assert_allclose(found.apply(np.zeros(3)), [-1, 0, 0])
    assert chain(edges, "color", "elsewhere") is None


def test_an_mcap_file_that_no_robot_recorded_is_told_from_a_damaged_bag(tmp_path: Path) -> None:
    from mcap.writer import Writer

    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="test")
        schema = writer.register_schema("foxglove.Event", "protobuf", b"")
        writer.add_message(writer.register_channel("/events", "protobuf", schema), 0, b"", 0)
        writer.finish()
    with pytest.raises(FormatError) as raised:
        import_source(tmp_path / "a.mcap", tmp_path / "s")
    assert "without ROS messages" in str(raised.value.where)
    assert "reindex" not in str(raised.value.fix)
    assert not (tmp_path / "s").exists()
