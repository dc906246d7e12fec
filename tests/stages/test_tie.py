"""After a move of the camera what stood still keeps its place on the table, or the tables say that nothing does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from ecat.geometry.boxes import box_corners
from ecat.geometry.boxfit import SUBPIXEL, Sightings, place
from ecat.geometry.boxpose import box_poses
from ecat.geometry.cameras import KINECT_V2_COLOR, KINECT_V2_DEPTH
from ecat.geometry.planes import plane_frame
from ecat.geometry.transforms import Floats, Rigid, matrix_about_z, matrix_from_rotvec
from ecat.model.prototype import SHELL, STELLA_ARTOIS
from ecat.stages.pose import table_frames
from ecat.stages.sightings import BoxSightings
from ecat.stages.tie import cuts, pieces, tied
from ecat.tables import TABLE_OUTLINE, TABLE_PLANE

CUT, N = 30, 60
PROTOTYPES = (STELLA_ARTOIS, SHELL)
BEFORE = plane_frame(np.array([0.0, -0.942, -0.336]), 0.73)
CAMERA_MOVE = Rigid(matrix_from_rotvec(np.array([0.02, -0.1, 0.05])), np.array([0.1, 0.02, -0.05]))
AFTER = CAMERA_MOVE @ BEFORE
"""Where the same table frame is from then on."""


def fitted(table: Rigid) -> dict[str, Any]:
    """What a fit of the plane alone knows: its frame is laid where the camera happens to look."""
    normal = table.rotation[:, 2]
    frame = plane_frame(normal, -float(normal @ table.translation))
    row: dict[str, Any] = dict.fromkeys(TABLE_PLANE.arrow.names) | {"n_points": 0, "n_inliers": 0}
    row |= dict(zip(("nx", "ny", "nz"), normal.tolist(), strict=True))
    row |= {"d": -float(normal @ table.translation), "evidence": "depth"}
    row |= dict(zip(("origin_x", "origin_y", "origin_z"), frame.translation.tolist(), strict=True))
    return row | dict(zip(("qx", "qy", "qz", "qw"), frame.quaternion.tolist(), strict=True))


PLANE = pa.Table.from_pylist(
    [fitted(BEFORE) | {"frame": 0}, fitted(AFTER) | {"frame": CUT}], schema=TABLE_PLANE.arrow
)


def standing(box: int, xy: Sequence[float], later: Sequence[float] | None = None) -> BoxSightings:
    """A box on the table, which somebody puts elsewhere while the camera is moved (``later``)."""
    prototype = PROTOTYPES[box]
    places = np.array([xy] * CUT + [later or xy] * (N - CUT))
    pose = Rigid(matrix_about_z(np.full(N, -0.8)), np.column_stack([places, np.full(N, 0.0762)]))
    placed = place(pose, box_corners(prototype))
    points = np.concatenate([BEFORE.apply(placed[:CUT]), AFTER.apply(placed[CUT:])])
    pixels = KINECT_V2_COLOR.project(points)
    pixels += np.random.default_rng(box).normal(0, 0.1, pixels.shape)
    sharp = np.broadcast_to(np.eye(2), (*pixels.shape, 2))
    seen = Sightings(pixels, np.full((*pixels.shape[:-1], 3), np.nan), sharp)
    return BoxSightings(f"o{box}", box, np.arange(N), seen)


def jump(box: BoxSightings, plane: pa.Table) -> Floats:
    """Metres (3,) by which a box is elsewhere on the table after the cut."""
    (_, first), (_, second) = table_frames(plane)
    before, after = (
        box_poses(box.seen[rows], PROTOTYPES[box.prototype], KINECT_V2_COLOR, table, noise=SUBPIXEL)
        for rows, table in ((np.arange(CUT), first), (np.arange(CUT, N), second))
    )
    return np.median(after.pose.translation, 0) - np.median(before.pose.translation, 0)


def tie_of(boxes: Sequence[BoxSightings], outlines: pa.Table | None = None) -> pa.Table:
    return tied(
        PLANE, boxes, PROTOTYPES, KINECT_V2_COLOR, SUBPIXEL, outlines=outlines, depth_camera=KINECT_V2_DEPTH
    )


def test_boxes_that_stood_keep_their_place() -> None:
    boxes = [standing(0, (-0.2, -1.0)), standing(1, (0.2, -0.9))]
    assert np.linalg.norm(jump(boxes[0], PLANE)) > 0.05
    plane = tie_of(boxes)
    assert plane["tie"].to_pylist() == [None, "boxes"]
    assert max(np.abs(jump(box, plane)).max() for box in boxes) < 0.001
    assert cuts(plane) == []
    kept = ["nx", "ny", "nz", "d", "evidence"]
    assert plane.select(kept).equals(PLANE.select(kept))


def test_a_single_box_ties() -> None:
    box = standing(0, (-0.2, -1.0))
    assert np.abs(jump(box, tie_of([box]))).max() < 0.001


def test_boxes_that_contradict_each_other_tie_nothing() -> None:
    plane = tie_of([standing(0, (-0.2, -1.0)), standing(1, (0.2, -0.9), later=(0.3, -0.8))])
    assert plane["tie"].to_pylist() == [None, None]
    assert cuts(plane) == [CUT]


def outline(reach_m: float) -> pa.Table:
    """A table of 1.2 m by twice ``reach_m``, as it is seen before and after."""
    middle = np.array([0.0, -0.9, 0.0])
    ring = middle + np.array([[0.6, 1, 0], [-0.6, 1, 0], [-0.6, -1, 0], [0.6, -1, 0]]) * [1, reach_m, 1]
    rows = [
        {"t_ns": None, "frame": frame, "vertex": k} | dict(zip("xyz", corner.tolist(), strict=True))
        for frame, table in ((0, BEFORE), (CUT, AFTER))
        for k, corner in enumerate(table.apply(ring))
    ]
    return pa.Table.from_pylist(rows, schema=TABLE_OUTLINE.arrow)


@pytest.mark.parametrize(("reach_m", "expected"), [(0.25, "outline"), (2.0, None)])
def test_without_boxes_the_outline_ties_if_all_of_it_is_in_view(reach_m: float, expected: str | None) -> None:
    plane = tie_of([], outline(reach_m))
    assert plane["tie"].to_pylist() == [None, expected]
    if expected:
        (_, first), (_, second) = table_frames(plane)
        off = second @ first.inverse() @ BEFORE @ AFTER.inverse()
        np.testing.assert_allclose(off.rotation, np.eye(3), atol=1e-3)
        np.testing.assert_allclose(off.translation, 0, atol=1e-3)


def test_pieces_end_where_nothing_ties() -> None:
    clock = pa.table({"frame": range(N)})
    assert [part.num_rows for part in pieces(clock, None)] == [N]
    assert [part.num_rows for part in pieces(clock, tie_of([]))] == [CUT, N - CUT]
    assert [part.num_rows for part in pieces(clock, PLANE.slice(0, 1))] == [N]
