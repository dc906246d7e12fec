"""The stage on which samples play: a Kinect v2, a tilted table, two marked cubes, one seated performer.

Everything is told in the ``table`` frame: origin in the middle of the working area, x to the right and y away
from the camera, z up.  The performer sits at the far side and faces the camera, so his right is at -x.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ecat.geometry.cameras import KINECT_V2_COLOR, Camera
from ecat.geometry.records import camera_record
from ecat.geometry.transforms import Floats, Rigid
from ecat.model.prototype import BoxPrototype, FaceName, MarkerFace, Quaternion, Triple, nominal_face
from ecat.model.session import Camera as ManifestCamera

EDGE_M = 0.1524
HALF_M = EDGE_M / 2
SIZE_M: Triple = (EDGE_M, EDGE_M, EDGE_M)
TABLE_OUTLINE_M: Floats = np.array(
    [[-0.64, 0.36, 0.0], [0.64, 0.36, 0.0], [0.6, -0.46, 0.0], [-0.6, -0.46, 0.0]]
)
"""Corners (4, 3) of the table top that the annotator outlines: far left, far right, near right, near left."""
WORKSPACE_M: Floats = np.array([[-0.38, -0.32], [0.38, 0.24]])
"""Least and greatest x, y of a cube's centre."""


@dataclass(frozen=True)
class Scene:
    """Where camera and table are in one session; ``scale`` is the performer's size, 1 = arms of 0.68 m."""

    color: Camera
    depth_from_table: Rigid
    scale: float
    sway_m: float

    @cached_property
    def color_from_table(self) -> Rigid:
        """The colour camera's own frame from the table frame."""
        return self.color.from_reference @ self.depth_from_table

    @cached_property
    def eye(self) -> Floats:
        """Centre (3,) of the colour camera in the table frame, metres."""
        return self.color_from_table.inverse().translation

    def pixels(self, points: Floats) -> Floats:
        """Colour pixels (..., 2) of points (..., 3) in the table frame."""
        return self.color.project(self.depth_from_table.apply(points))


def random_scene(rng: np.random.Generator) -> Scene:
    """The table about 0.73 m below a camera that looks down at 20 degrees, as in the real recordings.

    Source: ECAT 2018 file format §2.9.  The normal is (0, 0.94, -0.34) in Kinect camera space, give or take a
    third of a degree.
    """
    nx, slope, distance = rng.normal(0, 0.005), rng.normal(-0.337, 0.005), rng.normal(0.728, 0.005)
    normal = np.array([nx, -math.sqrt(1 - nx * nx - slope * slope), slope])
    depth = 1.38
    origin = np.array([0.0, -(distance + normal[2] * depth) / normal[1], depth])
    x = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
    x = x / math.sqrt(x @ x)
    rotation = np.stack([x, np.cross(normal, x), normal], -1)
    return Scene(KINECT_V2_COLOR, Rigid(rotation, origin), rng.uniform(0.97, 1.05), rng.uniform(-0.02, 0.02))


def manifest_camera(camera: Camera, reference: str) -> ManifestCamera:
    """The manifest's entry of a camera; ``reference`` names the camera whose frame points are given in."""
    return replace(camera_record(camera, "generated"), reference=reference)


def _stuck_face(
    face: FaceName, code: str, side_m: float, nudge_mm: tuple[float, float], turn_deg: float
) -> MarkerFace:
    """A marker stuck on by hand: off the face's middle by ``nudge_mm``, in its own axes, and turned."""
    nominal = nominal_face(face, code.replace("/", ""), side_m, SIZE_M)
    axis = Rigid.from_quaternion(np.array(nominal.quaternion), np.array(nominal.centre))
    half = math.radians(turn_deg) / 2
    spin = Rigid.from_quaternion(
        np.array([0.0, 0.0, math.sin(half), math.cos(half)]), np.array([*nudge_mm, 0.0]) / 1000
    )
    stuck = axis @ spin
    centre: Triple = tuple(float(value) for value in stuck.translation)  # pyright: ignore[reportAssignmentType]
    turned: Quaternion = tuple(float(value) for value in stuck.quaternion)  # pyright: ignore[reportAssignmentType]
    return replace(nominal, centre=centre, quaternion=turned)


BOXES: tuple[BoxPrototype, BoxPrototype] = (
    BoxPrototype(
        "Shell",
        SIZE_M,
        (
            _stuck_face("+z", "01001/10000/10000/01001/10111", 0.0898, (1.6, -1.1), 90.6),
            _stuck_face("-y", "10111/01001/01001/01001/01001", 0.0891, (-0.7, 1.3), -0.9),
            _stuck_face("+x", "10111/10000/01001/01110/01110", 0.0884, (1.9, -0.8), 179.5),
        ),
    ),
    BoxPrototype(
        "Stella Artois",
        SIZE_M,
        (
            _stuck_face("+z", "11111/00000/11000/11000/11000", 0.0853, (-2.1, 0.5), -0.4),
            _stuck_face("-y", "10101/01010/11111/11111/10101", 0.0891, (0.3, 0.9), 1.1),
            _stuck_face("+x", "01111/10000/11010/11010/01010", 0.0886, (-2.3, -0.6), -89.3),
        ),
    ),
)
"""The same two cubes in every sample, with the ArUco "original" ids 521, 426, 303 and 5, 477, 71 (ECAT 2018
file format §1.8).  As on the real cubes, the markers are not quite where the prototype tables put them."""
YAW_RAD = -math.pi / 4
"""The yaw at which a cube shows the camera the edge between its two marked sides."""
