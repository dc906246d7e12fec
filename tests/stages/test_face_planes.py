"""From marker tables and depth images to planes of faces."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from numpy.typing import NDArray

from ecat.geometry.boxes import box_corners
from ecat.geometry.cameras import KINECT_V2_DEPTH, Camera
from ecat.stages.face_planes import FACE_PLANES_STAGE, FacePlaneParameters, fit_face_planes
from ecat.stages.images import Part
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


@dataclass(frozen=True)
class Counted(Depth):
    """The same, with the indices of all that was read."""

    asked: list[int] = field(default_factory=list[int])

    def read(self, indices: Sequence[int]) -> Iterator[NDArray[Any]]:
        self.asked.extend(indices)
        return super().read(indices)


@dataclass(frozen=True)
class Partly(Depth):
    """The same, with nothing outside the parts that are asked for."""

    def read_parts(self, indices: Sequence[int], parts: Sequence[Sequence[Part]]) -> Iterator[NDArray[Any]]:
        for image, wanted in zip(self.read(indices), parts, strict=True):
            made = np.zeros_like(image)
            for left, top, right, bottom in wanted:
                made[max(top, 0) : bottom, max(left, 0) : right] = image[
                    max(top, 0) : bottom, max(left, 0) : right
                ]
            assert 0 < (made > 0).mean() < 0.2
            yield made


def test_only_what_lies_in_faces_is_looked_at(generated: Generated) -> None:
    session = generated(5)
    whole = depth_of(session)
    partly = Partly(whole.images, whole.t_ns)
    planes = fit_face_planes(session.markers_2d, partly, parameters(session))
    assert planes.equals(fit_face_planes(session.markers_2d, whole, parameters(session)))


def still(session: Recorded, n: int, shift_px: float = 0.0) -> pa.Table:
    """The markers of the first frame in ``n`` frames, ``shift_px`` further to the right in each."""
    first = session.markers_2d.filter(pc.field("frame") == 0)
    parts: list[pa.Table] = []
    for i, t_ns in enumerate(session.clock["t_ns"].to_pylist()[:n]):
        moved = {
            name: np.asarray(first[name]) + i * shift_px for name in first.schema.names if name[0] == "u"
        }
        changed = {"t_ns": np.full(len(first), t_ns), "frame": np.full(len(first), i), **moved}
        columns = [
            pa.array(changed[f.name], f.type) if f.name in changed else first[f.name] for f in first.schema
        ]
        parts.append(pa.Table.from_arrays(columns, schema=first.schema))
    return pa.concat_tables(parts)


def test_a_face_that_stands_still_keeps_its_plane_for_a_while(generated: Generated) -> None:
    session = generated(20)
    counted = Counted(depth_of(session).images, depth_of(session).t_ns)
    markers = still(session, 20)
    planes = fit_face_planes(markers, counted, replace(parameters(session), still_images=8))
    assert counted.asked == [0, 8, 16]
    every = fit_face_planes(markers, depth_of(session), replace(parameters(session), still_images=0))
    assert set(planes["frame"].to_pylist()) == set(range(20))
    np.testing.assert_allclose(planes["d"], every["d"], atol=1e-9)


def test_an_image_is_read_where_a_face_has_moved(generated: Generated) -> None:
    session = generated(20)
    counted = Counted(depth_of(session).images, depth_of(session).t_ns)
    slowly = replace(parameters(session), still_px=0.25, still_images=8)
    fit_face_planes(still(session, 20, 0.1), counted, slowly)
    assert counted.asked == [0, 3, 6, 9, 12, 15, 18]


def test_stretches_of_frames_are_put_together(generated: Generated, monkeypatch: pytest.MonkeyPatch) -> None:
    session = generated(20)
    one = replace(parameters(session), still_images=0)
    whole = fit_face_planes(session.markers_2d, depth_of(session), one)
    monkeypatch.setattr("ecat.stages.face_planes._FRAMES_AT_ONCE", 7)
    parts = fit_face_planes(session.markers_2d, depth_of(session), one)
    assert parts["frame"].equals(whole["frame"])
    np.testing.assert_allclose(parts["d"], whole["d"], rtol=1e-9)
