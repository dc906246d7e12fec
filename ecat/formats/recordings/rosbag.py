"""ROS 1 and ROS 2 bags, and the RealSense SDK's recordings, which are ROS 1 bags with topics of their own.

Read with ``rosbags``, which needs no ROS.  Colour, depth and infrared images, their cameras, static transforms and
IMU readings are imported; every stream by the times in its messages' headers, which the cameras' drivers wrote.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from ecat.errors import FormatError, LimitError
from ecat.formats.format import Format, ImportOptions, ImportReport
from ecat.formats.recordings.bag import Bag
from ecat.formats.recordings.common import Track, color_track, create, depth_track
from ecat.formats.recordings.ros_messages import (
    CAMERA_INFO,
    COMPRESSED,
    IMAGE,
    IMU,
    Rounding,
    camera_of_info,
    chain,
    encoding_of,
    fits,
    image_of,
    stream_kind,
    transform_of,
)
from ecat.formats.recordings.rows import imu_rows, wall_clock
from ecat.geometry.transforms import Rigid
from ecat.model import Camera
from ecat.progress import Progress
from ecat.store import TableData
from ecat.store.media import MILLIMETRE

NAME = "rosbag"
_MAGIC = {".bag": b"#ROSBAG V2", ".mcap": b"\x89MCAP0\r\n", ".db3": b"SQLite format 3\0"}
_MAX_TOPICS, _MAX_STATIC = 32, 1000
_ONE_CLOCK_NS = 1_000_000_000
"""Streams whose headers are further from the recorder's clock than this, compared to one another, have two clocks."""
_FLOAT_ROUNDING_M = 1e-5
"""Whole millimetres in 32 bits of floating point are off by less than this."""
_MAX_NS = 1 << 62


@dataclass
class _Topic:
    """A topic that becomes a stream: what its messages are, and when each was taken."""

    name: str
    type: str
    stream: Literal["color", "depth", "infrared"] = "color"
    label: str = ""
    frame_id: str = ""
    stamp_ns: array[int] = field(default_factory=lambda: array("q"))
    bag_ns: array[int] = field(default_factory=lambda: array("q"))
    t_ns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))


def sniff(path: Path) -> bool:
    """Whether it is a bag by its name and first bytes, or the folder of a ROS 2 bag."""
    try:
        if path.is_dir():
            return (path / "metadata.yaml").is_file() and any(
                f.suffix in {".db3", ".mcap"} for f in path.iterdir()
            )
        magic = _MAGIC.get(path.suffix.lower())
        if magic is None or not path.is_file():
            return False
        with path.open("rb") as file:
            return file.read(len(magic)) == magic
    except OSError:
        return False


def read(source: Path, dest: Path, options: ImportOptions, progress: Progress) -> ImportReport:
    """Read a bag into a session; t = 0 is the first image of any stream.

    Raises
    ------
    FormatError : not a bag, or there is no image in it that can be read.
    LimitError : images of more pixels, or more topics of images, than ecat reads.
    """
    del options
    what = f"cannot import {source.name}"
    bag = Bag(source, what)
    topics = _image_topics(bag)
    if not topics:
        names = ", ".join(sorted(bag.types)[:20]) or "none"
        raise FormatError(what, where=f"{source.name}: no topic of images that can be read; topics: {names}")
    _read_times(bag, topics, progress)
    topics = [topic for topic in topics if len(topic.stamp_ns)]
    offset_ns = _choose_times(bag, topics)
    start_ns = min((int(topic.t_ns.min()) for topic in topics), default=0)
    for topic in topics:
        topic.t_ns = topic.t_ns - start_ns
    cameras = _cameras(bag, topics)
    tracks = [_track(bag, topic, {camera.name for camera in cameras}) for topic in topics]
    missing = {"color", "depth"} - {topic.stream for topic in topics}
    bag.notes += [f"there is no topic of {kind} images" for kind in sorted(missing)]
    imu = _imu(bag, offset_ns, start_ns)
    return create(
        dest,
        tracks,
        format_name=NAME,
        source=source.resolve().name,
        cameras=cameras,
        tables={"imu": imu} if imu is not None else {},
        notes=list(dict.fromkeys(bag.notes)),
        start=wall_clock(start_ns),
        foreign={f"{NAME}:topic:{topic.label}": topic.name for topic in topics},
        progress=progress,
    )


