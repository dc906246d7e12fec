"""Cameras of recordings without calibration: from a JSON file beside the images, or as published for a data set."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ecat.errors import EcatError
from ecat.model import Camera
from ecat.model.session import camera_problems
from ecat.store import files

CALIBRATION_FILES = ("intrinsics.json", "camera.json", "camera_intrinsic.json")
KINECT_V1_PX = (640, 480)
TUM_UNIT_M = 1 / 5000
_MAX_BYTES = 1 << 20
_MAX_SIDE_PX = 1 << 16
_ASPECT_TOLERANCE = 0.01


@dataclass(frozen=True)
class Calibration:
    """Cameras called color and depth, as far as known, metres per unit of depth, and what to tell about both."""

    cameras: tuple[Camera, ...] = ()
    depth_unit_m: float | None = None
    notes: tuple[str, ...] = ()

    def camera(self, name: str) -> str:
        """``name`` if there is such a camera, else nothing, as a stream's record wants it."""
        return name if any(camera.name == name for camera in self.cameras) else ""


_K = tuple[float, float, float, float]
"""Focal lengths and principal point fx, fy, cx, cy in pixels."""


def _kinect_v1(name: str, pinhole: _K, source: str) -> Camera:
    fx, fy, cx, cy = pinhole
    width, height = KINECT_V1_PX
    return Camera(
        name=name,
        width_px=width,
        height_px=height,
        fx_px=fx,
        fy_px=fy,
        cx_px=cx,
        cy_px=cy,
        source=source,
        reference="depth" if name == "color" else "",
    )


def _registered(pinhole: _K, source: str) -> tuple[Camera, ...]:
    """Depth was computed for the colour camera: both are the same."""
    return tuple(_kinect_v1(name, pinhole, source) for name in ("color", "depth"))


_TUM_NOTE = (
    "there is no calibration: the cameras are those that the TUM RGB-D benchmark recommends (525 px, depth registered "
    "to colour)"
)
TUM = Calibration(_registered((525.0, 525.0, 319.5, 239.5), "default of TUM RGB-D"), TUM_UNIT_M, (_TUM_NOTE,))
"""Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012; vision.in.tum.de/data/datasets."""

_NYU_SOURCE = "NYU Depth V2 toolbox"
_NYU_NOTE = "there is no calibration: the cameras are those published with NYU Depth V2 (Kinect v1)"
NYU = Calibration(_registered((518.86, 519.47, 325.58, 253.74), _NYU_SOURCE), None, (_NYU_NOTE,))
"""Silberman et al., Indoor segmentation and support inference from RGBD images, ECCV 2012: depth as labelled."""

NYU_RAW = Calibration(
    (
        replace(
            _kinect_v1("color", (518.86, 519.47, 325.58, 253.74), _NYU_SOURCE),
            # of the two readings of the toolbox's matrix, the one by which edges in depth and colour coincide
            rotation=(0.001839, 0.002155, -0.002522, 0.9999928),
            translation_m=(0.0250, 0.0, 0.0),
            distortion=(0.20797, -0.58614, 0.00072, 0.00105, 0.49857),
        ),
        replace(
            _kinect_v1("depth", (582.62, 582.69, 313.04, 238.44), _NYU_SOURCE),
            distortion=(-0.09990, 0.39065, 0.00193, -0.00194, -0.51078),
        ),
    ),
    None,
    (_NYU_NOTE,),
)
"""The same, depth as the sensor saw it from its own place."""


def read_calibration(
    folder: Path, color_px: tuple[int, int] | None, depth_px: tuple[int, int] | None
) -> Calibration:
    """What a file of the folder says (the first of :data:`CALIBRATION_FILES`); nothing where there is none.

    The file has ``fx fy cx cy``, or a matrix ``intrinsic_matrix`` (Open3D's, column by column) or ``K`` (row by row),
    and may have ``width height distortion mirrored``; for both cameras, or below ``color`` and ``depth`` one for each,
    the colour camera's with ``rotation`` (quaternion x, y, z, w) and ``translation_m`` into the depth camera.  Beside
    them ``depth_unit_m``, or ``depth_scale`` (units per metre).  What cannot be used becomes a note.
    """
    path = next((folder / name for name in CALIBRATION_FILES if (folder / name).is_file()), None)
    if path is None:
        return Calibration()
    try:
        document: Any = json.loads(files.read_bytes(path, _MAX_BYTES))
    except (OSError, EcatError, ValueError, RecursionError):
        return Calibration(notes=(f"{path.name} is not JSON that can be read: the cameras are unknown",))
    return parse_calibration(document, path.name, color_px, depth_px)


