"""The table's plane from what a person drew, from boxes that stand on it, and from both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from ecat.errors import InputError
from ecat.geometry.transforms import Floats
from ecat.model.prototype import BoxPrototype
from ecat.stages.plane import PLANE, PlaneParameters, fit_table, polygon_points
from ecat.tables import TABLE_PLANE
from tests.stages.recorded import TABLE, Recorded

Generated = Callable[..., Recorded]
NONE: Floats = np.empty((0, 3))


def measured(box: BoxPrototype | None) -> PlaneParameters:
    assert box is not None
    return PlaneParameters(
        prototypes=(replace(box, faces=tuple(replace(f, sigma_m=0.001) for f in box.faces)),)
    )


def off(plane: pa.Table) -> tuple[float, float]:
    """Angle in degrees, and height in mm where the camera looks."""
    row = plane.to_pylist()[0]
    normal = np.array([row["nx"], row["ny"], row["nz"]])
    cosine = np.clip(normal @ TABLE.rotation[:, 2], -1, 1)
    return float(np.degrees(np.arccos(cosine))), float(1000 * abs(normal @ TABLE.translation + row["d"]))


def test_a_polygon_gives_the_plane(generated: Generated) -> None:
    plane = fit_table(generated(5).polygon)
    assert plane.schema.equals(TABLE_PLANE.arrow)
    assert off(plane) == pytest.approx((0, 0), abs=1e-4)
    assert plane["evidence"].to_pylist() == ["polygon"]
    assert plane["n_inliers"].to_pylist() == [4]


def test_boxes_correct_a_badly_drawn_polygon(generated: Generated) -> None:
    session = generated(300)
    bad = session.polygon + np.array([[0, 0.02, 0], [0, -0.02, 0], [0, 0.02, 0.01], [0, -0.01, 0]])
    alone = off(fit_table(bad, parameters=PlaneParameters(tolerance_m=0.05)))
    together = fit_table(bad, session.markers_2d, session.markers_3d, measured(session.prototype))
    assert together["evidence"].to_pylist() == ["polygon+boxes"]
    assert off(together)[0] < 0.3 < alone[0]
    assert off(together)[1] < 2


def test_without_a_polygon_a_few_frames_of_a_box_have_to_do(generated: Generated) -> None:
    session = generated(5)
    plane = fit_table(NONE, session.markers_2d, session.markers_3d, measured(session.prototype))
    assert plane["evidence"].to_pylist() == ["boxes"]
    angle, height_mm = off(plane)
    assert angle < 2
    assert height_mm < 30


def test_boxes_alone_give_the_plane(generated: Generated) -> None:
    session = generated(300)
    plane = fit_table(NONE, session.markers_2d, session.markers_3d, measured(session.prototype))
    assert plane["evidence"].to_pylist() == ["boxes"]
    angle, height_mm = off(plane)
    assert angle < 0.3
    assert height_mm < 2
    assert plane["rms_m"].null_count == 1


def test_boxes_that_were_never_measured_do_not_move_the_plane(generated: Generated) -> None:
    session = generated(60)
    plane = fit_table(session.polygon, session.markers_2d)
    assert plane["evidence"].to_pylist() == ["polygon"]


def test_nothing_to_go_by_is_refused() -> None:
    with pytest.raises(InputError, match="no known box"):
        fit_table(np.full((4, 3), np.nan))


def test_polygons_are_read_from_key_frames() -> None:
    rows = [
        {"object_id": o, "dimensions": d, "vertex": v, "x": float(i), "y": None, "z": 1.0}
        for i, (o, d, v) in enumerate([("o5", 3, 0), ("o5", 2, 0), ("o6", 3, 1), ("o5", 3, None)])
    ]
    schema = pa.schema(
        [
            ("object_id", pa.dictionary(pa.int32(), pa.string())),
            ("dimensions", pa.int8()),
            ("vertex", pa.int16()),
            *[(axis, pa.float64()) for axis in "xyz"],
        ]
    )
    keyframes = pa.Table.from_pylist(rows).cast(schema)
    np.testing.assert_array_equal(polygon_points(keyframes)[:, 0], [0, 2])
    np.testing.assert_array_equal(polygon_points(keyframes, "o5"), [[0, np.nan, 1]])


def test_the_stage_is_the_function(generated: Generated) -> None:
    points = generated(5).polygon
    columns = {axis: pa.array(points[:, i]) for i, axis in enumerate("xyz")}
    keyframes = pa.table(
        {
            "object_id": pa.array(["o5"] * 4),
            "dimensions": pa.array([3] * 4),
            "vertex": pa.array(range(4)),
            **columns,
        }
    )
    made = PLANE.run({"keyframes": keyframes}, {}, PLANE.parameters())
    assert tuple(made) == PLANE.outputs
    assert off(made["table_plane"]) == pytest.approx((0, 0), abs=1e-4)


def test_of_a_long_recording_frames_spread_over_it_give_the_plane(generated: Generated) -> None:
    session = generated(300)
    assert session.markers_2d is not None
    parameters = measured(session.prototype)
    whole = fit_table(session.polygon, session.markers_2d, None, parameters)
    at = session.markers_2d.schema.get_field_index("frame")
    # five hours in which a box is seen now and then
    frame = pa.array(session.markers_2d["frame"].to_numpy() * 1800)
    sparse = session.markers_2d.set_column(at, session.markers_2d.schema.field("frame"), frame.cast("int32"))

    plane = fit_table(session.polygon, sparse, None, parameters)

    # neighbours are no longer left out: they are a minute apart
    few, many = (fit["n_inliers"].to_pylist()[0] for fit in (whole, plane))
    assert few is not None
    assert many is not None
    assert many > 2 * few
    assert off(plane)[0] < 0.3
    assert off(plane)[1] < 2