# ---------------------------------------------------------------------------------------------- images


def _image_topics(bag: Bag) -> list[_Topic]:
    """Topics that become streams; colour topics and unregistered depth come first and get the plain names."""
    names = [*bag.of_type(IMAGE), *bag.of_type(COMPRESSED)]
    if len(names) > _MAX_TOPICS:
        raise LimitError(bag.what, where=f"{len(names)} topics of images, more than {_MAX_TOPICS}")
    found: list[_Topic] = []
    for name in names:
        raw, _, transport = name.rpartition("/")
        if transport.lower() in {"compressed", "compresseddepth"} and any(t.name == raw for t in found):
            continue  # the same images, with loss
        message = bag.first(name)
        encoding = encoding_of(message, bag.types[name]) if message is not None else "?"
        kind = stream_kind(name, encoding)
        if not kind:
            bag.notes.append(
                f"topic {name} was left out: its images ({encoding}) are not colour, depth or infrared"
            )
            continue
        frame_id = str(message.header.frame_id).lstrip("/") if message is not None else ""
        found.append(_Topic(name, bag.types[name], cast("Any", kind), frame_id=frame_id))
    found.sort(
        key=lambda t: (
            t.stream,
            re.search(r"colou?r|rgb|depth/", t.name, re.IGNORECASE) is None,
            "align" in t.name,
            t.name,
        )
    )
    counts: dict[str, int] = {}
    for topic in found:
        counts[topic.stream] = counts.get(topic.stream, 0) + 1
        topic.label = topic.stream + (f"_{counts[topic.stream]}" if counts[topic.stream] > 1 else "")
    return found


def _track(bag: Bag, topic: _Topic, cameras: set[str]) -> Track:
    rounding, notes = Rounding(), list[str]()

    def images() -> Iterator[tuple[int, Any]]:
        bad, known = 0, len(bag.notes)
        for i, (_, _, message) in enumerate(bag.messages([topic.name])):
            if message is None or i >= len(topic.t_ns):
                bad += 1
                continue
            try:
                image = image_of(message, topic.type, topic.stream, bag.what, rounding)
            except FormatError:
                bad += 1
                continue
            yield int(topic.t_ns[i]), image
        notes.extend(note for note in bag.notes[known:] if note not in bag.notes[:known])
        if bad:
            notes.append(f"stream {topic.label}: {bad} images could not be read and are missing")
        if rounding.worst_m > _FLOAT_ROUNDING_M:
            most = f"{rounding.worst_m * 1000:.2g} mm"
            notes.append(
                f"stream {topic.label}: distances were rounded to whole millimetres, by {most} at most"
            )
        if rounding.too_far:
            notes.append(
                f"stream {topic.label}: {rounding.too_far} distances beyond 65 m count as not measured"
            )

    camera = topic.label if topic.label in cameras else ""
    n = len(topic.t_ns)
    if topic.stream == "color":
        track = color_track(topic.label, images, camera=camera, expected=n)
    else:
        unit_m = _depth_unit_m(bag, topic) if topic.stream == "depth" else None
        track = depth_track(topic.label, images, unit_m=unit_m, camera=camera, expected=n, kind=topic.stream)
    track.notes = notes
    return track


def _depth_unit_m(bag: Bag, topic: _Topic) -> float:
    """The RealSense option that says it; else millimetres (REP 118)."""
    sensor = topic.name.rpartition("/sensor_")[0]
    for name in sorted(bag.types):
        if (
            sensor
            and name.startswith(sensor)
            and re.search(r"option/Depth.Units/value$", name, re.IGNORECASE)
        ):
            message = bag.first(name)
            value = float(getattr(message, "data", 0.0))
            if 1e-6 <= value <= 1:
                return float(f"{value:.6g}")  # it is kept in 32 bits
    return MILLIMETRE


