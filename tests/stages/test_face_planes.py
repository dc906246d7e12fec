"""From marker tables and depth images to planes of faces."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecat.geometry.boxes import box_corners
from ecat.geometry.cameras import KINECT_V2_DEPTH, Camera
from ecat.stages.face_planes import FACE_PLANES_STAGE, FacePlaneParameters, fit_face_planes
from ecat.tables import FACE_PLANES
from tests.stages.recorded import TABLE, Recorded

Generated = Callable[..., Recorded]


@dataclass(frozen=True)
class Depth:
    """Depth images in memory."""

    images: Sequence[NDArray[Any]]
    t_ns: NDArray[np.int64] | None
    camera: Camera | None = KINECT_V2_DEPTH
    unit_m: float = 0.001

    @property
    def frame(self) -> NDArray[np.int64]:
        return np.arange(len(self.images))

    def __len__(self) -> int:
        return len(self.images)

    def __iter__(self) -> Iterator[NDArray[Any]]:
        return iter(self.images)

    def read(self, indices: Sequence[int]) -> Iterator[NDArray[Any]]:
        return (self.images[i] for i in indices)


def top(session: Recorded) -> NDArray[np.uint16]:
    """Depth of the plane that the box's upper face lies in, wherever it is seen."""
    u, v = np.meshgrid(np.arange(512), np.arange(424))
    rays = KINECT_V2_DEPTH.unproject(np.stack([u, v], -1).astype(float))
    up = TABLE.rotation[:, 2]
    z = (up @ TABLE.translation + 0.1524) / (rays @ up)
    return np.where((z > 0) & (z < 8), np.rint(1000 * z), 0).astype(np.uint16)


def depth_of(session: Recorded, later_ns: int = 0) -> Depth:
    times = np.asarray(session.clock["t_ns"], np.int64)
    return Depth([top(session)] * len(times), times + later_ns)


def parameters(session: Recorded) -> FacePlaneParameters:
    assert session.prototype is not None
    return FacePlaneParameters(prototypes=(session.prototype,))


def test_the_plane_of_a_face_is_that_of_its_depth(generated: Generated) -> None:
    session = generated(5)
    planes = fit_face_planes(session.markers_2d, depth_of(session), parameters(session))
    assert planes.schema.equals(FACE_PLANES.arrow)
    assert planes.num_rows >= 5
    normals = np.stack([planes[c].to_numpy() for c in ("nx", "ny", "nz")], -1)
    assert (normals @ TABLE.rotation[:, 2] > 0.9995).all()
    assert session.prototype is not None
    assert session.pose is not None
    corners = TABLE.apply(session.pose.translation[0] + box_corners(session.prototype)[0])
    away = corners @ normals[0] + planes["d"][0].as_py()
    assert np.abs(away).max() < 0.004
    assert np.asarray(planes["n_points"]).min() >= 12
    assert set(planes["frame"].to_pylist()) == set(range(5))


def test_rows_keep_the_order_of_the_markers(generated: Generated) -> None:
    session = generated(8)
    planes = fit_face_planes(session.markers_2d, depth_of(session), parameters(session))
    keys = list(zip(planes["frame"].to_pylist(), planes["order"].to_pylist(), strict=True))
    assert keys == sorted(keys)


def test_depth_too_far_away_in_time_is_not_used(generated: Generated) -> None:
    session = generated(5)
    late = fit_face_planes(session.markers_2d, depth_of(session, 300_000_000), parameters(session))
    assert set(late["frame"].to_pylist()) == set()
    near = fit_face_planes(session.markers_2d, depth_of(session, 5_000_000), parameters(session))
    assert set(near["frame"].to_pylist()) == set(range(5))


def test_without_a_clock_images_count(generated: Generated) -> None:
    session = generated(5)
    timeless = Depth([top(session)] * 3, None)
    planes = fit_face_planes(session.markers_2d, timeless, parameters(session))
    assert set(planes["frame"].to_pylist()) == {0, 1, 2}


def test_without_calibration_or_images_there_are_no_planes(generated: Generated) -> None:
    session = generated(3)
    blind = Depth([top(session)], np.zeros(1, np.int64), camera=None)
    for depth in (blind, Depth([], np.empty(0, np.int64))):
        assert fit_face_planes(session.markers_2d, depth, parameters(session)).num_rows == 0


def test_the_stage_is_the_function(generated: Generated) -> None:
    session = generated(3)
    made = FACE_PLANES_STAGE.run(
        {"markers_2d": session.markers_2d}, {"depth": depth_of(session)}, parameters(session)
    )
    assert tuple(made) == FACE_PLANES_STAGE.outputs
    assert made["face_planes"].num_rows