def parse_calibration(
    document: object, name: str, color_px: tuple[int, int] | None, depth_px: tuple[int, int] | None
) -> Calibration:
    """The same, of a document in memory."""
    if not isinstance(document, Mapping):
        return Calibration(notes=(f"{name} is no JSON object: the cameras are unknown",))
    cameras: list[Camera] = []
    notes: list[str] = []
    has_depth = depth_px is not None
    for camera, size in (("color", color_px), ("depth", depth_px)):
        if size is None:
            continue
        fields: Any = document.get(camera, document)
        try:
            made = _camera(
                camera, fields, size, name, reference="depth" if has_depth and camera == "color" else ""
            )
        except (KeyError, IndexError, TypeError, ValueError, OverflowError) as error:
            notes.append(f"{name}: the {camera} camera is unknown: {type(error).__name__} {error}")
            continue
        problems = list(camera_problems(made))
        notes += [f"{name}: the {camera} camera is unknown: {problem}" for problem in problems]
        notes += [] if problems else _shape_note(name, camera, fields, size)
        cameras += [] if problems else [made]
    if len(cameras) == 1:
        cameras = [replace(cameras[0], reference="")]
    unit = _unit(document)
    given = next((key for key in ("depth_unit_m", "depth_scale") if key in document), None)
    if has_depth and unit is None and given is not None:
        notes.append(f"{name}: {given} is not used, as it says nothing between 1e-6 and 1 m per unit")
    return Calibration(tuple(cameras), unit, tuple(notes))


def _shape_note(name: str, camera: str, fields: Any, size: tuple[int, int]) -> list[str]:
    """What to tell of a calibration for images of another shape, which scaling alone does not explain."""
    width, height = int(fields.get("width", size[0])), int(fields.get("height", size[1]))
    if abs(size[0] * height / (size[1] * width) - 1) <= _ASPECT_TOLERANCE:
        return []
    told = f"calibrated for images of {width} x {height}, and these are {size[0]} x {size[1]}"
    return [f"{name}: the {camera} camera was {told}: it is wrong if they are only a part of what it saw"]


def _unit(document: Mapping[str, Any]) -> float | None:
    try:
        unit = (
            float(document["depth_unit_m"])
            if "depth_unit_m" in document
            else 1 / float(document["depth_scale"])
        )
    except (KeyError, TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None
    return unit if 1e-6 <= unit <= 1 else None


def _camera(camera: str, fields: Any, size: tuple[int, int], source: str, *, reference: str) -> Camera:
    fx, fy, cx, cy = _pinhole(fields)
    width, height = int(fields.get("width", size[0])), int(fields.get("height", size[1]))
    if not (0 < width <= _MAX_SIDE_PX and 0 < height <= _MAX_SIDE_PX):
        raise ValueError(f"width and height: expected 1 to {_MAX_SIDE_PX} pixels")
    mirrored = fields.get("mirrored", False)
    if not isinstance(mirrored, bool):  # "false" would count as true
        raise TypeError("mirrored: expected true or false")
    # the same lens, read out at another size
    sx, sy = size[0] / width, size[1] / height
    qx, qy, qz, qw = (float(v) for v in fields.get("rotation", (0.0, 0.0, 0.0, 1.0)))
    tx, ty, tz = (float(v) for v in fields.get("translation_m", (0.0, 0.0, 0.0)))
    return Camera(
        name=camera,
        width_px=size[0],
        height_px=size[1],
        fx_px=fx * sx,
        fy_px=fy * sy,
        cx_px=(cx + 0.5) * sx - 0.5,
        cy_px=(cy + 0.5) * sy - 0.5,
        mirrored=mirrored,
        distortion=tuple(float(v) for v in fields.get("distortion", ())),
        reference=reference,
        rotation=(qx, qy, qz, qw) if reference else (0.0, 0.0, 0.0, 1.0),
        translation_m=(tx, ty, tz) if reference else (0.0, 0.0, 0.0),
        source=source,
    )


def _pinhole(fields: Mapping[str, Any]) -> tuple[float, float, float, float]:
    if "intrinsic_matrix" in fields or "K" in fields:
        by_column = "intrinsic_matrix" in fields
        values = fields["intrinsic_matrix" if by_column else "K"]
        if isinstance(values[0], Sequence):
            by_column, values = False, [v for row in values for v in row]
        cx, cy = (values[6], values[7]) if by_column else (values[2], values[5])
        return float(values[0]), float(values[4]), float(cx), float(cy)
    fx, fy, cx, cy = (float(fields[key]) for key in ("fx", "fy", "cx", "cy"))
    return fx, fy, cx, cy