# ---------------------------------------------------------------------------------------------- times


def _read_times(bag: Bag, topics: Sequence[_Topic], progress: Progress) -> None:
    """The stamps in the headers, which stand in the same place of every message of these types, and the bag's times."""
    by_name = {topic.name: topic for topic in topics}
    total = sum(bag.counts[name] for name in by_name)
    for i, (name, bag_ns, data) in enumerate(bag.messages(list(by_name), raw=True)):
        by_name[name].stamp_ns.append(
            _stamp_ns(data, big_endian=bag.is_big_endian_possible and data[1:2] == b"\0")
        )
        by_name[name].bag_ns.append(min(bag_ns, _MAX_NS))
        if not i % 64:
            progress(f"reading {bag.path.name}", i, total)


def _stamp_ns(data: bytes, *, big_endian: bool) -> int:
    """ROS 1: after the sequence number; ROS 2: after the encapsulation; seconds and nanoseconds in 32 bits each."""
    order: Literal["big", "little"] = "big" if big_endian else "little"
    return int.from_bytes(data[4:8], order) * 10**9 + int.from_bytes(data[8:12], order)


def _choose_times(bag: Bag, topics: Sequence[_Topic]) -> int:
    """Give every topic its times: those of its headers, or the recorder's where the headers cannot be used.

    Returns
    -------
    The usual difference of headers and recorder's times, in ns; 0 where the recorder's are used.
    """
    good: dict[str, int] = {}
    for topic in topics:
        stamps, times = np.array(topic.stamp_ns, np.int64), np.array(topic.bag_ns, np.int64)
        backwards = int((np.diff(stamps) < 0).sum())
        if (stamps == 0).any():
            bag.notes.append(
                f"stream {topic.label}: images without a time of their own; the recorder's times count"
            )
        elif backwards:
            bag.notes.append(
                f"stream {topic.label}: the camera's clock jumps back {backwards} times; the recorder's times count"
            )
        else:
            good[topic.name] = int(np.median(stamps - times))
    offsets = list(good.values())
    if offsets and max(offsets) - min(offsets) > _ONE_CLOCK_NS:
        bag.notes.append("the streams' own times are of different clocks; the recorder's times count")
        good, offsets = {}, []
    offset = int(np.median(offsets)) if offsets else 0
    for topic in topics:
        times = np.array(topic.bag_ns, np.int64)
        topic.t_ns = np.array(topic.stamp_ns, np.int64) if topic.name in good else times + offset
    return offset


# ---------------------------------------------------------------------------------------------- cameras


def _prefix(topic: str) -> str:
    """What an image's topic and that of its camera have in common."""
    for tail in ("/compressed", "/compressedDepth"):
        topic = topic.removesuffix(tail)
    topic = topic.rpartition("/")[0]
    return topic.removesuffix("/image").removesuffix("/info")


def _cameras(bag: Bag, topics: Sequence[_Topic]) -> tuple[Camera, ...]:
    infos = {_prefix(name): name for name in bag.of_type(CAMERA_INFO)}
    cameras: dict[str, Camera] = {}
    for topic in topics:
        name = infos.get(_prefix(topic.name))
        message = bag.first(name) if name is not None else None
        if message is None or name is None:
            bag.notes.append(
                f"stream {topic.label}: there is no camera_info for {topic.name}; its camera is unknown"
            )
            continue
        camera, told = camera_of_info(message, topic.label, name)
        bag.notes += [told] if told else []
        if camera is not None:
            cameras[topic.label] = camera
    depth = next((topic for topic in topics if topic.label == "depth"), None)
    if depth is not None and "depth" in cameras:
        edges = _static_transforms(bag)
        for topic in topics:
            if topic is depth or topic.label not in cameras:
                continue
            place = _into_depth(bag, topic, depth, edges)
            if place is None:
                bag.notes.append(
                    f"stream {topic.label}: nothing says where its camera stands beside the depth camera"
                )
                continue
            x, y, z, w = (float(v) for v in place.quaternion)
            tx, ty, tz = (float(v) for v in place.translation)
            cameras[topic.label] = replace(
                cameras[topic.label], reference="depth", rotation=(x, y, z, w), translation_m=(tx, ty, tz)
            )
    return tuple(cameras.values())


