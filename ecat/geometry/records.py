"""Cameras to and from a session's manifest (:class:`ecat.model.Camera`)."""

from __future__ import annotations

import numpy as np

from ecat import model
from ecat.geometry.cameras import Camera
from ecat.geometry.transforms import Rigid


def camera_record(camera: Camera, source: str = "") -> model.Camera:
    """The manifest's record of a camera."""
    back = camera.from_reference.inverse()
    x, y, z, w = (float(value) for value in back.quaternion)
    tx, ty, tz = (float(value) for value in back.translation)
    return model.Camera(
        name=camera.name,
        width_px=camera.width,
        height_px=camera.height,
        fx_px=camera.fx,
        fy_px=camera.fy,
        cx_px=camera.cx,
        cy_px=camera.cy,
        mirrored=camera.mirrored,
        distortion=camera.distortion if any(camera.distortion) else (),
        reference=camera.reference.removeprefix("camera/"),
        rotation=(x, y, z, w),
        translation_m=(tx, ty, tz),
        source=source,
    )


def camera_of(record: model.Camera) -> Camera:
    """The camera that a record describes."""
    place = Rigid.from_quaternion(np.array(record.rotation), np.array(record.translation_m))
    return Camera(
        record.name,
        record.width_px,
        record.height_px,
        fx=record.fx_px,
        fy=record.fy_px,
        cx=record.cx_px,
        cy=record.cy_px,
        distortion=tuple(record.distortion) + (0.0,) * (8 - len(record.distortion)),
        mirrored=record.mirrored,
        reference=f"camera/{record.reference or record.name}",
        from_reference=place.inverse(),
    )


def depth_from_camera(manifest: model.Manifest, camera: model.Camera) -> Rigid:
    """From a camera's frame to ``camera/depth``, over all cameras that its place is given by."""
    pose = Rigid.identity()
    passed: set[str] = set()
    while camera.name not in passed:
        passed.add(camera.name)
        pose = Rigid.from_quaternion(np.array(camera.rotation), np.array(camera.translation_m)) @ pose
        reference = manifest.camera(camera.reference)
        if reference is None:
            break
        camera = reference
    return pose
