"""Image files as a track of a session; a Kinect v1's disparities become depth on the way."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecat.errors import FormatError
from ecat.formats.recordings.common import Track, color_track, depth_track
from ecat.formats.recordings.image_files import image_source, read_image

# Kinect v1's 11-bit disparity d: metres are 351.3 / (1092.5 - d) (NYU Depth V2 toolbox), 2047 is no measurement
_NO_DISPARITY, _DISPARITY_A, _DISPARITY_B, _MOST_M = 2047, 351.3, 1092.5, 10.0
DISPARITY_UNIT_M = 0.0002
"""Finer than one step of disparity from 0.27 m on, so that none are merged; 16 bits reach to 13 m."""


def image_track(
    kind: str,
    paths: Sequence[Path],
    t_ns: Sequence[int],
    what: str,
    *,
    camera: str = "",
    unit_m: float | None = None,
    disparity: bool = False,
    lost: set[int] | None = None,
    blank: NDArray[Any] | None = None,
) -> Track:
    """Images of one kind, color or depth, taken at ``t_ns``.

    Parameters
    ----------
    disparity : the depth images hold a Kinect v1's disparities; ``unit_m`` is that of the depth they become.
    lost, blank : see :func:`ecat.formats.recordings.image_files.image_source`.
    """
    notes: list[str] = []
    images = image_source(
        paths,
        t_ns,
        what,
        deep=kind == "depth",
        note=notes.append,
        convert=disparity_to_depth if disparity else None,
        lost=lost,
        blank=blank,
    )
    if kind == "color":
        track = color_track(kind, images, camera=camera, expected=len(paths))
        notes.append("the images were encoded to H.264, which loses detail that the eye does not miss")
    else:
        track = depth_track(kind, images, unit_m=unit_m, camera=camera, expected=len(paths))
    if disparity:
        notes.append(
            "the Kinect's raw disparities became depth by 351.3 / (1092.5 - d) m, in steps of "
            f"{DISPARITY_UNIT_M * 1000:g} mm; what is beyond {_MOST_M:g} m counts as not measured"
        )
    track.notes = notes
    return track


def is_disparity(path: Path, what: str) -> bool:
    """Whether a depth image holds a Kinect v1's 11-bit disparities, in either order of bytes."""
    if path.suffix.lower() not in {".pgm", ".pnm"}:
        return False
    try:
        image = _host_order(read_image(path, what, deep=True))
    except FormatError:
        return False
    return int(image.max(initial=0)) == _NO_DISPARITY


def _host_order(image: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """NYU's files are little-endian, against the format: seen by 11-bit values that only fit the other way round."""
    swapped = image.byteswap()
    return swapped if image.max(initial=0) > _NO_DISPARITY >= swapped.max(initial=0) else image


def disparity_to_depth(image: NDArray[Any]) -> NDArray[np.uint16]:
    """Kinect v1's disparities (height, width) as depth in units of 0.2 mm, 0 where nothing was measured."""
    values = _host_order(image).astype(np.float64)
    depth_m = np.divide(
        _DISPARITY_A, _DISPARITY_B - values, out=np.zeros_like(values), where=values < _DISPARITY_B
    )
    depth_m[depth_m > _MOST_M] = 0.0
    return np.rint(depth_m / DISPARITY_UNIT_M).astype(np.uint16)
