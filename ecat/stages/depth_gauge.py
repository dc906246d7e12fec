"""Whether faces that were found in the colour image are where depth says that something is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.detection import Detector, Found
from ecat.stages.images import Images


class DepthGauge:
    """Whether faces are as far away as their size says, by the depth image taken nearest in time.

    The two may differ by ``depth_m`` metres and ``depth_share`` of the distance.
    """

    def __init__(
        self, detector: Detector, color: Images, depth: Images, *, depth_m: float, depth_share: float
    ) -> None:
        self._detector, self._depth = detector, depth
        self._depth_m, self._depth_share = depth_m, depth_share
        timed = color.t_ns is not None and depth.t_ns is not None
        when, there = (color.t_ns, depth.t_ns) if timed else (color.frame, depth.frame)
        self._when = np.asarray(when, np.int64)
        self._there = np.asarray(there, np.int64)

    def __call__(self, image: int, found: Found) -> NDArray[np.bool_]:
        """Which of the faces found in the image with this index are plausible (n,)."""
        camera = self._depth.camera
        fine = np.ones(len(found), bool)
        if camera is None or self._detector.camera is None or not len(self._there):
            return fine
        nearest = int(np.argmin(np.abs(self._there - self._when[image])))
        [measured] = self._depth.read([nearest])
        # both poses of a square are equally far away
        centre = self._detector.poses(found)[0].translation
        distance = camera.from_reference.apply(centre)[:, 2]
        pixels = camera.project(centre)
        for i, (u, v) in enumerate(pixels):
            inside = np.isfinite(u) and 0 <= u < measured.shape[1] and 0 <= v < measured.shape[0]
            if not inside:
                continue
            column, row = round(float(u)), round(float(v))
            patch = measured[max(row - 2, 0) : row + 3, max(column - 2, 0) : column + 3]
            if (patch > 0).any():
                depth_m = float(np.median(patch[patch > 0])) * self._depth.unit_m
                allowed = self._depth_m + self._depth_share * depth_m
                fine[i] = abs(distance[i] - depth_m) <= allowed
        return fine