def _into_depth(
    bag: Bag, topic: _Topic, depth: _Topic, edges: Sequence[tuple[str, str, Rigid]]
) -> Rigid | None:
    """The transform of points of the topic's camera into that of ``depth``."""
    both = [_realsense_extrinsics(bag, one) for one in (topic, depth)]
    if both[0] is not None and both[1] is not None and both[0].keys() & both[1].keys():
        group = min(both[0].keys() & both[1].keys())
        return both[1][group] @ both[0][group].inverse()
    if topic.frame_id and topic.frame_id == depth.frame_id:
        return Rigid.identity()
    return chain(edges, topic.frame_id, depth.frame_id)


def _realsense_extrinsics(bag: Bag, topic: _Topic) -> Mapping[str, Rigid] | None:
    """By the number of the reference, the transform of its points into the stream's camera (librealsense)."""
    head = _prefix(topic.name) + "/tf/"
    found: dict[str, Rigid] = {}
    for name in bag.types:
        if name.startswith(head) and (message := bag.first(name)) is not None:
            place = transform_of(message) if hasattr(message, "rotation") else None
            found |= {name.removeprefix(head): place} if place is not None else {}
    return found or None


def _static_transforms(bag: Bag) -> list[tuple[str, str, Rigid]]:
    """Parent, child and the transform between them, of ``/tf_static``."""
    found: list[tuple[str, str, Rigid]] = []
    for _, _, message in bag.messages([name for name in bag.types if name.rpartition("/")[2] == "tf_static"]):
        for one in getattr(message, "transforms", ()):
            place = transform_of(one.transform) if fits(one, "geometry_msgs/msg/TransformStamped") else None
            if place is not None and len(found) < _MAX_STATIC:
                found.append((one.header.frame_id.lstrip("/"), one.child_frame_id.lstrip("/"), place))
    return found


# ---------------------------------------------------------------------------------------------- imu


def _imu(bag: Bag, offset_ns: int, start_ns: int) -> TableData | None:
    """Readings of all IMU topics.  A sensor that a message does not have is told by its covariance, or by the topic."""
    topics = bag.of_type(IMU)
    t_ns, sensor, xyz = array("q"), array("b"), array("d")
    for name, bag_ns, message in bag.messages(topics) if topics else ():
        if message is None:
            continue
        noted_ns = min(bag_ns, _MAX_NS) + offset_ns
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        when = stamp if abs(stamp - noted_ns) <= _ONE_CLOCK_NS else noted_ns
        low = name.lower()
        for code, other, value, covariance in (
            (0, "gyro", message.linear_acceleration, message.linear_acceleration_covariance),
            (1, "accel", message.angular_velocity, message.angular_velocity_covariance),
        ):
            mine = ("accel", "gyro")[code]
            if (other in low and mine not in low) or (covariance.size and covariance[0] == -1):
                continue
            t_ns.append(when - start_ns)
            sensor.append(code)
            xyz.extend((value.x, value.y, value.z))
    if not t_ns:
        return None
    values = np.frombuffer(xyz, np.float64).reshape(-1, 3)
    return TableData(data=imu_rows(np.frombuffer(t_ns, np.int64), np.frombuffer(sensor, np.int8), values))


FORMAT = Format(
    name=NAME,
    description="ROS 1 and ROS 2 bags (.bag, .mcap, .db3, folders) and RealSense recordings (.bag)",
    sniff=sniff,
    read=read,
)
