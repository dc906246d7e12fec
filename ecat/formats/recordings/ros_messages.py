"""What is in ROS messages: images, cameras, transforms.  Messages are whatever has the fields of their type."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecat.errors import FormatError
from ecat.formats.recordings.image_files import Header, checked, decode, parse_header
from ecat.geometry.transforms import Rigid
from ecat.model import Camera
from ecat.model.session import DISTORTION_LENGTHS, camera_problems
from ecat.store.media import MILLIMETRE

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_ENCODINGS: dict[str, tuple[str, int]] = {
    **dict.fromkeys(("rgb8", "bgr8", "8uc3"), ("u1", 3)),
    **dict.fromkeys(("rgba8", "bgra8", "8uc4"), ("u1", 4)),
    **dict.fromkeys(("mono8", "8uc1", "y8"), ("u1", 1)),
    **dict.fromkeys(("bayer_rggb8", "bayer_bggr8", "bayer_gbrg8", "bayer_grbg8"), ("u1", 1)),
    **dict.fromkeys(("yuyv", "yuv422_yuy2", "yuv422", "uyvy"), ("u1", 2)),
    **dict.fromkeys(("mono16", "16uc1", "z16", "y16"), ("u2", 1)),
    "32fc1": ("f4", 1),
}
"""Types and numbers of the channels of a pixel (sensor_msgs/image_encodings.h, and librealsense's)."""
DEPTH_ENCODINGS = frozenset({"mono16", "16uc1", "z16", "32fc1"})
_COMPRESSED_DEPTH_HEADER = 12
_PNG = b"\x89PNG"
CAMERA_INFO, IMU = "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/Imu"
_HEADER: dict[str, type] = {"header.stamp.sec": int, "header.stamp.nanosec": int, "header.frame_id": str}
_PLACE: dict[str, type] = {
    **{f"translation.{axis}": float for axis in "xyz"},
    **{f"rotation.{axis}": float for axis in "xyzw"},
}
_SIZE: dict[str, type] = {"height": int, "width": int}
_FIELDS: dict[str, dict[str, type]] = {
    IMAGE: {**_HEADER, **_SIZE, "step": int, "encoding": str, "is_bigendian": int, "data": np.ndarray},
    COMPRESSED: {**_HEADER, "format": str, "data": np.ndarray},
    CAMERA_INFO: {**_SIZE, "distortion_model": str, "K|k": np.ndarray, "D|d": np.ndarray},
    IMU: {
        **_HEADER,
        **{f"{of}.{axis}": float for of in ("linear_acceleration", "angular_velocity") for axis in "xyz"},
        **{f"{of}_covariance": np.ndarray for of in ("linear_acceleration", "angular_velocity")},
    },
    "geometry_msgs/msg/Transform": _PLACE,
    "geometry_msgs/msg/TransformStamped": {
        "header.frame_id": str,
        "child_frame_id": str,
        **{f"transform.{name}": of for name, of in _PLACE.items()},
    },
    "std_msgs/msg/Float32": {"data": float},
    "tf2_msgs/msg/TFMessage": {"transforms": list},
    "tf/msg/tfMessage": {"transforms": list},
}
"""What is read of each type, as a bag defines its types itself and may do it in another way; `K|k`: either name."""
_LENSES = frozenset(
    {"", "none", "plumb_bob", "rational_polynomial", "brown_conrady", "modified_brown_conrady"}
)


@dataclass
class Rounding:
    """What became of distances in floating point: how far off the kept millimetres are, and what was too far."""

    worst_m: float = 0.0
    too_far: int = 0


def fits(message: Any, kind: str) -> bool:
    """Whether a message of the type ``kind`` has the fields that are read here."""
    return kind in _FIELDS and all(
        isinstance(_field(message, path), of) for path, of in _FIELDS[kind].items()
    )


def _field(message: Any, path: str) -> Any:
    for part in path.split("."):
        names = [name for name in part.split("|") if hasattr(message, name)]
        message = getattr(message, names[0]) if names else None
    return message


def encoding_of(message: Any, kind: str) -> str:
    """The encoding of an image message in small letters; for compressed ones, ``jpeg``, ``png16`` or ``?``."""
    if kind == IMAGE:
        return str(message.encoding).lower()
    data = bytes(message.data[: 1 << 18])
    if "compresseddepth" in str(message.format).lower():
        return (
            "png16"
            if data[_COMPRESSED_DEPTH_HEADER:].startswith(_PNG) and "32fc1" not in message.format.lower()
            else "?"
        )
    header = parse_header(data)
    return "?" if header is None else "png16" if header.is_deep else "jpeg"


def is_known(encoding: str) -> bool:
    """Whether images of this encoding can be read."""
    return encoding in _ENCODINGS or encoding in {"jpeg", "png16"}


def stream_kind(topic: str, encoding: str) -> str:
    """``color``, ``depth``, ``infrared``, or nothing for what is none of them."""
    if re.search(r"confidence|disparity|mask|label", topic, re.IGNORECASE) or not is_known(encoding):
        return ""
    if re.search(r"infra|(?<![a-z])ir(?![a-z])", topic, re.IGNORECASE):
        return "infrared" if encoding in {"mono8", "8uc1", "y8", "mono16", "16uc1", "y16", "png16"} else ""
    return "depth" if encoding in DEPTH_ENCODINGS or encoding == "png16" else "color"


def image_of(message: Any, kind: str, stream: str, what: str, rounding: Rounding) -> NDArray[Any]:
    """The image of a message.

    Parameters
    ----------
    kind : the type of the message. stream : ``color`` gives (height, width, 3) uint8, blue first; ``depth`` and
        ``infrared`` (height, width) uint16, distances in floating point (metres, REP 118) as millimetres.

    Raises
    ------
    FormatError : too little data, or an encoding that cannot be read.
    LimitError : too many pixels.
    """
    if kind == COMPRESSED:
        data = message.data.tobytes()
        if not data.startswith(_PNG) and data[_COMPRESSED_DEPTH_HEADER:].startswith(_PNG):
            data = data[_COMPRESSED_DEPTH_HEADER:]
        return decode(data, what, "an image", deep=stream != "color")
    encoding = str(message.encoding).lower()
    pixels = _pixels(message, encoding, what)
    if stream == "color":
        return _bgr(pixels, encoding)
    if encoding == "32fc1":
        return _millimetres(pixels, rounding)
    return pixels.astype(np.uint16)


def _pixels(message: Any, encoding: str, what: str) -> NDArray[Any]:
    """Pixels (height, width) or (height, width, channels) without the padding of rows."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    checked(Header(width, height), what, "an image")
    if encoding not in _ENCODINGS:
        raise FormatError(what, where=f"images of the encoding {encoding!r}")
    dtype, channels = _ENCODINGS[encoding]
    row = width * channels * np.dtype(dtype).itemsize
    data = np.asarray(message.data, np.uint8)
    if step < row or step * height > data.size:
        raise FormatError(
            what, where=f"{data.size} bytes are too few for {width} x {height} pixels {encoding}"
        )
    rows = np.ascontiguousarray(data[: step * height].reshape(height, step)[:, :row])
    pixels = rows.view((">" if message.is_bigendian else "<") + dtype)
    return pixels.reshape(height, width, channels) if channels > 1 else pixels


def _bgr(pixels: NDArray[Any], encoding: str) -> NDArray[np.uint8]:
    import cv2

    codes = {
        **dict.fromkeys(("yuyv", "yuv422_yuy2"), cv2.COLOR_YUV2BGR_YUY2),
        **dict.fromkeys(("uyvy", "yuv422"), cv2.COLOR_YUV2BGR_UYVY),
        "bayer_rggb8": cv2.COLOR_BayerRGGB2BGR,
        "bayer_bggr8": cv2.COLOR_BayerBGGR2BGR,
        "bayer_gbrg8": cv2.COLOR_BayerGBRG2BGR,
        "bayer_grbg8": cv2.COLOR_BayerGRBG2BGR,
    }
    if encoding in codes:
        even = pixels[: len(pixels) // 2 * 2, : pixels.shape[1] // 2 * 2]
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(even), codes[encoding]), np.uint8)
    if encoding in {"rgb8", "rgba8"}:
        return pixels[..., 2::-1]
    return np.repeat(pixels[..., None], 3, axis=2) if pixels.ndim == 2 else pixels[..., :3]


def _millimetres(depth_m: NDArray[Any], rounding: Rounding) -> NDArray[np.uint16]:
    metres = depth_m.astype(np.float64)
    metres[~np.isfinite(metres) | (metres < 0)] = 0.0
    depth_mm = np.rint(metres / MILLIMETRE)
    far = depth_mm > np.iinfo(np.uint16).max
    rounding.too_far += int(far.sum())
    depth_mm[far] = 0.0
    off = np.abs(metres - depth_mm * MILLIMETRE)[~far]
    rounding.worst_m = max(rounding.worst_m, float(off.max(initial=0.0)))
    return depth_mm.astype(np.uint16)


def camera_of_info(message: Any, name: str, source: str) -> tuple[Camera | None, str]:
    """The camera that a CameraInfo message describes, or None; and what is to be told about it."""
    matrix = np.asarray(_field(message, "K|k"), np.float64)
    lens = [float(v) for v in _field(message, "D|d")]
    if matrix.shape != (9,):
        return None, f"{source}: its matrix has {matrix.size} numbers, not 9; the camera is unknown"
    told = ""
    model = str(message.distortion_model).lower().replace(" ", "_").replace("-", "_")
    if not any(lens):
        lens = []
    elif model not in _LENSES:
        told, lens = f"{source}: its lens model {model!r} is not known here; the distortion was left out", []
    elif len(lens) not in DISTORTION_LENGTHS:
        told, lens = f"{source}: a lens of {len(lens)} coefficients; the distortion was left out", []
    camera = Camera(
        name=name,
        width_px=int(message.width),
        height_px=int(message.height),
        fx_px=float(matrix[0]),
        fy_px=float(matrix[4]),
        cx_px=float(matrix[2]),
        cy_px=float(matrix[5]),
        distortion=tuple(lens),
        source=source,
    )
    problems = list(camera_problems(camera))
    return (None, f"{source}: {problems[0]}; the camera is unknown") if problems else (camera, told)


def transform_of(message: Any) -> Rigid | None:
    """The transform in a Transform message, None if its rotation is none."""
    q, t = message.rotation, message.translation
    quaternion = np.array([q.x, q.y, q.z, q.w], np.float64)
    translation = np.array([t.x, t.y, t.z], np.float64)
    norm = float(np.linalg.norm(quaternion))
    if not (np.isfinite(translation).all() and 0.5 < norm < 2):
        return None
    return Rigid.from_quaternion(quaternion / norm, translation)


def chain(edges: Iterable[tuple[str, str, Rigid]], start: str, end: str) -> Rigid | None:
    """The transform that takes points of frame ``start`` into frame ``end``.

    ``edges`` are (parent, child, transform from child to parent).  None where they do not connect the two.
    """
    steps: dict[str, list[tuple[str, Rigid]]] = {}
    for parent, child, parent_from_child in edges:
        steps.setdefault(child, []).append((parent, parent_from_child))
        steps.setdefault(parent, []).append((child, parent_from_child.inverse()))
    reached = {start: Rigid.identity()}
    queue = [start]
    for here in queue:
        for there, step in steps.get(here, ()):
            if there not in reached:
                reached[there] = step @ reached[here]
                queue.append(there)
    return reached.get(end)
