"""Recordings as an Azure Kinect writes them, made byte by byte, with a truth that is known."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

START_OFFSET_NS = 336_277_000
PERIOD_US = 33_333


def element(code: str, payload: bytes) -> bytes:
    """One EBML element (RFC 8794): its id, its length in 8 bytes, its content."""
    return bytes.fromhex(code) + struct.pack(">Q", len(payload) | 1 << 56) + payload


def number(code: str, value: int) -> bytes:
    """An element with an unsigned number."""
    return element(code, value.to_bytes(8, "big"))


def text(code: str, value: str) -> bytes:
    """An element with a text."""
    return element(code, value.encode())


def video_track(index: int, name: str, fourcc: bytes, width: int, height: int) -> bytes:
    """A track as Windows' bitmap header describes it (V_MS/VFW/FOURCC)."""
    bits = {b"b16g": 16, b"NV12": 12, b"YUY2": 16}.get(fourcc, 24 if fourcc == b"MJPG" else 32)
    header = struct.pack(
        "<IiiHH4sIiiII", 40, width, height, 1, bits, fourcc, width * height * bits // 8, 0, 0, 0, 0
    )
    size = number("B0", width) + number("BA", height)
    return element(
        "AE",
        number("D7", index) + number("73C5", 1000 + index) + number("83", 1) + text("536E", name)
        + text("86", "V_MS/VFW/FOURCC") + element("63A2", header) + number("23E383", PERIOD_US * 1000)
        + element("E0", size),
    )  # fmt: skip


def imu_track(index: int) -> bytes:
    """The track of inertial samples, which pretend to be subtitles."""
    kind = number("83", 0x11) + text("536E", "IMU") + text("86", "S_K4A/IMU")
    return element("AE", number("D7", index) + number("73C5", 1000 + index) + kind)


def tag(name: str, value: str, track: int | None = None) -> bytes:
    """A tag of the whole file, or of a track."""
    target = element("63C0", number("63C5", 1000 + track) if track is not None else b"")
    return element("7373", target + element("67C8", text("45A3", name) + text("4487", value)))


def block(track: int, t_us: int, payload: bytes) -> bytes:
    """A cluster with a single block."""
    simple = element("A3", bytes([0x80 | track]) + struct.pack(">h", 0) + b"\x80" + payload)
    return element("1F43B675", number("E7", t_us) + simple)


@dataclass(frozen=True)
class Recording:
    """What to record.  Depth and infrared are uint16, colour is as ``fourcc`` packs it."""

    color: Sequence[bytes] = ()
    depth: Sequence[NDArray[np.uint16]] = ()
    fourcc: bytes = b"MJPG"
    color_px: tuple[int, int] = (1280, 720)
    depth_px: tuple[int, int] = (640, 576)
    infrared: bool = True
    imu: bool = True
    calibration: bytes | None = None
    tags: bool = True
    times_us: Sequence[int] = ()


