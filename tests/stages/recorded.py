"""Marker tables of sessions: generated ones with known truth, and the real ones beside the checkout."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from lxml import etree

from ecat.geometry.boxes import box_corners
from ecat.geometry.boxfit import place
from ecat.geometry.cameras import KINECT_V2_COLOR
from ecat.geometry.planes import plane_frame
from ecat.geometry.transforms import Floats, Rigid
from ecat.model.prototype import BoxPrototype
from ecat.stages.calibrate import Recording

TABLE = plane_frame(np.array([0.0, -0.942, -0.336]), 0.73)
CLOCKWISE = (0, 3, 2, 1)  # on the screen of a mirrored camera, in the print's order


@dataclass(frozen=True)
class Recorded:
    """A session as stages see it: tables, points on the table, and what is known of the truth."""

    clock: pa.Table
    markers_2d: pa.Table
    markers_3d: pa.Table
    polygon: Floats
    names: dict[str, str]
    pose: Rigid | None = None
    prototype: BoxPrototype | None = None
    table: Rigid | None = None

    @property
    def recording(self) -> Recording:
        return Recording(self.markers_2d, self.markers_3d, self.polygon)


def read_code(printed: str, start: int) -> str:
    """The code a detector reads from a mirrored image, whose leftmost corner is the print's corner
    ``start``.
    """
    corners = np.array([[0.0, 0], [0, 1], [1, 1], [1, 0]])  # row, column of TL, TR, BR, BL
    ring = corners[[CLOCKWISE[(CLOCKWISE.index(start) + k) % 4] for k in range(4)]]
    cells = (np.arange(5) + 0.5) / 5
    rows = ring[0] + cells[:, None, None] * (ring[3] - ring[0]) + cells[None, :, None] * (ring[1] - ring[0])
    index = np.floor(rows * 5).astype(int)
    return "".join(printed[5 * r + c] for r, c in index.reshape(-1, 2))


def marker_tables(box: BoxPrototype, pose: Rigid, noise_px: float) -> tuple[pa.Table, pa.Table]:
    """What the detector of 2018 would have stored of a box at poses (n), frame by frame, largest face
    first.
    """
    rng = np.random.default_rng(7)
    placed = TABLE.apply(place(pose, box_corners(box)))
    normal = np.cross(placed[..., 1, :] - placed[..., 0, :], placed[..., 3, :] - placed[..., 0, :])
    eye = KINECT_V2_COLOR.from_reference.inverse().translation
    away = (normal * (placed.mean(2) - eye)).sum(-1)
    pixels = np.round(KINECT_V2_COLOR.project(placed) + rng.normal(0, noise_px, (*placed.shape[:-1], 2)))
    flat: list[dict[str, Any]] = []
    solid: list[dict[str, Any]] = []
    for frame in range(len(pixels)):
        for order, face in enumerate(np.argsort(-away[frame])[: int((away[frame] > 0).sum())]):
            ring = pixels[frame, face][list(CLOCKWISE)]
            leftmost = CLOCKWISE[int(np.lexsort((ring[:, 1], ring[:, 0]))[0])]
            key = {"t_ns": frame * 33_333_333, "frame": frame, "object_id": "o2", "order": order}
            key["code"] = read_code(box.faces[face].code, leftmost)
            ring = np.roll(ring, -int(np.argmin(ring.sum(1))), 0)
            flat.append(key | {f"{a}{i}_px": ring[i, j] for i in range(4) for j, a in enumerate("uv")})
            space = placed[frame, face][list(CLOCKWISE)]
            space = np.roll(space, -int(np.argmax(space[:, :2].sum(1))), 0)  # smallest x + y of Kinect's axes
            solid.append(key | {f"{a}{i}": space[i, j] for i in range(4) for j, a in enumerate("xyz")})
    return _marker_table(flat), _marker_table(solid)


def _marker_table(rows: list[dict[str, Any]]) -> pa.Table:
    table = pa.Table.from_pylist(rows)
    types: dict[str, pa.DataType] = {
        "frame": pa.int32(),
        "order": pa.int16(),
        "object_id": pa.dictionary(pa.int32(), pa.string()),
    }
    wanted = [field.with_type(types[field.name]) if field.name in types else field for field in table.schema]
    return table.cast(pa.schema(wanted))


def clock_of(n: int, duration_ns: float) -> pa.Table:
    t_ns = np.linspace(0, duration_ns, n).astype(np.int64)
    return pa.table({"t_ns": pa.array(t_ns), "frame": pa.array(np.arange(n, dtype=np.int32))})


SESSIONS = (("SlideAway", "Session1"), ("SlideNext", "Session2"), ("SlidePast", "Session1"))


def _numbers(text: str | None) -> list[float]:
    return [float(token.replace("∞", "inf")) for token in (text or "").split(",")]


def read_session(path: Path) -> Recorded:
    session = etree.parse(path).getroot()
    n, duration_ms = int(session.get("length", "0")), int(session.get("duration", "0"))
    flat: list[dict[str, Any]] = []
    solid: list[dict[str, Any]] = []
    polygon: list[Floats] = []
    names: dict[str, str] = {}
    for thing in session.iterfind("objects/object"):
        object_id = thing.get("id", "")
        names[object_id] = thing.get("name", "")
        for marker in thing.iterfind("markers3d/marker"):
            polygon += [_space(_numbers(marker.text))] if (marker.text or "").strip() else []
        for group, rows in (("markers", flat), ("markers3d", solid)):
            for face in thing.iterfind(f"{group}/marker/face"):
                marker = face.getparent()
                assert marker is not None
                frame = int(marker.get("frame", "0"))
                corners = _numbers(face.findtext("bounding"))
                code = (face.findtext("code") or "").replace(" ", "").replace(",", "")
                row: dict[str, Any] = {"t_ns": frame, "frame": frame, "object_id": object_id}
                row |= {"order": marker.index(face), "code": code}
                if group == "markers":
                    row |= {f"{a}{i}_px": corners[2 * i + j] for i in range(4) for j, a in enumerate("uv")}
                else:
                    points = _space(corners)
                    row |= {f"{a}{i}": points[i, j] for i in range(4) for j, a in enumerate("xyz")}
                rows.append(row)
    clock = clock_of(n, duration_ms * 1e6)
    return Recorded(clock, _marker_table(flat), _marker_table(solid), np.concatenate(polygon), names)


def _space(numbers: list[float]) -> Floats:
    """Kinect camera space to camera/depth (ECAT 2018 file format §1.2.4); infinite points are missing."""
    points = np.array(numbers).reshape(-1, 3)
    points[~np.isfinite(points).all(1)] = np.nan
    return points * np.array([-1.0, -1.0, 1.0])
