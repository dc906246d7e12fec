"""``coordinateMapping.dat``: from depth pixels to colour pixels of one Kinect v2 (§1.6, §2.4).

Little-endian: int32 width, height, near and far range (mm), then two tables of float32 pairs, column after
column: the colour pixel seen by each depth pixel if its depth is the near range, and if it is the far range.
Between the two, colour = a / depth + b. ECAT's loop left out the last column and row; they are zeros in the
file, NaN here.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ecat.errors import FormatError, UsageError
from ecat.formats.ecat2018.xml_input import read_input, reading

MAX_BYTES = 64 << 20
_HEADER = struct.Struct("<4i")


@dataclass(frozen=True, slots=True, eq=False)
class CoordinateMapping:
    """Colour pixels (u right, v down in the mirrored colour image) of every depth pixel at two depths.

    Parameters
    ----------
    near_px, far_px : float32[height, width, 2]; NaN where the file says nothing.
    near_mm, far_mm : the depths they hold for.
    """

    near_px: NDArray[np.float32]
    far_px: NDArray[np.float32]
    near_mm: int = 500
    far_mm: int = 8000

    def to_colour(self, u_px: ArrayLike, v_px: ArrayLike, depth_mm: ArrayLike) -> NDArray[np.float64]:
        """Colour pixels of depth pixels; arguments broadcast to shape (...), the result is float64[..., 2].

        NaN where the depth is 0 (no measurement), the pixel is outside the depth image, or the file says
        nothing. ECAT truncated the result to integers.
        """
        u, v = np.broadcast_arrays(np.asarray(u_px, dtype=np.intp), np.asarray(v_px, dtype=np.intp))
        height, width = self.near_px.shape[:2]
        inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
        at = np.where(inside, v, 0), np.where(inside, u, 0)
        near, far = self.near_px[at].astype(np.float64), self.far_px[at].astype(np.float64)
        b = (far * self.far_mm - near * self.near_mm) / (self.far_mm - self.near_mm)
        a = (near - b) * self.near_mm
        depth = np.asarray(depth_mm, dtype=np.float64)
        known = np.where(depth > 0, depth, np.nan)
        return np.where((inside & (depth > 0))[..., None], a / known[..., None] + b, np.nan)


def read_coordinate_mapping(source: Path | bytes) -> CoordinateMapping:
    """Read the tables.

    Raises
    ------
    FormatError : the header is impossible, or the size of the file contradicts it.
    LimitError : above 64 MiB.
    """
    what = reading(source, "coordinateMapping.dat")
    data = read_input(source, what, MAX_BYTES)
    if len(data) < _HEADER.size:
        raise FormatError(what, where=f"{len(data)} bytes, shorter than the header of {_HEADER.size}")
    width, height, near_mm, far_mm = _HEADER.unpack_from(data)
    if not (0 < width <= 1 << 15 and 0 < height <= 1 << 15 and 0 < near_mm < far_mm):
        raise FormatError(
            what, where=f"the header says {width} x {height} pixels at {near_mm} and {far_mm} mm"
        )
    expected = _HEADER.size + 16 * width * height
    if len(data) != expected:
        raise FormatError(
            what, where=f"{len(data):,} bytes, expected {expected:,} for {width} x {height} pixels"
        )
    tables = np.frombuffer(data, dtype="<f4", offset=_HEADER.size).reshape(2, width, height, 2)
    unknown = (tables == 0).all(axis=(0, 3)) | ~np.isfinite(tables).all(axis=(0, 3))
    near, far = (
        np.ascontiguousarray(np.where(unknown[..., None], np.float32(np.nan), table).swapaxes(0, 1))
        for table in tables
    )
    return CoordinateMapping(near, far, near_mm, far_mm)


def write_coordinate_mapping(mapping: CoordinateMapping) -> bytes:
    """The file; the real one comes back byte for byte."""
    near, far = mapping.near_px, mapping.far_px
    if near.shape != far.shape or near.shape[2:] != (2,):
        raise UsageError(
            "cannot write coordinateMapping.dat",
            where=f"tables of shape {near.shape} and {far.shape}, expected twice (height, width, 2)",
            fix="give near and far of the same image",
        )
    height, width = near.shape[:2]
    tables = np.nan_to_num(np.stack([near, far]), nan=0.0).swapaxes(1, 2).astype("<f4")
    return _HEADER.pack(width, height, mapping.near_mm, mapping.far_mm) + tables.tobytes()
