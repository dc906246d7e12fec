"""Small ROS bags whose contents are known."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

START_NS = 1_600_000_000_000_000_000
PERIOD_NS = 33_333_333
_TF = """
================================================================================
"""


class Messages:
    """Makes messages of one version of ROS."""

    def __init__(self, *, ros2: bool) -> None:
        self.ros2 = ros2
        self.store = get_typestore(Stores.ROS2_HUMBLE if ros2 else Stores.ROS1_NOETIC)
        if "tf2_msgs/msg/TFMessage" not in self.store.fielddefs:
            from rosbags.typesys import get_types_from_msg

            text = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))

    def make(self, kind: str, **fields: Any) -> Any:
        return self.store.types[kind](**fields)

    def header(self, t_ns: int, frame_id: str = "") -> Any:
        stamp = self.make("builtin_interfaces/msg/Time", sec=t_ns // 10**9, nanosec=t_ns % 10**9)
        seq = {} if self.ros2 else {"seq": 0}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id, **seq)

    def image(
        self, t_ns: int, pixels: NDArray[Any], encoding: str, frame_id: str = "", padding: int = 0
    ) -> Any:
        height, width = pixels.shape[:2]
        rows = np.ascontiguousarray(pixels).reshape(height, -1).view(np.uint8)
        rows = np.hstack([rows, np.full((height, padding), 77, np.uint8)])
        return self.make(
            "sensor_msgs/msg/Image",
            header=self.header(t_ns, frame_id),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=0,
            step=rows.shape[1],
            data=rows.ravel(),
        )

    def compressed(self, t_ns: int, data: bytes, form: str) -> Any:
        header = self.header(t_ns)
        kind = "sensor_msgs/msg/CompressedImage"
        return self.make(kind, header=header, format=form, data=np.frombuffer(data, np.uint8))

    def camera_info(
        self, size: tuple[int, int], fx: float, lens: Iterable[float] = (), model: str = "plumb_bob"
    ) -> Any:
        matrix = np.array([fx, 0, size[0] / 2, 0, fx, size[1] / 2, 0, 0, 1], np.float64)
        names = "dkrp" if self.ros2 else "DKRP"
        zeros = np.zeros(12)
        values = (np.array(list(lens), np.float64), matrix, np.eye(3).ravel(), zeros)
        roi = self.make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        return self.make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(START_NS),
            width=size[0],
            height=size[1],
            distortion_model=model,
            binning_x=0,
            binning_y=0,
            roi=roi,
            **dict(zip(names, values, strict=True)),
        )

    def vector(self, x: float, y: float, z: float) -> Any:
        return self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def transform(
        self, xyz: tuple[float, float, float], q: tuple[float, float, float, float] = (0, 0, 0, 1)
    ) -> Any:
        rotation = self.make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", map(float, q), strict=True)))
        return self.make("geometry_msgs/msg/Transform", translation=self.vector(*xyz), rotation=rotation)

    def tf(self, parent: str, child: str, transform: Any) -> Any:
        kind = "geometry_msgs/msg/TransformStamped"
        one = self.make(kind, header=self.header(START_NS, parent), child_frame_id=child, transform=transform)
        return self.make("tf2_msgs/msg/TFMessage", transforms=[one])

    def imu(self, t_ns: int, accel: tuple[float, float, float], gyro: tuple[float, float, float]) -> Any:
        zeros = np.zeros(9)
        return self.make(
            "sensor_msgs/msg/Imu",
            header=self.header(t_ns),
            orientation=self.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=zeros,
            angular_velocity=self.vector(*gyro),
            angular_velocity_covariance=zeros,
            linear_acceleration=self.vector(*accel),
            linear_acceleration_covariance=zeros,
        )


def write_bag(path: Path, messages: Messages, content: Iterable[tuple[str, int, Any]]) -> Path:
    """A bag of (topic, recorder's time, message)."""
    plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
    writer: Any = Writer2(path, version=9, storage_plugin=plugin) if messages.ros2 else Writer1(path)
    serialize: Callable[[Any, str], Any] = (
        messages.store.serialize_cdr if messages.ros2 else messages.store.serialize_ros1
    )
    with writer:
        connections: dict[str, Any] = {}
        for topic, t_ns, message in content:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=messages.store)
            writer.write(connections[topic], t_ns, serialize(message, kind))
    return path
