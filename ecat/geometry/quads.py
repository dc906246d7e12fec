"""Where in an image a marker could be: dark quadrilaterals on brighter ground."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.corners import clockwise
from ecat.geometry.transforms import Floats

if TYPE_CHECKING:
    import cv2

_SMALLEST_PX = 12


def find_quads(
    grey: NDArray[np.uint8], *, min_side_px: float = 13.0, window_px: int = 11, step: float = 7.0
) -> Floats:
    """Rings (n, 4, 2) of roughly placed corners, clockwise on the screen.

    OpenCV's search for marker candidates (Garrido-Jurado et al., Pattern Recognition 2014), accepted or not: what
    they show is read elsewhere, from better corners.

    Parameters
    ----------
    grey : (height, width) uint8.
    min_side_px : mean side of the smallest ring.
    window_px, step : a pixel is dark that is by ``step`` grey levels below the mean of the window around it.
    """
    longest = max(grey.shape)
    if min(grey.shape) < _SMALLEST_PX:
        return np.empty((0, 4, 2))
    detector = _detector()
    parameters = detector.getDetectorParameters()
    parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = window_px
    parameters.adaptiveThreshConstant = step
    # of rings within each other OpenCV keeps the outermost, which is often the edge of the paper around a marker
    parameters.minMarkerDistanceRate = parameters.minGroupDistance = 0.01
    # OpenCV counts lengths in shares of the image: the same marker has to pass in a part of it
    parameters.minMarkerPerimeterRate = 4 * min_side_px / longest
    detector.setDetectorParameters(parameters)
    accepted, _, rejected = detector.detectMarkers(grey)
    found = [*accepted, *rejected]
    return clockwise(np.array(found, np.float64).reshape(-1, 4, 2))


@cache
def _detector() -> cv2.aruco.ArucoDetector:
    import cv2

    # reading is left to others, so the shortest list of codes will do
    codes = cv2.aruco.extendDictionary(1, 3)
    return cv2.aruco.ArucoDetector(codes, cv2.aruco.DetectorParameters())