def blocks(r: Recording) -> Iterator[bytes]:
    """The clusters, in the order of time."""
    for i in range(max(len(r.color), len(r.depth))):
        t_us = r.times_us[i] if r.times_us else 10_000 + i * PERIOD_US
        if r.imu:
            yield block(4, t_us, imu_sample(t_us * 1000 + START_OFFSET_NS, i))
        if i < len(r.color):
            yield block(1, t_us, r.color[i])
        if i < len(r.depth):
            yield block(2, t_us, r.depth[i].astype(">u2").tobytes())
            if r.infrared:
                yield block(3, t_us, (r.depth[i] // 2).astype(">u2").tobytes())


def imu_sample(device_ns: int, i: int) -> bytes:
    """Gravity along -z, turning about x."""
    return struct.pack("<Q3fQ3f", device_ns, 0.0, float(i), -9.8125, device_ns + 500, 0.25, 0.0, 0.0)


def head(r: Recording) -> tuple[bytes, bytes]:
    """What comes before the first cluster."""
    ebml = element("1A45DFA3", text("4282", "matroska") + number("4287", 4) + number("4285", 2))
    info = number("2AD7B1", 1000) + text("4D80", "made for tests") + text("5741", "made for tests")
    tracks = video_track(1, "COLOR", r.fourcc, *r.color_px) if r.color else b""
    tracks += video_track(2, "DEPTH", b"b16g", *r.depth_px) if len(r.depth) else b""
    tracks += video_track(3, "IR", b"b16g", *r.depth_px) if len(r.depth) and r.infrared else b""
    tracks += imu_track(4) if r.imu else b""
    parts = element("1549A966", info) + element("1654AE6B", tracks)
    if r.calibration is not None:
        file = text("466E", "calibration.json") + text("4660", "application/octet-stream")
        parts += element(
            "1941A469", element("61A7", file + element("465C", r.calibration) + number("46AE", 7))
        )
    if r.tags:
        tags = tag("K4A_START_OFFSET_NS", str(START_OFFSET_NS)) + tag("K4A_DEPTH_DELAY_NS", "0")
        tags += tag("K4A_DEVICE_SERIAL_NUMBER", "1") + tag("K4A_WIRED_SYNC_MODE", "STANDALONE")
        tags += tag("K4A_COLOR_MODE", "MJPG_720P", 1) + tag("K4A_DEPTH_MODE", "NFOV_UNBINNED", 2)
        tags += tag("K4A_IR_MODE", "ACTIVE", 3) + tag("K4A_IMU_MODE", "ON", 4)
        parts += element("1254C367", tags)
    return ebml + bytes.fromhex("18538067"), parts


def write(path: Path, r: Recording, clusters: Iterable[bytes] | None = None) -> Path:
    """Write the recording; the length of the segment is filled in at the end."""
    before, parts = head(r)
    with path.open("wb") as file:
        file.write(before)
        at = file.tell()
        file.write(struct.pack(">Q", 1 << 56) + parts)
        for cluster in blocks(r) if clusters is None else clusters:
            file.write(cluster)
        size = file.tell() - at - 8
        file.seek(at)
        file.write(struct.pack(">Q", size | 1 << 56))
    return path


def jpeg(i: int, size: tuple[int, int] = (1280, 720)) -> bytes:
    """A colour image whose number shows in its upper left corner (blue) and whose colour changes slowly."""
    width, height = size
    image = np.zeros((height, width, 3), np.uint8)
    image[:] = (40 + i * 2 % 200, 120, 200 - i * 2 % 160)
    cv2.circle(image, (width // 4 + 5 * i % width // 2, height // 2), height // 8, (20, 230, 30), -1)
    return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1])


def depth(i: int, size: tuple[int, int] = (640, 576)) -> NDArray[np.uint16]:
    """A noisy slanted plane with holes, in millimetres."""
    width, height = size
    chance = np.random.default_rng(i)
    rows = np.arange(height)[:, None]
    image = (1200 + rows + i + chance.normal(0, 3, (height, width))).astype(np.uint16)
    image[chance.random((height, width)) < 0.02] = 0
    return image


def recording(n: int, **changes: Any) -> Recording:
    """``n`` images of colour, depth and infrared with everything else that belongs to a recording."""
    usual: dict[str, Any] = {
        "color": [jpeg(i) for i in range(n)],
        "depth": [depth(i) for i in range(n)],
        "calibration": json.dumps(calibration()).encode(),
    }
    return Recording(**(usual | changes))


def calibration(sensor: tuple[int, int] = (4096, 3072)) -> dict[str, Any]:
    """A calibration that is simple to check: principal points in the middle, focal lengths of half the width."""
    radial = [0.5, -2.5, 1.5, 0.25, -2.25, 1.25]

    def camera(where: str, fy: float, size: tuple[int, int], x: float) -> dict[str, Any]:
        return {
            "Location": f"CALIBRATION_CameraLocation{where}",
            "Intrinsics": {
                "ModelType": "CALIBRATION_LensDistortionModelBrownConrady",
                "ModelParameters": [0.5, 0.5, 0.5, fy, *radial, 0, 0, 0.002, 0.001],
            },
            "Rt": {"Rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "Translation": [x, 0, 0]},
            "SensorWidth": size[0],
            "SensorHeight": size[1],
        }

    width, height = sensor
    color = camera("PV0", 0.5 * width / height, sensor, -0.032)
    return {"CalibrationInformation": {"Cameras": [camera("D0", 0.5, (1024, 1024), 0), color]}}
