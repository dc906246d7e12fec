"""The factory calibration of an Azure Kinect, turned into the cameras of the modes that were recorded.

The calibration is normalised: principal point and focal lengths are shares of the full sensor image's width and
height, with the origin in the outer corner of the first pixel.  A mode scales that image down and cuts it (Azure Kinect
Sensor SDK 1.4, calibration by mode).  Lens model: Brown-Conrady with six radial coefficients, as OpenCV's.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from ecat.geometry.cameras import Camera
from ecat.geometry.records import camera_record
from ecat.geometry.transforms import Rigid
from ecat.model import Camera as CameraRecord

_DEPTH_MODES = {
    (640, 576): (1024, 192, 180),  # narrow field of view
    (320, 288): (512, 96, 90),  # the same, 2x2 binned
    (1024, 1024): (1024, 0, 0),  # wide field of view, passive infrared
    (512, 512): (512, 0, 0),  # wide, 2x2 binned
}
"""Size of a depth image: side of the scaled sensor image, and what is cut off at its left and top, pixels."""
_LOCATIONS = {"CALIBRATION_CameraLocationD0": "depth", "CALIBRATION_CameraLocationPV0": "color"}
_KT = "CALIBRATION_LensDistortionModelRational6KT"
_BROWN = "CALIBRATION_LensDistortionModelBrownConrady"


def cameras_of(
    document: Any, *, color_px: tuple[int, int] | None, depth_px: tuple[int, int] | None
) -> tuple[tuple[CameraRecord, ...], list[str]]:
    """The cameras of a recording with images of these sizes (width, height), and what is odd about them.

    Points are given in ``camera/depth``.  A camera that cannot be made sense of is left out and said so.
    """
    found: dict[str, CameraRecord] = {}
    problems: list[str] = []
    sizes = {"color": color_px, "depth": depth_px}
    for entry in _entries(document):
        name = _LOCATIONS.get(str(entry.get("Location")))
        size = sizes.get(name or "")
        if name is None or size is None:
            continue
        try:
            found[name] = camera_record(_camera(name, entry, size), "factory")
        except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
            problems.append(f"the calibration of the {name} camera cannot be used: {error}")
            continue
        problems += _oddities(name, entry)
    missing = [name for name, size in sizes.items() if size is not None and name not in found]
    if missing and not problems:
        problems.append(f"the calibration has no {' and no '.join(missing)} camera")
    return tuple(found[name] for name in ("color", "depth") if name in found), problems


def _entries(document: Any) -> Iterator[dict[str, Any]]:
    information = document.get("CalibrationInformation") if isinstance(document, dict) else None
    cameras = information.get("Cameras") if isinstance(information, dict) else None
    if isinstance(cameras, list):
        yield from (entry for entry in cameras if isinstance(entry, dict))


def _camera(name: str, entry: dict[str, Any], size: tuple[int, int]) -> Camera:
    intrinsics = entry["Intrinsics"]
    if intrinsics["ModelType"] not in {_KT, _BROWN}:
        raise ValueError(f"unknown lens model {intrinsics['ModelType']}")
    values = _numbers(intrinsics["ModelParameters"], 14)
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, _, _, p2, p1 = values
    sensor = (int(entry["SensorWidth"]), int(entry["SensorHeight"]))
    width, height = size
    if name == "depth":
        if sensor != (1024, 1024) or size not in _DEPTH_MODES:
            raise ValueError(f"images of {width} x {height} of a sensor of {sensor[0]} x {sensor[1]} pixels")
        side, left, top = _DEPTH_MODES[size]
        full = (side, side)
    else:
        cy, fy = _on_four_by_three(cy, fy, sensor)
        full, left = (width, width * 3 // 4), 0
        top = (full[1] - height) // 2
        if top < 0 or (width * 9 != height * 16 and top):
            raise ValueError(
                f"images of {width} x {height} pixels are of none of the known shapes 4:3 and 16:9"
            )
    if not (fx > 0 and fy > 0):
        raise ValueError("the focal length is not positive")
    rotation = np.array(_numbers(entry["Rt"]["Rotation"], 9)).reshape(3, 3)
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) or np.linalg.det(rotation) < 0:
        raise ValueError("the rotation is not one")
    place = Rigid(rotation, np.array(_numbers(entry["Rt"]["Translation"], 3)))
    return Camera(
        name,
        width,
        height,
        fx=fx * full[0],
        fy=fy * full[1],
        cx=cx * full[0] - left - 0.5,  # to the centre of the first pixel
        cy=cy * full[1] - top - 0.5,
        distortion=(k1, k2, p1, p2, k3, k4, k5, k6),
        reference="camera/depth",
        from_reference=place if name == "color" else Rigid.identity(),
    )


def _on_four_by_three(cy: float, fy: float, sensor: tuple[int, int]) -> tuple[float, float]:
    """Shares of the 4:3 image's height; some early devices were calibrated on its 16:9 middle part."""
    width, height = sensor
    if width * 3 == height * 4:
        return cy, fy
    if width * 9 == height * 16:
        return (cy * 2304 + 384) / 3072, fy * 2304 / 3072
    raise ValueError(f"a colour sensor of {width} x {height} pixels")


def _numbers(values: Iterable[Any], n: int) -> tuple[float, ...]:
    numbers = tuple(float(value) for value in values)
    if len(numbers) != n or not all(math.isfinite(number) for number in numbers):
        raise ValueError(f"expected {n} finite numbers, found {len(numbers)}")
    return numbers


def _oddities(name: str, entry: dict[str, Any]) -> Iterator[str]:
    values = entry["Intrinsics"]["ModelParameters"]
    if entry["Intrinsics"]["ModelType"] == _KT and any(values[10:14]):
        yield f"the {name} camera's tangential distortion and its centre are those of another lens model: approximate"
