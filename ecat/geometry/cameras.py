"""Pinhole cameras with lens distortion, and the default calibrations of the Kinect v2.

Camera axes are OpenCV's for the physical camera: x right, y down, z forward, as seen from behind the camera.
The Kinect v2 delivers left-right mirrored images: there the image column runs against x.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ecat.geometry.transforms import Floats, Rigid


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with the Brown-Conrady (rational) lens model, in OpenCV's order and sense.

    Parameters
    ----------
    name : frame of the camera, ``camera/<name>``.
    width, height : image size in pixels.
    fx, fy, cx, cy : focal lengths and principal point in pixels.
    distortion : k1, k2, p1, p2, k3, k4, k5, k6.
    mirrored : image column runs against the camera's x axis, ``u = cx - fx * x / z``.
    from_reference : maps the frame in which points are given (``reference``) to this camera's frame.
    """

    name: str
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = (0.0,) * 8
    mirrored: bool = False
    reference: str = ""
    from_reference: Rigid = field(default_factory=Rigid.identity)

    def project(self, points: Floats) -> Floats:
        """Pixels (..., 2) of points (..., 3) in the reference frame; NaN for points not in front of the
        camera.
        """
        return self.project_jacobian(points)[0]

    def project_jacobian(self, points: Floats) -> tuple[Floats, Floats]:
        """Pixels (..., 2) and their derivatives (..., 2, 3) by the point in the reference frame, px/m."""
        camera = self.from_reference.apply(points)
        z = np.where(camera[..., 2] > 0, camera[..., 2], np.nan)
        xy = camera[..., :2] / z[..., None]
        bent, bend = self._distort(xy)
        focal = np.array([-self.fx if self.mirrored else self.fx, self.fy])
        pixels = bent * focal + np.array([self.cx, self.cy])
        by_point = np.zeros((*xy.shape[:-1], 2, 3))
        by_point[..., 0, 0] = by_point[..., 1, 1] = 1 / z
        by_point[..., :, 2] = -xy / z[..., None]
        if any(self.distortion):
            by_point = bend @ by_point
        # one product of large matrices is quicker than many of small ones
        turned = (by_point.reshape(-1, 3) @ self.from_reference.rotation).reshape(by_point.shape)
        return pixels, focal[:, None] * turned

    def unproject(self, pixels: Floats) -> Floats:
        """Ray directions (..., 3) with z = 1, in this camera's frame, of pixels (..., 2).

        The lens model is inverted by Newton's method (8 steps, below 1e-9 for any lens that does not fold).
        """
        focal = np.array([-self.fx if self.mirrored else self.fx, self.fy])
        target = (np.asarray(pixels, float) - np.array([self.cx, self.cy])) / focal
        xy = target.copy()
        for _ in range(8 if any(self.distortion) else 0):
            bent, bend = self._distort(xy)
            xy = xy - np.linalg.solve(bend, (bent - target)[..., None])[..., 0]
        return np.concatenate([xy, np.ones_like(xy[..., :1])], -1)

    def _distort(self, xy: Floats) -> tuple[Floats, Floats]:
        """Distorted normalised coordinates (..., 2) and their derivatives (..., 2, 2)."""
        eye = np.broadcast_to(np.eye(2), (*xy.shape[:-1], 2, 2))
        if not any(self.distortion):
            return xy, eye
        k1, k2, p1, p2, k3, k4, k5, k6 = self.distortion
        x, y = xy[..., 0], xy[..., 1]
        r2 = x * x + y * y
        top, bottom = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
        ratio = top / bottom
        slope = (k1 + r2 * (2 * k2 + 3 * k3 * r2) - ratio * (k4 + r2 * (2 * k5 + 3 * k6 * r2))) / bottom
        bent = ratio[..., None] * xy + np.stack(
            [2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], -1
        )
        cross = 2 * slope * x * y + 2 * p1 * x + 2 * p2 * y
        bend = np.empty((*xy.shape[:-1], 2, 2))
        bend[..., 0, 0] = ratio + 2 * slope * x * x + 2 * p1 * y + 6 * p2 * x
        bend[..., 1, 1] = ratio + 2 * slope * y * y + 6 * p1 * y + 2 * p2 * x
        bend[..., 0, 1] = bend[..., 1, 0] = cross
        return bent, bend


# Least squares on 118 054 pairs of depth-camera points and colour pixels (ECAT 2018 file format §2.3):
# u = 1065.5 X/Z + 54.66/Z + 967.1, v = -1066.0 Y/Z - 0.23/Z + 548.9 in Kinect camera space.
KINECT_V2_COLOR = Camera(
    "color",
    1920,
    1080,
    fx=1065.5,
    fy=1066.0,
    cx=967.1,
    cy=548.9,
    mirrored=True,
    reference="camera/depth",
    from_reference=Rigid(np.eye(3), np.array([-54.66 / 1065.5, -0.23 / 1066.0, 0.0])),
)

# ECAT's offline constants with the principal point that agrees with the sensor (ECAT 2018 file format §2.3).
KINECT_V2_DEPTH = Camera(
    "depth",
    512,
    424,
    fx=367.187,
    fy=369.0,
    cx=262.7343,
    cy=203.6235,
    mirrored=True,
    reference="camera/depth",
)
