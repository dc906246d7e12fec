"""Messages of Foxglove's schemas: how each thing of a session is said in them.

Source: https://docs.foxglove.dev/docs/visualization/message-schemas and the package ``foxglove-sdk``, which has the
schemas.  Times are nanoseconds; poses are metres and quaternions x, y, z, w.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ecat.formats.robotics.scene import Rgb, Thing
from ecat.formats.robotics.tracks import JOINTS, TRACKED
from ecat.geometry.cameras import Camera
from ecat.geometry.transforms import Floats, Rigid, known
from ecat.model.skeleton import BONES

if TYPE_CHECKING:
    from foxglove.messages import (
        CameraCalibration,
        Color,
        CompressedVideo,
        CubePrimitive,
        Event,
        FrameTransform,
        KeyValuePair,
        Point3,
        Pose,
        Quaternion,
        RawImage,
        SceneEntity,
        SceneUpdate,
        SpherePrimitive,
        Timestamp,
        Vector3,
    )

Item: TypeAlias = tuple[int, str, Any]
"""Time in ns, topic, message."""
TABLE = "table"
_JOINT_M, _BONE_M, _LABEL_M = 0.03, 0.012, 0.04
_UNSURE: Rgb = (134, 142, 150)
_TABLE: Rgb = (88, 96, 108)
_BONES = [(JOINTS.index(a), JOINTS.index(b)) for a, b in BONES]


def timestamp(t_ns: int) -> Timestamp:
    """A moment."""
    from foxglove.messages import Timestamp

    return Timestamp(t_ns // 1_000_000_000, t_ns % 1_000_000_000)


def event(start_ns: int, end_ns: int, facts: Mapping[str, str]) -> Event:
    """A stretch of time ``[start, end)``.  The schema counts the end in: it is the last nanosecond before ours."""
    from foxglove.messages import Event

    last = max(end_ns - 1, start_ns)
    return Event(start_time=timestamp(start_ns), end_time=timestamp(last), metadata=_pairs(facts))


def _pairs(facts: Mapping[str, str]) -> list[KeyValuePair]:
    from foxglove.messages import KeyValuePair

    return [KeyValuePair(key=key, value=value) for key, value in facts.items() if value]


def raw_image(t_ns: int, frame_id: str, image: NDArray[np.uint16]) -> RawImage:
    """Depth or infrared (height, width), as its numbers are."""
    from foxglove.messages import RawImage

    height, width = image.shape
    data = np.ascontiguousarray(image, "<u2").tobytes()
    return RawImage(
        timestamp=timestamp(t_ns),
        frame_id=frame_id,
        width=width,
        height=height,
        encoding="16UC1",
        step=2 * width,
        data=data,
    )


def video(t_ns: int, frame_id: str, data: bytes, codec: str) -> CompressedVideo:
    """The packets of one image."""
    from foxglove.messages import CompressedVideo

    return CompressedVideo(timestamp=timestamp(t_ns), frame_id=frame_id, data=data, format=codec)


def calibration(t_ns: int, camera: Camera) -> CameraCalibration:
    """A camera; of one whose images are left for right, fx is negative."""
    from foxglove.messages import CameraCalibration

    fx = -camera.fx if camera.mirrored else camera.fx
    bent = any(camera.distortion)
    k = [fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]
    return CameraCalibration(
        timestamp=timestamp(t_ns),
        frame_id=f"camera/{camera.name}",
        width=camera.width,
        height=camera.height,
        distortion_model="rational_polynomial" if bent else "",
        D=list(camera.distortion[:8]) if bent else [],
        K=k,
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        P=[*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0],
    )


def transform(t_ns: int, parent: str, child: str, place: Rigid) -> FrameTransform:
    """Where the frame ``child`` is in ``parent``."""
    from foxglove.messages import FrameTransform

    return FrameTransform(
        timestamp=timestamp(t_ns),
        parent_frame_id=parent,
        child_frame_id=child,
        translation=_vector(place.translation),
        rotation=_quaternion(place.quaternion),
    )


def blocks(
    t_ns: int, shown: Iterable[tuple[Thing, Floats, Floats, bool]], gone: Iterable[Thing]
) -> SceneUpdate:
    """Blocks as cubes in ``table``: each with centre (3,), quaternion (4,) and whether it was observed."""
    from foxglove.messages import SceneEntityDeletion, SceneEntityDeletionType, SceneUpdate

    now = timestamp(t_ns)
    return SceneUpdate(
        deletions=[
            SceneEntityDeletion(timestamp=now, type=SceneEntityDeletionType.MatchingId, id=thing.name)
            for thing in gone
        ],
        entities=[_block(now, block) for block in shown],
    )


def _block(now: Timestamp, block: tuple[Thing, Floats, Floats, bool]) -> SceneEntity:
    from foxglove.messages import CubePrimitive, Pose, SceneEntity, TextPrimitive, Vector3

    thing, centre, quaternion, observed = block
    size = thing.size_m
    color = _color(thing.color, 1.0 if observed else 0.4)
    cubes: list[CubePrimitive] = []
    if size is not None:
        pose = Pose(position=_vector(centre), orientation=_quaternion(quaternion))
        cubes.append(CubePrimitive(pose=pose, size=Vector3(x=size[0], y=size[1], z=size[2]), color=color))
    above = centre + np.array([0.0, 0.0, max(size or (0.0,)) / 2 + _LABEL_M])
    label = TextPrimitive(
        pose=_at(above), billboard=True, font_size=_LABEL_M, color=_color(thing.color), text=thing.name
    )
    return SceneEntity(
        timestamp=now,
        frame_id=TABLE,
        id=thing.name,
        metadata=_pairs({"object": thing.id, "source": "observed" if observed else "interpolated"}),
        cubes=cubes,
        texts=[label],
    )


def table(t_ns: int, ring: Floats) -> SceneUpdate:
    """The table: a surface with the edge ``ring`` (n, 3) in ``table``."""
    from foxglove.messages import LinePrimitive, LinePrimitiveLineType, SceneEntity, SceneUpdate
    from foxglove.messages import TriangleListPrimitive as Triangles

    points = _points(ring)
    fan = [i for k in range(1, len(ring) - 1) for i in (0, k, k + 1)]
    edge = LinePrimitive(
        type=LinePrimitiveLineType.LineLoop, thickness=0.004, points=points, color=_color(_TABLE)
    )
    surface = Triangles(points=points, color=_color(_TABLE, 0.5), indices=fan)
    entity = SceneEntity(
        timestamp=timestamp(t_ns), frame_id=TABLE, id=TABLE, lines=[edge], triangles=[surface]
    )
    return SceneUpdate(entities=[entity])


def skeletons(
    t_ns: int, bodies: Iterable[tuple[str, Rgb, Floats, NDArray[np.int8]]], gone: Iterable[str]
) -> SceneUpdate:
    """Bodies in ``camera/depth``: each its name, colour, joints (25, 3) and their states (25,)."""
    from foxglove.messages import SceneEntityDeletion, SceneEntityDeletionType, SceneUpdate

    now = timestamp(t_ns)
    return SceneUpdate(
        deletions=[
            SceneEntityDeletion(timestamp=now, type=SceneEntityDeletionType.MatchingId, id=name)
            for name in gone
        ],
        entities=[_skeleton(now, *body) for body in bodies],
    )


def _skeleton(now: Timestamp, name: str, color: Rgb, joints: Floats, state: NDArray[np.int8]) -> SceneEntity:
    from foxglove.messages import (
        LinePrimitive,
        LinePrimitiveLineType,
        SceneEntity,
        SpherePrimitive,
        Vector3,
    )

    there = known(joints)
    ends = np.array([joints[[a, b]] for a, b in _BONES if there[a] and there[b]])
    bones = LinePrimitive(
        type=LinePrimitiveLineType.LineList,
        thickness=_BONE_M,
        points=_points(ends.reshape(-1, 3)),
        color=_color(color),
    )
    sure, unsure, size = _color(color), _color(_UNSURE), Vector3(x=_JOINT_M, y=_JOINT_M, z=_JOINT_M)
    spheres: list[SpherePrimitive] = [
        SpherePrimitive(pose=_at(joints[j]), size=size, color=sure if state[j] == TRACKED else unsure)
        for j in np.flatnonzero(there)
    ]
    return SceneEntity(timestamp=now, frame_id="camera/depth", id=name, lines=[bones], spheres=spheres)


def _vector(values: Floats) -> Vector3:
    from foxglove.messages import Vector3

    x, y, z = values.tolist()
    return Vector3(x=x, y=y, z=z)


def _quaternion(values: Floats) -> Quaternion:
    from foxglove.messages import Quaternion

    x, y, z, w = values.tolist()
    return Quaternion(x=x, y=y, z=z, w=w)


def _at(place: Floats) -> Pose:
    from foxglove.messages import Pose, Quaternion

    return Pose(position=_vector(place), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0))


def _points(places: Floats) -> list[Point3]:
    from foxglove.messages import Point3

    rows: Sequence[Any] = places.tolist()
    return [Point3(x=x, y=y, z=z) for x, y, z in rows]


def _color(rgb: Rgb, opacity: float = 1.0) -> Color:
    from foxglove.messages import Color

    return Color(r=rgb[0] / 255, g=rgb[1] / 255, b=rgb[2] / 255, a=opacity)
